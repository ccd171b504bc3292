"""Collects one topic's messages into a track: numbers by a decoder, stamps by the wanted clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eha_bench.recordings.channel_map import Clock
from eha_bench.recordings.decoder import Decoder, Encoded, UnreadableTopic, make_decoder
from eha_bench.recordings.field_path import FieldPath
from eha_bench.recordings.payloads import Payloads
from eha_bench.recordings.source import Source, Wanted
from eha_bench.recordings.track import Arena, Column, Growing, StampColumn, Stamps, Track

_STAMPS = (
    ("header.stamp.sec", "header.stamp.nanosec"),
    ("stamp.sec", "stamp.nanosec"),
    ("header.stamp.seconds", "header.stamp.nanos"),
    ("header.timestamp.seconds", "header.timestamp.nanos"),
    ("timestamp.seconds", "timestamp.nanos"),
)

Rows = NDArray[np.intp]


@dataclass(frozen=True)
class Part:
    """Equal-size messages of one channel id among the messages of a topic.

    Attributes:
        channel: id, since a topic may have channels (publishers) of different schemas.
        payloads: the messages.
        rows: their places within the batch; None if they are the whole batch, in order.
        stamps: (n,) ns by the log's or the publisher's clock.
    """

    channel: int
    payloads: Payloads
    rows: Rows | None
    stamps: Stamps


class TopicReader:
    """Grows a track from batches of messages of one topic."""

    def __init__(
        self,
        topic: str,
        wanted: Wanted,
        expected: int = 0,
        arena: Arena | None = None,
        leader: Callable[[], StampColumn | None] = lambda: None,
    ) -> None:
        """Expect so many messages, to be kept in the arena.

        `leader` tells whose stamps these may be the same as.
        """
        self._topic = topic
        self._wanted = wanted
        self._decoders: dict[int, Decoder] = {}
        memory = arena or Arena()
        self._columns = [Growing(memory.take(expected)) for _ in wanted.fields]
        self._expected = expected
        self._leader = leader
        self._stamps: StampColumn | None = None

    @property
    def clock(self) -> Clock | None:
        """Which time stamps the samples; None if they carry their own time."""
        return self._wanted.clock

    def extend(self, batch: list[Part], encoded: Callable[[int], Encoded]) -> None:
        """Add messages that lie together in the log.

        Args:
            batch: the messages; the rows of all parts together are 0 .. n-1.
            encoded: how the messages of a channel id are encoded.

        Raises:
            UnreadableTopic: a message does not fit, or there is no header stamp.
        """
        total = sum(part.payloads.count for part in batch)
        columns = [column.extend(total) for column in self._columns]
        whole = len(batch) == 1 and batch[0].rows is None
        place = None if whole or self.clock is None else np.empty(total, dtype=np.int64)
        for part in batch:
            targets = (
                columns if part.rows is None else [np.empty(part.payloads.count) for _ in columns]
            )
            stamps = self._decode(part, targets, encoded)
            if whole:
                place = stamps
            elif part.rows is not None:
                if place is not None:
                    place[part.rows] = stamps
                for column, target in zip(columns, targets, strict=True):
                    column[part.rows] = target
        if place is not None and self.clock is not None:
            self.stamps.extend(place)

    def _decode(
        self, part: Part, targets: list[Column], encoded: Callable[[int], Encoded]
    ) -> Stamps:
        """Decode one part into the targets; return its stamps by the wanted clock."""
        header = self.clock is Clock.HEADER
        if not targets and not header:
            return part.stamps  # only asked when there were messages: any encoding will do
        decoder = self._decoders.get(part.channel)
        if decoder is None:
            decoder = self._decoders[part.channel] = self._make(encoded(part.channel))
        if not header:
            decoder.decode(part.payloads, targets)
            return part.stamps
        stamp = [np.empty(part.payloads.count), np.empty(part.payloads.count)]
        decoder.decode(part.payloads, [*targets, *stamp])
        if not (np.isfinite(stamp[0]).all() and np.isfinite(stamp[1]).all()):
            raise UnreadableTopic("some of its messages have no header.stamp")
        return stamp[0].astype(np.int64) * 1_000_000_000 + stamp[1].astype(np.int64)

    @property
    def stamps(self) -> StampColumn:
        """The stamps so far."""
        if self._stamps is None:
            self._stamps = StampColumn(self._expected, self._leader())
        return self._stamps

    def finish(self) -> Track:
        """Return the track.

        Raises:
            UnreadableTopic: no message at all has one of the wanted elements.
        """
        if self._decoders:
            found = {index for decoder in self._decoders.values() for index in decoder.found()}
            for index, path in enumerate(self._wanted.fields):
                if index not in found:
                    raise UnreadableTopic(f"no message has an element {path}")
        stamps = np.empty(0, np.int64) if self.clock is None else self.stamps.finish()
        columns = [column.finish() for column in self._columns]
        names = [str(path) for path in self._wanted.fields]
        kinds = {
            names[index]: kind
            for decoder in self._decoders.values()
            for index, kind in decoder.kinds().items()
            if index < len(names)
        }
        return Track(self._topic, stamps, dict(zip(names, columns, strict=True)), kinds)

    def _make(self, encoded: Encoded) -> Decoder:
        fields = self._wanted.fields
        if self.clock is not Clock.HEADER:
            return make_decoder(encoded, fields)
        make_decoder(encoded, fields)  # a wrong field is said before a missing stamp
        for pair in _STAMPS:
            paths = tuple(FieldPath.parse(text) for text in pair)
            try:
                return make_decoder(encoded, (*fields, *paths))
            except UnreadableTopic:
                continue
        raise UnreadableTopic("its messages have no header.stamp (use clock: log or publish)")


def in_order(groups: list[Payloads]) -> list[Rows | None]:
    """Return each group's rows in the order in which all messages stand in their buffer."""
    if len(groups) == 1:
        return [None]
    starts = [
        group.starts
        if group.starts is not None
        else group.first + group.step * np.arange(group.count, dtype=np.int64)
        for group in groups
    ]
    order = np.argsort(np.concatenate(starts), kind="stable")
    rows = np.empty(order.size, dtype=np.intp)
    rows[order] = np.arange(order.size)
    stops = np.cumsum([group.count for group in groups])
    return [
        rows[stop - group.count : stop] for stop, group in zip(stops.tolist(), groups, strict=True)
    ]


def finished(source: Source, readers: Mapping[str, TopicReader]) -> dict[str, Track]:
    """Return the tracks of all readers.

    Raises:
        RecordingError: no message of a topic has one of the wanted elements.
    """
    tracks = {}
    for topic, reader in readers.items():
        try:
            tracks[topic] = reader.finish()
        except UnreadableTopic as error:
            raise source.refuse(topic, error) from error
    return tracks
