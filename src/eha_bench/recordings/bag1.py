"""ROS 1 bags (format 2.0), found by a linear scan that stops at a tear.

Format: https://wiki.ros.org/Bags/Format/2.0
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.blobs import Connection, collect
from eha_bench.recordings.channel_map import Clock
from eha_bench.recordings.decoder import Encoded
from eha_bench.recordings.decompress import DamagedChunk, decompress, decompress_torn
from eha_bench.recordings.mcap_file import map_file
from eha_bench.recordings.source import Source, Span, Topic, Wanted
from eha_bench.recordings.track import Track

_MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK = 2, 5
_LENGTH = struct.Struct("<I")

Fields = dict[str, bytes]


class Bag1Source(Source):
    """An opened ROS 1 bag."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._buffer = map_file(path)
        self._notes: list[str] = []
        self._damaged = False
        if bytes(self._buffer[: len(_MAGIC)]) != _MAGIC:
            version = bytes(self._buffer[:13]).decode("latin-1").strip()
            raise RecordingError(
                f"this bag is of another version ({version})",
                where=Place(file=str(path)),
                hint="migrate it with 'rosbag fix'",
            )
        self._connections: dict[int, Connection] = {}
        self._chunks: list[tuple[int, Fields, memoryview, bool]] = []
        self._loose: list[tuple[Fields, memoryview]] = []
        self._scan()

    @property
    def path(self) -> str:
        """The file, for messages."""
        return str(self._path)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found so far: a tear, damaged chunks."""
        return tuple(dict.fromkeys(self._notes))

    @property
    def damaged(self) -> bool:
        """Whether something of it was lost."""
        return self._damaged

    @property
    def format(self) -> str:
        """`rosbag1`."""
        return "rosbag1"

    def topics(self) -> tuple[Topic, ...]:
        """The topics of the bag."""
        found: dict[str, Topic] = {}
        for connection in self._connections.values():
            found.setdefault(connection.topic, Topic(connection.topic, connection.encoded))
        return tuple(found.values())

    def tracks(self, wanted: Mapping[str, Wanted], span: Span | None = None) -> dict[str, Track]:
        """Return the samples of the wanted topics, in order of their chunks' times.

        Raises:
            RecordingError: a topic cannot be decoded, or another clock than log is asked for.
        """
        del span  # all of it has to be decoded anyway
        for topic, what in wanted.items():
            if what.clock is Clock.PUBLISH:
                raise RecordingError(
                    "a ROS 1 bag does not hold the time of publishing",
                    where=Place(file=self.path, topic=topic),
                    hint="use clock: log or header",
                )
        return collect(self, wanted, self._connections, self._messages(set(wanted)))

    def _messages(self, topics: set[str]) -> Iterator[tuple[int, int, bytes]]:
        ids = {c.id for c in self._connections.values() if c.topic in topics}
        runs: list[list[tuple[int, int, bytes]]] = []
        for fields, data in self._records_with_messages():
            del fields
            run = [message for message in data if message[0] in ids]
            if run:
                runs.append(run)
        starts = [min(stamp for _, stamp, _ in run) for run in runs]
        stops = [max(stamp for _, stamp, _ in run) for run in runs]
        order = sorted(range(len(runs)), key=starts.__getitem__)
        apart = all(stops[a] <= starts[b] for a, b in pairwise(order))
        if apart and order != list(range(len(runs))):
            self._notes.append("its chunks are not in order of time; they were read in order")
        for index in order if apart else range(len(runs)):
            yield from runs[index]

    def _records_with_messages(self) -> Iterator[tuple[int, list[tuple[int, int, bytes]]]]:
        for offset, fields, data, torn in self._chunks:
            content = self._open(offset, fields, data, torn)
            if content is not None:
                found, _ = _records(content, 0)
                yield offset, [m for m in map(_message, found) if m is not None]
        if self._loose:
            yield 0, [m for m in map(_message, self._loose) if m is not None]

    def _open(self, offset: int, fields: Fields, data: memoryview, torn: bool) -> memoryview | None:
        compression = fields.get("compression", b"").decode("latin-1")
        if torn:
            return decompress_torn(data, compression).data
        try:
            return decompress(data, compression, _u32(fields.get("size", b""))).data
        except DamagedChunk as error:
            self._damaged = True
            self._notes.append(f"the chunk at byte {offset} is lost: {error}")
            return None

    def _scan(self) -> None:
        data = self._buffer.data
        records, end = _records(data, len(_MAGIC))
        size = len(data)
        torn = _torn_chunk(data, end) if end < size else None
        for fields, content in records:
            self._take(fields, content)
        if torn is not None:
            self._chunks.append((end, *torn, True))
        if end < size:
            self._damaged = True
            self._notes.append(
                f"the bag is torn at byte {end}: the last {size - end} bytes "
                f"({100 * (size - end) / size:.2g} % of the file) are not whole; "
                "everything before was read"
            )
        # a bag that was not closed has its connections only inside of the chunks
        for offset, fields, content, is_torn in self._chunks:
            if not self._connections or end < size:
                opened = self._open(offset, fields, content, is_torn)
                for inner, inside in _records(opened, 0)[0] if opened is not None else ():
                    self._take(inner, inside, loose=False)

    def _take(self, fields: Fields, content: memoryview, *, loose: bool = True) -> None:
        match fields.get("op", b"")[:1]:
            case b"\x05":
                self._chunks.append((0, fields, content, False))
            case b"\x07":
                connection = _connection(fields, content)
                if connection is not None:
                    self._connections.setdefault(connection.id, connection)
            case b"\x02" if loose:
                self._loose.append((fields, content))
            case _:
                pass


def _records(data: memoryview, position: int) -> tuple[list[tuple[Fields, memoryview]], int]:
    """Return the records from `position` on, and where the last whole one ends."""
    found = []
    size = len(data)
    while position + 8 <= size:
        head = _LENGTH.unpack_from(data, position)[0]
        middle = position + 4 + head
        if middle + 4 > size:
            break
        fields = _fields(data[position + 4 : middle])
        stop = middle + 4 + _LENGTH.unpack_from(data, middle)[0]
        if fields is None or stop > size:
            break
        found.append((fields, data[middle + 4 : stop]))
        position = stop
    return found, position


def _torn_chunk(data: memoryview, position: int) -> tuple[Fields, memoryview] | None:
    """Return the chunk whose end is missing, if that is what starts at `position`."""
    if position + 4 > len(data):
        return None
    middle = position + 4 + _LENGTH.unpack_from(data, position)[0]
    if middle + 4 > len(data):
        return None
    fields = _fields(data[position + 4 : middle])
    if fields is None or fields.get("op") != bytes([_CHUNK]):
        return None
    return fields, data[middle + 4 :]


def _fields(data: memoryview) -> Fields | None:
    """Return a record's header, or None if it is none."""
    fields: Fields = {}
    position = 0
    while position + 4 <= len(data):
        stop = position + 4 + _LENGTH.unpack_from(data, position)[0]
        name, equals, value = bytes(data[position + 4 : stop]).partition(b"=")
        if stop > len(data) or not equals:
            return None
        fields[name.decode("latin-1")] = value
        position = stop
    return fields if "op" in fields else None


def _connection(fields: Fields, content: memoryview) -> Connection | None:
    inner = _fields_of(content)
    if "conn" not in fields or "topic" not in fields:
        return None
    encoded = Encoded(
        "ros1",
        inner.get("type", b"").decode("utf-8", "replace"),
        "ros1msg",
        inner.get("message_definition", b""),
    )
    return Connection(_u32(fields["conn"]), fields["topic"].decode("utf-8", "replace"), encoded)


def _fields_of(content: memoryview) -> Fields:
    """Return a connection's own header, which has no `op`."""
    marker = b"\x04\x00\x00\x00op=x"
    joined = memoryview(marker + bytes(content))
    return _fields(joined) or {}


def _message(record: tuple[Fields, memoryview]) -> tuple[int, int, bytes] | None:
    fields, content = record
    time = fields.get("time", b"")
    if fields.get("op") != bytes([_MESSAGE]) or "conn" not in fields or len(time) != 8:
        return None
    sec, nsec = struct.unpack("<II", time)
    return _u32(fields["conn"]), sec * 1_000_000_000 + nsec, bytes(content)


def _u32(raw: bytes) -> int:
    return int(_LENGTH.unpack(raw)[0]) if len(raw) == 4 else 0
