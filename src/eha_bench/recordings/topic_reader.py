"""Collects one topic's messages into a track, batch after batch."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from eha_bench.recordings.batch_decoder import BatchDecoder, MessageGroup
from eha_bench.recordings.channel_map import Clock
from eha_bench.recordings.encodings.decoder import Encoded, UnreadableTopic
from eha_bench.recordings.source import Source, TopicRequest
from eha_bench.recordings.track import Arena, GrowingArray, StampColumn, Track


class TopicReader:
    """Grows a track from batches of messages of one topic."""

    def __init__(
        self,
        topic: str,
        wanted: TopicRequest,
        encoded: Callable[[int], Encoded],
        expected: int = 0,
        arena: Arena | None = None,
        leader: Callable[[], StampColumn | None] = lambda: None,
    ) -> None:
        """Expect so many messages, to be kept in the arena.

        `encoded` tells how the messages of a channel id are encoded, `leader` whose stamps these
        may be the same as.
        """
        self._topic = topic
        self._decoder = BatchDecoder(wanted, encoded)
        memory = arena or Arena()
        self._columns = [GrowingArray(memory.take(expected)) for _ in wanted.fields]
        self._expected = expected
        self._leader = leader
        self._stamps: StampColumn | None = None

    @property
    def clock(self) -> Clock | None:
        """Which time stamps the samples; None if they carry their own time."""
        return self._decoder.clock

    def extend(self, batch: list[MessageGroup]) -> None:
        """Add messages that lie together in the log; the rows of all parts are 0 .. n-1.

        Raises:
            UnreadableTopic: a message does not fit, or there is no header stamp.
        """
        total = sum(part.payloads.count for part in batch)
        stamps = self._decoder.decode(batch, [column.extend(total) for column in self._columns])
        if stamps is not None:
            self.stamps.extend(stamps)

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
        kinds = BatchDecoder.kinds([self._decoder])
        stamps = np.empty(0, np.int64) if self.clock is None else self.stamps.finish()
        columns = [column.finish() for column in self._columns]
        names = [str(path) for path in self._decoder.wanted.fields]
        return Track(self._topic, stamps, dict(zip(names, columns, strict=True)), kinds)


def finished_tracks(source: Source, readers: Mapping[str, TopicReader]) -> dict[str, Track]:
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
