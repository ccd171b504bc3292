"""Sources that hand out one message after the other (ROS 1 bags, sqlite3) as tracks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from eha_bench.recordings.decoder import Encoded, UnreadableTopic
from eha_bench.recordings.payloads import Payloads
from eha_bench.recordings.source import Source, Wanted
from eha_bench.recordings.topic_reader import Part, TopicReader, finished
from eha_bench.recordings.track import Track

_BATCH = 8192


@dataclass(frozen=True)
class Connection:
    """A topic as one publisher wrote it."""

    id: int
    topic: str
    encoded: Encoded


def collect(
    source: Source,
    wanted: Mapping[str, Wanted],
    connections: Mapping[int, Connection],
    messages: Iterable[tuple[int, int, bytes]],
) -> dict[str, Track]:
    """Return tracks from (connection id, stamp in ns, payload) in file order.

    Raises:
        RecordingError: a topic cannot be decoded.
    """
    readers = {topic: TopicReader(topic, what) for topic, what in wanted.items()}
    waiting: dict[str, list[tuple[int, int, bytes]]] = {}

    def deliver(topic: str) -> None:
        try:
            readers[topic].extend(
                _parts(waiting.pop(topic)), lambda number: connections[number].encoded
            )
        except UnreadableTopic as error:
            raise source.refuse(topic, error) from error

    for message in messages:
        topic = connections[message[0]].topic
        batch = waiting.setdefault(topic, [])
        batch.append(message)
        if len(batch) >= _BATCH:
            deliver(topic)
    for topic in list(waiting):
        deliver(topic)
    return finished(source, readers)


def _parts(messages: list[tuple[int, int, bytes]]) -> list[Part]:
    """Group messages by connection and size, keeping their places."""
    count = len(messages)
    numbers = np.fromiter((number for number, _, _ in messages), np.int64, count)
    stamps = np.fromiter((stamp for _, stamp, _ in messages), np.int64, count)
    sizes = np.fromiter((len(payload) for _, _, payload in messages), np.int64, count)
    buffer = np.frombuffer(b"".join(payload for _, _, payload in messages), dtype=np.uint8)
    starts = np.cumsum(sizes) - sizes
    parts = []
    for number, size in dict.fromkeys(zip(numbers.tolist(), sizes.tolist(), strict=True)):
        rows = np.flatnonzero((numbers == number) & (sizes == size))
        payloads = Payloads(buffer, int(rows.size), size, starts=starts[rows])
        parts.append(Part(number, payloads, None if rows.size == count else rows, stamps[rows]))
    return parts
