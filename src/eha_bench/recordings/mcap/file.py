"""The records of an MCAP file, found by a linear scan that stops at a tear.

Format: https://mcap.dev/spec. Only the frame of each record is read here; contents are parsed by
the mcap library. The index at the end is not trusted and not needed: a torn file has none.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from numpy.typing import NDArray

from eha_bench.core.arrays import Bytes
from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.checksum import crc32
from eha_bench.recordings.file_bytes import forget, map_file
from eha_bench.recordings.mcap.demux import RECORD_HEAD
from eha_bench.recordings.naming import printable

MAGIC = b"\x89MCAP0\r\n"
_FRAME = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQII")
_CHUNK_INDEX = struct.Struct("<QQQQ")
_FOOTER = struct.Struct("<QQI")


@dataclass(slots=True)
class Chunk:
    """A chunk's frame.

    `channels` counts messages by channel id, None if no index tells; the index stands in the file
    from `index_start` to `index_stop`.
    """

    offset: int
    start_time: int
    end_time: int
    uncompressed_size: int
    crc: int
    compression: str
    data_start: int
    data_size: int
    channels: dict[int, int] | None = None
    index_start: int = 0
    index_stop: int = 0
    torn: bool = False


@dataclass
class BareMessages:
    """Messages that lie outside of chunks: from `start` up to `stop`."""

    start: int
    stop: int


@dataclass
class McapFile:
    """What a scan of an MCAP file found.

    Attributes:
        buffer: the file's bytes.
        parts: chunks and stretches of bare messages, in file order.
        schemas, channels: by id; those inside chunks are not in here until a chunk is opened.
        data_ended: whether the data section was closed; a summary may follow.
        summary_channels: whether the summary repeated the channels, so that chunks can be skipped.
        attachments: (start of content, length).
        shared: messages by channel id, of chunks that hold the same.
        data_stop, data_crc: where the data section ends, and its checksum (0 if there is none).
        footer: where it stands, start of the summary, start of its offsets, checksum.
        statistics: what the file says that it holds.
        chunk_index: offsets of the chunks that the summary knows.
        attachment_names, metadata_names: what the summary knows of these.
        conflicts: channels and schemas whose id is declared twice, in other words: id of the
            channel (None for a schema), id of the schema (None for a channel), and a sentence.
        holes: (start, stop) of bytes between chunks that are not whole records.
        tear: where the readable part ends, or None for a file that was closed in order.
        reason: what is wrong at the tear.
    """

    path: Path
    buffer: Bytes
    header: Header | None = None
    parts: list[Chunk | BareMessages] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    summary_channels: bool = False
    data_ended: bool = False
    metadata: list[Metadata] = field(default_factory=list)
    attachments: list[tuple[int, int]] = field(default_factory=list)
    shared: dict[tuple[tuple[int, int], ...], dict[int, int]] = field(default_factory=dict)
    data_stop: int = 0
    data_crc: int = 0
    footer: tuple[int, int, int, int] | None = None
    statistics: Statistics | None = None
    chunk_index: set[int] = field(default_factory=set)
    attachment_names: list[str] = field(default_factory=list)
    metadata_names: list[str] = field(default_factory=list)
    conflicts: dict[tuple[int | None, int | None], str] = field(default_factory=dict)
    holes: list[tuple[int, int]] = field(default_factory=list)
    tear: int | None = None
    reason: str = ""

    def attachment(self, start: int, length: int) -> Attachment | None:
        """Return an attachment, or None if it cannot be parsed."""
        found = self.parse(Attachment, start, length)
        return found if isinstance(found, Attachment) else None

    def attachment_checks(self) -> Iterator[tuple[str, bool]]:
        """Yield the name of every attachment, and whether its checksum is right or missing."""
        for start, length in self.attachments:
            found = self.attachment(start, length)
            yield (found.name if found else "?"), found is not None and self.sound(start, length)

    def sound(self, start: int, length: int) -> bool:
        """Whether the checksum of an attachment is right; one that has none cannot be wrong."""
        content = self.buffer.data[start : start + length]
        crc = int.from_bytes(content[-4:], "little")
        return not crc or crc32(content[:-4]) == crc

    def parse(self, kind: Any, start: int, length: int) -> Any:
        """Return a record's content as the mcap library's type, or None if it does not fit."""
        return parse_record(kind, bytes(self.buffer.data[start : start + length]))


def message_index(file: McapFile, chunk: Chunk) -> dict[int, NDArray[np.int64]]:
    """Return where the records of each channel are declared to start in a chunk."""
    data = file.buffer.data
    found: dict[int, NDArray[np.int64]] = {}
    position = chunk.index_start
    while position + RECORD_HEAD + 6 <= chunk.index_stop:
        opcode, length = _FRAME.unpack_from(data, position)
        start = position + RECORD_HEAD
        if opcode == Opcode.MESSAGE_INDEX and length >= 6:
            channel, size = struct.unpack_from("<HI", data, start)
            count = min(size, length - 6) // 16
            table = np.frombuffer(data, "<i8", 2 * count, start + 6)
            offsets = table[1::2].copy()
            found[channel] = np.append(found[channel], offsets) if channel in found else offsets
        position = start + length
    return found


def parse_record(kind: Any, content: bytes) -> Any:
    """Return a record as the mcap library's type, or None if the content does not fit."""
    try:
        return kind.read(ReadDataStream(BytesIO(content)))
    except Exception:  # struct.error, EndOfFile, UnicodeDecodeError, ...
        return None


