"""ROS 1 bags (format 2.0) as a source: a linear scan that stops at a tear."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from eha_bench.core.arrays import Bytes
from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.bags.bag1_records import (
    BAG_HEADER,
    CHUNK,
    CHUNK_INFO,
    CONNECTION,
    INDEX,
    MESSAGE,
    Record,
    RecordsFound,
    chunk_counts,
    chunk_times,
    connection,
    index_problem,
    messages,
    torn_chunk,
    u32,
    walk,
)
from eha_bench.recordings.bags.bag_file import BagFile
from eha_bench.recordings.bags.blobs import Batch, Connection
from eha_bench.recordings.decompress import DamagedChunk, decompress, decompress_torn
from eha_bench.recordings.file_bytes import map_file
from eha_bench.recordings.naming import printable

_MAGIC = b"#ROSBAG V2.0\n"


class Bag1Source(BagFile):
    """An opened ROS 1 bag."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._buffer = map_file(path)
        if bytes(self._buffer[: len(_MAGIC)]) != _MAGIC:
            version = bytes(self._buffer[:13]).decode("latin-1").strip()
            raise RecordingError(
                f"this bag is of another version ({version})",
                where=Place(file=str(path)),
                hint="migrate it with 'rosbag fix'",
            )
        self._chunks: list[tuple[Record, bool]] = []
        self._times: dict[int, tuple[int, int]] = {}
        self._counts: dict[int, dict[int, int]] = {}
        self._loose = False
        self._scan()

    @property
    def format(self) -> str:
        """`rosbag1`."""
        return "rosbag1"

    def _batches(self, topics: set[str]) -> Iterator[Batch]:
        """Yield all messages chunk by chunk, in order of time if chunks do not overlap."""
        del topics  # those of all are in every chunk
        if self._loose:
            yield messages(self._buffer, len(_MAGIC)).batch
        for record, torn in self._in_order():
            content = self._open(record, torn)
            if content is None:
                continue
            found = messages(content)
            self._compare(record, content.size, found, torn=torn)
            yield found.batch

    def _compare(self, record: Record, size: int, found: RecordsFound, *, torn: bool) -> None:
        """Note where a chunk does not hold what the bag's index counts."""
        for one in found.connections:
            self._declare(one)
        if torn:
            return
        name = f"the chunk at byte {record.start}"
        if found.stop < size:
            self._damaged = True
            self._notes.append(f"{name} holds {size - found.stop} bytes that are not records")
        declared = self._counts.get(record.position)
        if declared is None:
            return
        numbers, counts = np.unique(found.batch.connections, return_counts=True)
        there = dict(zip(numbers.tolist(), counts.tolist(), strict=True))
        if there != {number: count for number, count in declared.items() if count}:
            self._damaged = True
            self._notes.append(
                f"{name} does not hold what its index counts: {sum(there.values())} messages, not "
                f"{sum(declared.values())}"
                if sum(there.values()) != sum(declared.values())
                else f"{name} does not hold what its index counts: its messages are of other topics"
            )

    def _declare(self, found: Connection) -> None:
        known = self._connections.setdefault(found.id, found)
        if (known.topic, known.encoded) != (found.topic, found.encoded):
            self._damaged = True
            self._conflicts.add(known.topic)
            self._notes.append(
                f"connection {found.id} is declared twice, as '{printable([known.topic])}' and "
                f"'{printable([found.topic])}': its messages are not read"
            )

    def _in_order(self) -> list[tuple[Record, bool]]:
        times = [self._times.get(record.position) for record, _ in self._chunks]
        known = [time for time in times if time is not None]
        if len(known) < len(times) or known == sorted(known):
            return self._chunks
        order = sorted(range(len(known)), key=known.__getitem__)
        if any(known[a][1] > known[b][0] for a, b in pairwise(order)):
            return self._chunks
        self._notes.append("its chunks are not in order of time; they were read in order")
        return [self._chunks[index] for index in order]

    def _open(self, record: Record, torn: bool) -> Bytes | None:
        data = self._buffer.data[record.start : record.stop]
        compression = record.fields.get("compression", b"").decode("latin-1")
        if torn:
            return decompress_torn(data, compression)
        try:
            return decompress(data, compression, u32(record.fields.get("size", b"")))
        except DamagedChunk as error:
            self._damaged = True
            self._notes.append(f"the chunk at byte {record.start} is lost: {error}")
            return None

    def _scan(self) -> None:
        data = self._buffer.data
        end = len(_MAGIC)
        for record in walk(data, end):
            self._take(record, data)
            end = record.stop
        self._check_counts(data)
        size = len(data)
        torn = torn_chunk(data, end) if end < size else None
        if torn is not None:
            self._chunks.append((torn, True))
        if end < size:
            self._damaged = True
            self._notes.append(
                f"the bag is torn at byte {end}: the last {size - end} bytes "
                f"({100 * (size - end) / size:.2g} % of the file) are not whole; "
                "everything before was read"
            )
        # a bag that was not closed has its connections only inside of the chunks
        for record, is_torn in self._chunks if end < size or not self._connections else ():
            content = self._open(record, is_torn)
            if content is None:
                continue
            for inner in walk(content.data, 0):
                if inner.op == CONNECTION:
                    self._take(inner, content.data)

    def _check_counts(self, data: memoryview) -> None:
        """Note where the bag's header tells of other chunks and connections than there are."""
        head = next(walk(data, len(_MAGIC)), None)
        if (
            head is None
            or head.op != BAG_HEADER
            or not head.fields.get("index_pos", b"").strip(b"\0")
        ):
            return  # a bag that was not closed tells nothing
        for what, field, there in (
            ("chunks", "chunk_count", len(self._chunks)),
            ("connections", "conn_count", len(self._connections)),
        ):
            declared = head.fields.get(field, b"")
            if len(declared) == 4 and u32(declared) != there:
                self._damaged = True
                self._notes.append(f"its header counts {u32(declared)} {what}, it holds {there}")

    def _take(self, record: Record, data: memoryview) -> None:
        if record.op == CHUNK:
            self._chunks.append((record, False))
        elif record.op == CONNECTION:
            found = connection(record, data)
            if found is not None:
                self._declare(found)
        elif record.op == CHUNK_INFO:
            times = chunk_times(record)
            if times is not None:
                self._times[times[0]] = times[1]
                self._counts[times[0]] = chunk_counts(record, data)
        elif record.op == INDEX:
            problem = index_problem(record)
            if problem:
                self._damaged = True
                self._notes.append(problem)
        elif record.op == MESSAGE:
            self._loose = True
