"""The records of ROS 1 bags: a header of named fields, and data.

Format: https://wiki.ros.org/Bags/Format/2.0
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import Bytes
from eha_bench.recordings.bags.blobs import Batch, Connection
from eha_bench.recordings.budget import budget
from eha_bench.recordings.encodings.decoder import Encoded

MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7
_TICK = 4096
_AS_OBJECTS = 160
"""Bytes that a message's four numbers take before they are an array."""
_LENGTH = struct.Struct("<I")
_TIME = struct.Struct("<II")
_INDEX_ENTRY = 12
"""Bytes: a time and a place."""

Fields = dict[str, bytes]


@dataclass(frozen=True)
class Record:
    """A record: where it begins, its header, and where its data start and stop in the buffer."""

    position: int
    op: int
    fields: Fields
    start: int
    stop: int


@dataclass(frozen=True)
class _Shape:
    """What the header of a message looks like: all writers use one shape for all messages.

    Attributes:
        constant: (start, bytes) of what never changes, counted from the record's start.
        connection, time: where the values stand, counted from the record's start.
        size: of the header with its length before it.
    """

    constant: tuple[tuple[int, bytes], ...]
    connection: int
    time: int
    size: int


def walk(data: memoryview, position: int) -> Iterator[Record]:
    """Yield the whole records from `position` on; ends where one does not fit."""
    while position + 8 <= len(data):
        middle = position + 4 + int(_LENGTH.unpack_from(data, position)[0])
        if middle + 4 > len(data):
            return
        fields = header(data[position + 4 : middle])
        stop = middle + 4 + int(_LENGTH.unpack_from(data, middle)[0])
        if fields is None or stop > len(data):
            return
        yield Record(position, fields["op"][0], fields, middle + 4, stop)
        position = stop


@dataclass(frozen=True)
class RecordsFound:
    """What was found among the records of a chunk, or of the file itself.

    Attributes:
        batch: the messages.
        connections: what was declared among them.
        stop: where the last whole record ends.
    """

    batch: Batch
    connections: tuple[Connection, ...]
    stop: int


def messages(buffer: Bytes, position: int = 0) -> RecordsFound:
    """Return all messages among the records from `position` on, up to one that does not fit.

    Raises:
        OverBudget: there are too many of them.
    """
    allowed = budget()
    declared: list[Connection] = []
    data = buffer.data
    connections: list[int] = []
    stamps: list[int] = []
    starts: list[int] = []
    sizes: list[int] = []
    shape: _Shape | None = None
    size = len(data)
    while position + 8 <= size:
        if shape is None or not _has_shape(data, position, shape):
            record = next(walk(data, position), None)
            if record is None:
                break
            shape = _shape(data, position) if record.op == MESSAGE else shape
            if record.op == CONNECTION:
                found = connection(record, data)
                declared += [found] if found is not None else []
            if record.op != MESSAGE or shape is None:
                position = record.stop
                continue
        middle = position + shape.size
        if middle + 4 > size:
            break
        length = _LENGTH.unpack_from(data, middle)[0]
        if middle + 4 + length > size:
            break
        seconds, nanoseconds = _TIME.unpack_from(data, position + shape.time)
        connections.append(_LENGTH.unpack_from(data, position + shape.connection)[0])
        stamps.append(seconds * 1_000_000_000 + nanoseconds)
        starts.append(middle + 4)
        sizes.append(length)
        position = middle + 4 + length
        if not len(sizes) % _TICK:
            allowed.tick()
            allowed.hold(_AS_OBJECTS * len(sizes), "its messages")
    batch = Batch(
        buffer,
        np.array(connections, dtype=np.int64),
        np.array(stamps, dtype=np.int64),
        np.array(starts, dtype=np.int64),
        np.array(sizes, dtype=np.int64),
    )
    return RecordsFound(batch, tuple(declared), position)


def _has_shape(data: memoryview, position: int, shape: _Shape) -> bool:
    return all(
        data[position + start : position + start + len(raw)] == raw for start, raw in shape.constant
    )