def open_mcap(path: Path) -> McapFile:
    """Scan an MCAP file's frames; chunks stay as they are.

    Raises:
        RecordingError: the file is not MCAP.
    """
    buffer = map_file(path)
    if bytes(buffer[:8]) != MAGIC:
        raise RecordingError(
            "this is not an MCAP file",
            where=Place(file=str(path)),
            hint="only MCAP files can be read as such, and recovered",
        )
    file = McapFile(path, buffer)
    _scan(file)
    forget(buffer, 0, buffer.size)
    return file


def _scan(file: McapFile) -> None:
    """Follow the records; where one is broken, look for the next chunk behind it."""
    position = len(MAGIC)
    search = _ChunkSearch(file.buffer)
    while True:
        position, reason = _follow(file, position)
        _intern(file)
        if not reason:
            return
        found = search.behind(position + 1)
        _salvage(file, position, file.buffer.size if found is None else found)
        if found is None:
            file.tear, file.reason = position, reason
            return
        file.holes.append((position, found))
        position = found


def _follow(file: McapFile, position: int) -> tuple[int, str]:
    """Take records from `position` on; return where and why it ended, '' at a proper end."""
    data = file.buffer.data
    size = file.buffer.size
    scanned = position
    while True:
        if position + RECORD_HEAD > size:
            return position, "the file ends without a footer"
        opcode, length = _FRAME.unpack_from(data, position)
        start = position + RECORD_HEAD
        following = start + length
        if opcode == 0:
            return position, "there are no more records"
        if following > size:
            return position, "the file ends inside a record"
        if opcode == Opcode.FOOTER:
            if length >= _FOOTER.size:
                file.footer = (position, *_FOOTER.unpack_from(data, start))
            whole = bytes(data[following : following + 8]) == MAGIC
            return following, "" if whole else "the closing magic is missing"
        if opcode == Opcode.CHUNK:
            _intern(file)
            forget(file.buffer, scanned, position)
            scanned = position
            if not _add_chunk(file, position, start, following):
                return position, "a chunk's frame is damaged"
        else:
            _take(file, opcode, start, length)
        position = following


def _salvage(file: McapFile, position: int, stop: int) -> None:
    """Keep the chunk that starts at `position`, if it is one, although it is not whole."""
    if position < stop and file.buffer[position] == Opcode.CHUNK:
        _add_chunk(file, position, position + RECORD_HEAD, stop, torn=True)


class _ChunkSearch:
    """Looks for chunks by the name of their compression; every byte is looked at once only."""

    _MARKS = (b"\x04\0\0\0zstd", b"\x03\0\0\0lz4")

    def __init__(self, buffer: Bytes) -> None:
        self._buffer = buffer
        self._next: dict[bytes, int] = dict.fromkeys(self._MARKS, -1)
        """Where the next sound frame of each compression starts; the end if there is none."""

    def behind(self, start: int) -> int | None:
        """Return where the next chunk with a sound frame starts."""
        for mark, known in self._next.items():
            if known < start:
                self._next[mark] = self._frame(start, mark)
        found = min(self._next.values())
        return None if found >= self._buffer.size else found

    def _frame(self, start: int, mark: bytes) -> int:
        whole = self._buffer.data
        size = self._buffer.size
        before = RECORD_HEAD + _CHUNK.size - 4
        for at in _places(self._buffer, mark, start + before):
            place = at - before
            if whole[place] != Opcode.CHUNK:
                continue
            _, length = _FRAME.unpack_from(whole, place)
            records = at + len(mark)
            if records + 8 <= place + RECORD_HEAD + length <= size:
                declared = int.from_bytes(whole[records : records + 8], "little")
                if records + 8 + declared == place + RECORD_HEAD + length:
                    return place
        return size


def _places(buffer: Bytes, mark: bytes, start: int) -> Iterator[int]:
    """Yield where `mark` stands at or behind `start`."""
    step = 1 << 20
    for begin in range(start, buffer.size, step):
        piece = bytes(buffer.data[begin : begin + step + len(mark) - 1])
        at = piece.find(mark)
        while at >= 0:
            yield begin + at
            at = piece.find(mark, at + 1)


