"""Messages that come in batches of one buffer each (ROS 1 bags, sqlite3), as tracks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.arrays import Bytes
from eha_bench.recordings.batch_decoder import MessageGroup
from eha_bench.recordings.encodings.decoder import Encoded, UnreadableTopic
from eha_bench.recordings.encodings.payloads import Payloads
from eha_bench.recordings.source import Source, TopicRequest
from eha_bench.recordings.topic_reader import TopicReader, finished_tracks
from eha_bench.recordings.track import Track


@dataclass(frozen=True)
class Connection:
    """A topic as one publisher wrote it."""

    id: int
    topic: str
    encoded: Encoded


@dataclass(frozen=True)
class Batch:
    """Messages that lie in one buffer, in order; each array (n,).

    Attributes:
        buffer: the bytes.
        connections: connection ids.
        stamps: ns.
        starts: where the payloads start.
        sizes: bytes of the payloads.
    """

    buffer: Bytes
    connections: NDArray[np.int64]
    stamps: NDArray[np.int64]
    starts: NDArray[np.int64]
    sizes: NDArray[np.int64]

    def parts(self, connections: list[int]) -> list[MessageGroup]:
        """Return the messages of some connections, grouped by connection and size."""
        mine = np.isin(self.connections, connections)
        count = int(np.count_nonzero(mine))
        numbers, stamps = self.connections[mine], self.stamps[mine]
        starts, sizes = self.starts[mine], self.sizes[mine]
        parts = []
        for number in np.unique(numbers).tolist():
            for size in np.unique(sizes[numbers == number]).tolist():
                rows = np.flatnonzero((numbers == number) & (sizes == size))
                payloads = Payloads(self.buffer, int(rows.size), size, starts=starts[rows])
                whole = rows.size == count
                parts.append(MessageGroup(number, payloads, None if whole else rows, stamps[rows]))
        return parts


def batch_of(connections: list[int], stamps: list[int], payloads: list[bytes]) -> Batch:
    """Return messages that come one by one as a batch."""
    sizes = np.fromiter((len(payload) for payload in payloads), np.int64, len(payloads))
    return Batch(
        np.frombuffer(b"".join(payloads), dtype=np.uint8),
        np.array(connections, dtype=np.int64),
        np.array(stamps, dtype=np.int64),
        np.cumsum(sizes) - sizes,
        sizes,
    )


def collect(
    source: Source,
    wanted: Mapping[str, TopicRequest],
    connections: Mapping[int, Connection],
    batches: Iterable[Batch],
) -> dict[str, Track]:
    """Return tracks from batches in file order.

    Raises:
        RecordingError: a topic cannot be decoded.
    """
    readers = {
        topic: TopicReader(topic, what, lambda number: connections[number].encoded)
        for topic, what in wanted.items()
    }
    ids: dict[str, list[int]] = {topic: [] for topic in wanted}
    for connection in connections.values():
        if connection.topic in ids:
            ids[connection.topic].append(connection.id)
    for batch in batches:
        for topic, reader in readers.items():
            parts = batch.parts(ids[topic])
            if not parts:
                continue
            try:
                reader.extend(parts)
            except UnreadableTopic as error:
                raise source.refuse(topic, error) from error
    return finished_tracks(source, readers)