def _shape(data: memoryview, position: int) -> _Shape | None:
    """Return the shape of the message's header at `position`, None if it lacks a field."""
    size = 4 + int(_LENGTH.unpack_from(data, position)[0])
    head = bytes(data[position : position + size])
    connection = head.find(b"\x09\0\0\0conn=") + 9
    time = head.find(b"\x0d\0\0\0time=") + 9
    if connection < 9 or time < 9:
        return None
    edges = sorted([(connection, connection + 4), (time, time + 8)])
    constant = (
        (0, head[: edges[0][0]]),
        (edges[0][1], head[edges[0][1] : edges[1][0]]),
        (edges[1][1], head[edges[1][1] :]),
    )
    return _Shape(tuple((start, raw) for start, raw in constant if raw), connection, time, size)


def torn_chunk(data: memoryview, position: int) -> Record | None:
    """Return the chunk whose end is missing, if that is what starts at `position`."""
    if position + 4 > len(data):
        return None
    middle = position + 4 + int(_LENGTH.unpack_from(data, position)[0])
    if middle + 4 > len(data):
        return None
    fields = header(data[position + 4 : middle])
    if fields is None or fields["op"] != bytes([CHUNK]):
        return None
    return Record(position, CHUNK, fields, middle + 4, len(data))


def header(data: memoryview, *, inner: bool = False) -> Fields | None:
    """Return the fields of a header, or None if it is none; an inner one has no `op`."""
    fields: Fields = {}
    position = 0
    while position + 4 <= len(data):
        stop = position + 4 + int(_LENGTH.unpack_from(data, position)[0])
        name, equals, value = bytes(data[position + 4 : stop]).partition(b"=")
        if stop > len(data) or not equals:
            return None
        fields[name.decode("latin-1")] = value
        position = stop
    return fields if inner or len(fields.get("op", b"")) == 1 else None


def connection(record: Record, data: memoryview) -> Connection | None:
    """Return what a connection record says, or None if it says too little."""
    inner = header(data[record.start : record.stop], inner=True) or {}
    number = record.fields.get("conn", b"")
    if len(number) != 4 or "topic" not in record.fields:
        return None
    encoded = Encoded(
        "ros1",
        inner.get("type", b"").decode("utf-8", "replace"),
        "ros1msg",
        inner.get("message_definition", b""),
    )
    topic = record.fields["topic"].decode("utf-8", "replace")
    return Connection(u32(number), topic, encoded)


def index_problem(record: Record) -> str:
    """Return how the count of an index record differs from what it lists, empty if it does not."""
    declared, there = u32(record.fields.get("count", b"")), record.stop - record.start
    if declared * _INDEX_ENTRY == there:
        return ""
    return (
        f"the index at byte {record.start} counts {declared} messages and lists "
        f"{there // _INDEX_ENTRY}"
    )


def chunk_counts(record: Record, data: memoryview) -> dict[int, int]:
    """Return how many messages of each connection a chunk info record tells of."""
    pairs = np.frombuffer(
        data[record.start : record.stop - (record.stop - record.start) % 8], "<u4"
    )
    return dict(zip(pairs[::2].tolist(), pairs[1::2].tolist(), strict=True))


def chunk_times(record: Record) -> tuple[int, tuple[int, int]] | None:
    """Return (position of a chunk, (first, last stamp in ns)) of a chunk info record."""
    place = record.fields.get("chunk_pos", b"")
    times = [record.fields.get(name, b"") for name in ("start_time", "end_time")]
    if len(place) != 8 or any(len(time) != 8 for time in times):
        return None
    first, last = (
        seconds * 1_000_000_000 + nanoseconds for seconds, nanoseconds in map(_TIME.unpack, times)
    )
    return int.from_bytes(place, "little"), (first, last)


def u32(raw: bytes) -> int:
    """Return a field of four bytes as a number, 0 if it has another length."""
    return int(_LENGTH.unpack(raw)[0]) if len(raw) == 4 else 0