def _intern(file: McapFile) -> None:
    """Let chunks that hold the same share their list of channels: a long log has many chunks."""
    last = file.parts[-1] if file.parts else None
    if isinstance(last, Chunk) and last.channels is not None:
        key = tuple(last.channels.items())
        last.channels = file.shared.setdefault(key, last.channels)


def _take(file: McapFile, opcode: int, start: int, length: int) -> None:
    """Note a record that is not a chunk."""
    last = file.parts[-1] if file.parts else None
    match opcode:
        case Opcode.MESSAGE:
            if isinstance(last, BareMessages) and last.stop == start - RECORD_HEAD:
                last.stop = start + length
            else:
                file.parts.append(BareMessages(start - RECORD_HEAD, start + length))
        case Opcode.MESSAGE_INDEX if isinstance(last, Chunk) and length >= 6:
            channel, entries = struct.unpack_from("<HI", file.buffer.data, start)
            last.channels = last.channels if last.channels is not None else {}
            count = min(entries, length - 6) // 16
            last.channels[channel] = last.channels.get(channel, 0) + count
            last.index_start = last.index_start or start - RECORD_HEAD
            last.index_stop = start + length
        case Opcode.SCHEMA:
            add_schema(file, start, length, file.buffer)
        case Opcode.CHANNEL:
            file.summary_channels |= file.data_ended
            add_channel(file, start, length, file.buffer)
        case Opcode.METADATA:
            found = file.parse(Metadata, start, length)
            if found is not None:
                file.metadata.append(found)
        case Opcode.ATTACHMENT:
            file.attachments.append((start, length))
        case Opcode.HEADER:
            file.header = file.parse(Header, start, length)
        case Opcode.DATA_END:
            file.data_ended = True
            file.data_stop = start - RECORD_HEAD
            if length >= 4:
                file.data_crc = int.from_bytes(file.buffer.data[start : start + 4], "little")
        case Opcode.STATISTICS | Opcode.CHUNK_INDEX | Opcode.ATTACHMENT_INDEX:
            _take_index(file, opcode, start, length)
        case Opcode.METADATA_INDEX:
            _take_index(file, opcode, start, length)
        case _:
            pass


def _take_index(file: McapFile, opcode: int, start: int, length: int) -> None:
    """Note what the summary says that the file holds."""
    match opcode:
        case Opcode.STATISTICS:
            file.statistics = file.parse(Statistics, start, length)
        case Opcode.CHUNK_INDEX:
            if length >= _CHUNK_INDEX.size:
                file.chunk_index.add(_CHUNK_INDEX.unpack_from(file.buffer.data, start)[2])
        case Opcode.ATTACHMENT_INDEX:
            attachment = file.parse(AttachmentIndex, start, length)
            file.attachment_names.append(attachment.name if attachment else "?")
        case _:
            metadata = file.parse(MetadataIndex, start, length)
            file.metadata_names.append(metadata.name if metadata else "?")


def add_schema(file: McapFile, start: int, length: int, buffer: Bytes) -> None:
    """Note a schema; one of id 0 or one that cannot be parsed is ignored."""
    schema = parse_record(Schema, bytes(buffer.data[start : start + length]))
    if schema is None or not schema.id:
        return
    known = file.schemas.setdefault(schema.id, schema)
    if known != schema:
        file.conflicts[None, schema.id] = (
            f"schema {schema.id} is declared twice, as '{printable([known.name])}' and "
            f"'{printable([schema.name])}': its topics are not read"
        )


def add_channel(file: McapFile, start: int, length: int, buffer: Bytes) -> None:
    """Note a channel; one that cannot be parsed is ignored."""
    channel = parse_record(Channel, bytes(buffer.data[start : start + length]))
    if channel is None:
        return
    known = file.channels.setdefault(channel.id, channel)
    if known != channel:
        file.conflicts[channel.id, None] = (
            f"channel {channel.id} is declared twice, as '{printable([known.topic])}' and "
            f"'{printable([channel.topic])}': its messages are not read"
        )


def _add_chunk(file: McapFile, position: int, start: int, stop: int, torn: bool = False) -> bool:
    data = file.buffer.data
    if start + _CHUNK.size > stop:
        return False
    start_time, end_time, uncompressed, crc, name_size = _CHUNK.unpack_from(data, start)
    name_start = start + _CHUNK.size
    content = name_start + name_size + 8
    if name_size > 64 or content > stop:
        return False
    compression = sys.intern(
        bytes(data[name_start : name_start + name_size]).decode("utf-8", "replace")
    )
    declared = struct.unpack_from("<Q", data, name_start + name_size)[0]
    if not torn and content + declared > stop:
        return False
    data_size = stop - content if torn else declared
    file.parts.append(
        Chunk(
            position, start_time, end_time, uncompressed, crc, compression, content, data_size,
            torn=torn,
        )
    )  # fmt: skip
    return True
