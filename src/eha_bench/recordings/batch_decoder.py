"""Decodes messages of one topic that lie together in a log: numbers, and stamps by a clock."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import IndexArray
from eha_bench.recordings.channel_map import Clock
from eha_bench.recordings.encodings.decoder import Decoder, Encoded, UnreadableTopic
from eha_bench.recordings.encodings.decoders import make_decoder
from eha_bench.recordings.encodings.field_path import FieldPath
from eha_bench.recordings.encodings.payloads import Payloads
from eha_bench.recordings.source import TopicRequest
from eha_bench.recordings.track import Column, Stamps

_STAMPS = (
    ("header.stamp.sec", "header.stamp.nanosec"),
    ("stamp.sec", "stamp.nanosec"),
    ("header.stamp.seconds", "header.stamp.nanos"),
    ("stamp.seconds", "stamp.nanos"),
    ("header.timestamp.seconds", "header.timestamp.nanos"),
    ("timestamp.seconds", "timestamp.nanos"),
)

Rows = IndexArray


@dataclass(frozen=True)
class MessageGroup:
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


class BatchDecoder:
    """Decodes batches of one topic, and keeps what it learned about the topic's channels."""

    def __init__(self, wanted: TopicRequest, encoded: Callable[[int], Encoded]) -> None:
        """Decode what is wanted; `encoded` tells how the messages of a channel id are encoded."""
        self._wanted = wanted
        self._encoded = encoded
        self._decoders: dict[int, Decoder] = {}

    @property
    def clock(self) -> Clock | None:
        """Which time stamps the samples; None if they carry their own time."""
        return self._wanted.clock

    @property
    def wanted(self) -> TopicRequest:
        """What is wanted of the topic."""
        return self._wanted

    def decode(self, batch: list[MessageGroup], columns: list[Column]) -> Stamps | None:
        """Write the numbers of a batch into columns (one a field), and return the stamps.

        Raises:
            UnreadableTopic: a message does not fit, or there is no header stamp.
        """
        if len(batch) == 1 and batch[0].rows is None:
            stamps = self._decode(batch[0], columns)
            return None if self.clock is None else stamps
        total = sum(part.payloads.count for part in batch)
        collected = np.empty(total, dtype=np.int64)
        for part in batch:
            targets = [np.empty(part.payloads.count) for _ in columns]
            collected[part.rows] = self._decode(part, targets)
            for column, target in zip(columns, targets, strict=True):
                column[part.rows] = target
        return None if self.clock is None else collected

    def _decode(self, part: MessageGroup, targets: list[Column]) -> Stamps:
        header = self.clock is Clock.HEADER
        if not targets and not header:
            return part.stamps  # only asked when there were messages: any encoding will do
        decoder = self._decoders.get(part.channel)
        if decoder is None:
            decoder = self._decoders[part.channel] = self._make(self._encoded(part.channel))
        if not header:
            decoder.decode(part.payloads, targets)
            return part.stamps
        stamp = [np.empty(part.payloads.count), np.empty(part.payloads.count)]
        decoder.decode(part.payloads, [*targets, *stamp])
        if not (np.isfinite(stamp[0]).all() and np.isfinite(stamp[1]).all()):
            raise UnreadableTopic("some of its messages have no header.stamp")
        return stamp[0].astype(np.int64) * 1_000_000_000 + stamp[1].astype(np.int64)

    def _make(self, encoded: Encoded) -> Decoder:
        fields = self._wanted.fields
        if self.clock is not Clock.HEADER:
            return make_decoder(encoded, fields)
        make_decoder(encoded, fields)  # a wrong field is reported before a missing stamp
        for pair in _STAMPS:
            paths = tuple(FieldPath.parse(text) for text in pair)
            try:
                return make_decoder(encoded, (*fields, *paths))
            except UnreadableTopic:
                continue
        raise UnreadableTopic("its messages have no header.stamp (use clock: log or publish)")

    @staticmethod
    def kinds(decoders: Iterable[BatchDecoder]) -> dict[str, str]:
        """Return the NumPy types that fields were seen with, by several decoders of one topic.

        Raises:
            UnreadableTopic: no message at all has one of the wanted elements.
        """
        inner = [one for decoder in decoders for one in decoder._decoders.values()]
        fields = next((decoder.wanted.fields for decoder in decoders), ())
        kinds: dict[str, str] = {}
        for index, path in enumerate(fields if inner else ()):
            if not any(index in one.found_paths() for one in inner):
                hint = next((text for one in inner if (text := one.hint(path))), "")
                raise UnreadableTopic(f"no message has an element {path}" + (hint and f"; {hint}"))
            for one in inner:
                if index in one.kinds():
                    kinds[str(path)] = one.kinds()[index]
        return kinds


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
