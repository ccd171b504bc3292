"""Reads the chunks of a sound recording on two cores, each chunk wholly on one of them.

Only where nothing is out of the ordinary: all chunks whole, their indexes true, every message as
its definition says. Otherwise nothing is returned, and the chunks are read one after the other.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import dataclass

import numpy as np

from eha_bench.recordings.batch_decoder import BatchDecoder, MessageGroup, in_order
from eha_bench.recordings.channel_map import Clock
from eha_bench.recordings.decompress import DamagedChunk, DecompressBuffer
from eha_bench.recordings.encodings.decoder import Encoded, UnreadableTopic
from eha_bench.recordings.encodings.payloads import Payloads
from eha_bench.recordings.mcap.demux import LOG_TIME, PAYLOAD, PUBLISH_TIME, Split, Splitter
from eha_bench.recordings.mcap.file import Chunk
from eha_bench.recordings.source import TopicRequest
from eha_bench.recordings.track import Arena, Column, Stamps, Track

_WORKERS = 2
_FEWEST_CHUNKS = 4

OpenChunk = Callable[[Chunk, Splitter, DecompressBuffer], Split]
"""Decompresses, checks and splits a chunk; raises DamagedChunk."""


class _UnlikeIndex(Exception):
    """A chunk does not hold what its index says."""


@dataclass
class _Target:
    """Where a topic's samples go; `stamps` is None where they are another topic's."""

    wanted: TopicRequest
    columns: list[Column]
    stamps: Stamps | None
    like: str | None


class _Worker:
    """What each thread keeps for itself."""

    def __init__(
        self, wanted: Mapping[str, TopicRequest], encoded: Callable[[int], Encoded]
    ) -> None:
        self.splitter = Splitter()
        self.room = DecompressBuffer()
        self.decoders = {topic: BatchDecoder(what, encoded) for topic, what in wanted.items()}


class ParallelReader:
    """Reads tracks chunk by chunk on several threads into memory that is laid out before."""

    def __init__(
        self,
        chunks: list[Chunk],
        ids: Mapping[int, str],
        wanted: Mapping[str, TopicRequest],
        encoded: Callable[[int], Encoded],
        open_chunk: OpenChunk,
    ) -> None:
        self._chunks = chunks
        self._ids = ids
        self._wanted = wanted
        self._encoded = encoded
        self._open = open_chunk
        self._decoders: dict[str, list[BatchDecoder]] = {topic: [] for topic in wanted}
        self._lock = threading.Lock()

    def tracks(self) -> dict[str, Track] | None:
        """Return the samples of the wanted topics, or None if anything is out of the ordinary."""
        counts = self._counts()
        if counts is None:
            return None
        targets = self._targets(counts)
        starts = {topic: np.cumsum(counts[topic]) - counts[topic] for topic in counts}
        numbers = iter(range(len(self._chunks)))

        def work() -> None:
            """Take one chunk after the other, until there is none or one went wrong."""
            worker = _Worker(self._wanted, self._encoded)
            with self._lock:
                for topic, decoder in worker.decoders.items():
                    self._decoders[topic].append(decoder)
            while True:
                with self._lock:
                    number = next(numbers, None)
                if number is None:
                    return
                try:
                    self._read(number, worker, targets, counts, starts)
                except BaseException:
                    with self._lock:
                        for _ in numbers:
                            pass  # the others stop as well
                    raise

        try:
            with ThreadPoolExecutor(_WORKERS) as pool:
                # each thread spends from the budget of the recording that is being read
                jobs = [pool.submit(copy_context().run, work) for _ in range(_WORKERS)]
                for job in jobs:
                    job.result()
            return self._finish(targets)
        except (_UnlikeIndex, DamagedChunk, UnreadableTopic):
            return None

    def _counts(self) -> dict[str, np.ndarray] | None:
        """Count each topic's messages by chunk; None if an index is missing or cannot be true."""
        if len(self._chunks) < _FEWEST_CHUNKS:
            return None
        counts = {topic: np.zeros(len(self._chunks), dtype=np.int64) for topic in self._wanted}
        for number, chunk in enumerate(self._chunks):
            if chunk.torn or chunk.channels is None:
                return None
            if sum(chunk.channels.values()) * PAYLOAD > chunk.uncompressed_size:
                return None
            for channel, count in chunk.channels.items():
                if channel in self._ids:
                    counts[self._ids[channel]][number] += count
        return counts

    def _targets(self, counts: Mapping[str, np.ndarray]) -> dict[str, _Target]:
        """Lay out the memory; topics with as many messages in every chunk may share stamps."""
        totals = {topic: int(numbers.sum()) for topic, numbers in counts.items()}
        arena = Arena(sum(totals[topic] * len(what.fields) for topic, what in self._wanted.items()))
        targets: dict[str, _Target] = {}
        for topic, what in self._wanted.items():
            columns = [arena.take(totals[topic]) for _ in what.fields]
            like = next(
                (
                    other
                    for other, target in targets.items()
                    if target.stamps is not None
                    and target.wanted.clock is what.clock
                    and np.array_equal(counts[other], counts[topic])
                ),
                None,
            )
            own = what.clock is not None and like is None
            stamps = np.empty(totals[topic], dtype=np.int64) if own else None
            targets[topic] = _Target(what, columns, stamps, like)
        return targets

    def _read(
        self,
        number: int,
        worker: _Worker,
        targets: Mapping[str, _Target],
        counts: Mapping[str, np.ndarray],
        starts: Mapping[str, np.ndarray],
    ) -> None:
        """Read one chunk into its places."""
        found = self._open(self._chunks[number], worker.splitter, worker.room)
        groups: dict[str, list[tuple[int, Payloads]]] = {topic: [] for topic in targets}
        for channel, payloads in found.messages:
            if channel in self._ids:
                groups[self._ids[channel]].append((channel, payloads))
        for topic, target in targets.items():
            members = groups.pop(topic)
            count, start = int(counts[topic][number]), int(starts[topic][number])
            if sum(payloads.count for _, payloads in members) != count:
                raise _UnlikeIndex
            if not count:
                continue
            place = slice(start, start + count)
            delta = PUBLISH_TIME if target.wanted.clock is Clock.PUBLISH else LOG_TIME
            rows = in_order([payloads for _, payloads in members])
            batch = [
                MessageGroup(channel, payloads, where, payloads.column(delta, "<i8"))
                for (channel, payloads), where in zip(members, rows, strict=True)
            ]
            stamps = worker.decoders[topic].decode(
                batch, [column[place] for column in target.columns]
            )
            if stamps is None:
                continue
            if target.stamps is not None:
                target.stamps[place] = stamps
                continue
            leader = targets[target.like].stamps if target.like is not None else None
            if leader is None or not np.array_equal(leader[place], stamps):
                raise _UnlikeIndex

    def _finish(self, targets: Mapping[str, _Target]) -> dict[str, Track]:
        tracks = {}
        for topic, target in targets.items():
            stamps = target.stamps
            if stamps is None:
                leader = targets[target.like].stamps if target.like is not None else None
                stamps = leader if leader is not None else np.empty(0, dtype=np.int64)
            names = [str(path) for path in target.wanted.fields]
            columns = dict(zip(names, target.columns, strict=True))
            kinds = BatchDecoder.kinds(self._decoders[topic])
            tracks[topic] = Track(topic, stamps, columns, kinds)
        return tracks
