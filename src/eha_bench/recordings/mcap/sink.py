"""Writes MCAP: chunks that are already built, with the indexes that every other reader expects.

Format: https://mcap.dev/spec. Small records are written by the mcap library.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from typing import Any, BinaryIO, Final

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from eha_bench.recordings.checksum import crc32
from eha_bench.recordings.mcap.file import MAGIC

LIBRARY: Final = "eha-bench"
_CHUNK_HEAD = struct.Struct("<BQQQQII")
_RECORD_HEAD = struct.Struct("<BQ")
_INDEX_HEAD = struct.Struct("<BQHI")
_ENTRY = np.dtype([("time", "<u8"), ("offset", "<u8")])

Index = dict[int, tuple[np.ndarray, np.ndarray]]
"""Channel id -> (log times, offsets of the records in the chunk), both (n,)."""


@dataclass(frozen=True)
class Compressed:
    """A chunk's content.

    Attributes:
        data: its bytes, any contiguous buffer.
        compression: `zstd`, `lz4` or empty.
        size: its size in bytes before compression.
        crc: its CRC-32 before compression.
    """

    data: Any
    compression: str
    size: int
    crc: int


def compressed_chunk(records: Any, level: int) -> Compressed:
    """Return whole message records, any contiguous buffer, as a chunk compressed with zstd."""
    raw = memoryview(records).cast("B")
    data = zstandard.ZstdCompressor(level=level).compress(raw)
    return Compressed(data, "zstd", len(raw), crc32(raw))


class McapSink:
    """An MCAP file being written; the caller opens and closes the stream."""

    def __init__(self, stream: BinaryIO, *, profile: str = "ros2") -> None:
        self._stream = stream
        self._position = 0
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._data_crc = 0
        self._put(MAGIC)
        self._record(Header(profile=profile, library=LIBRARY))

    def schema(self, name: str, encoding: str, data: bytes) -> int:
        """Write a schema and return its id."""
        schema = Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        self.add(schema)
        return schema.id

    def add(self, record: Schema | Channel) -> None:
        """Write a schema or channel under the id that it has."""
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        else:
            self._channels[record.id] = record
        self._record(record)

    def channel(
        self, topic: str, encoding: str, schema: int, metadata: dict[str, str] | None = None
    ) -> int:
        """Write a channel and return its id."""
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=encoding,
            metadata=metadata or {},
            schema_id=schema,
        )
        self.add(channel)
        return channel.id

    def metadata(self, name: str, content: dict[str, str]) -> None:
        """Write a metadata record."""
        offset = self._position
        length = self._record(Metadata(name=name, metadata=content))
        self._metadata.append(MetadataIndex(offset=offset, length=length, name=name))

    def attachment(self, name: str, data: bytes, media_type: str, log_time: int) -> None:
        """Write a file into the recording."""
        offset = self._position
        length = self._record(
            Attachment(
                create_time=0, log_time=log_time, name=name, media_type=media_type, data=data
            )
        )
        self._attachments.append(
            AttachmentIndex(
                offset=offset,
                length=length,
                create_time=0,
                log_time=log_time,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )

    def copied_attachment(self, content: bytes, name: str, media_type: str, size: int) -> None:
        """Write the content of an attachment's record as it is, the checksum that it has included.

        Args:
            content: of the record.
            name: of the attachment.
            media_type: of the attachment.
            size: of its data in bytes.
        """
        offset = self._position
        head = _RECORD_HEAD.pack(Opcode.ATTACHMENT, len(content))
        self._put(head + content)
        log_time, create_time = struct.unpack_from("<QQ", content)
        self._attachments.append(
            AttachmentIndex(
                offset=offset,
                length=len(head) + len(content),
                create_time=create_time,
                log_time=log_time,
                data_size=size,
                name=name,
                media_type=media_type,
            )
        )

    def chunk(self, records: Any, index: Index, level: int = 3, *, verified: bool = True) -> None:
        """Compress and write a chunk of whole message records, and its message indexes.

        Args:
            records: the bytes of the records, any contiguous buffer.
            index: where each channel's records are.
            level: of the compression.
            verified: whether the records are known to be right, so that they get a checksum.
        """
        made = compressed_chunk(records, level)
        self.compressed_chunk(made if verified else replace(made, crc=0), index)

    def compressed_chunk(self, chunk: Compressed, index: Index) -> None:
        """Write a chunk that is compressed already, and its message indexes.

        Args:
            chunk: the chunk.
            index: where each channel's records are in it; at least one message.
        """
        name = chunk.compression.encode()
        start = min(int(times.min()) for times, _ in index.values())
        end = max(int(times.max()) for times, _ in index.values())
        offset = self._position
        head = _CHUNK_HEAD.pack(
            Opcode.CHUNK,
            _CHUNK_HEAD.size - 9 + len(name) + 8 + len(chunk.data),
            start,
            end,
            chunk.size,
            chunk.crc,
            len(name),
        )
        head += name + len(chunk.data).to_bytes(8, "little")
        parts = [head, chunk.data]
        length = len(head) + len(chunk.data)
        indexes = {}
        position = offset + length
        for channel, (times, offsets) in index.items():
            entries = np.empty(len(times), dtype=_ENTRY)
            entries["time"] = times
            entries["offset"] = offsets
            indexes[channel] = position
            head = _INDEX_HEAD.pack(
                Opcode.MESSAGE_INDEX, 6 + entries.nbytes, channel, entries.nbytes
            )
            parts += [head, entries.tobytes()]
            position += len(head) + entries.nbytes
            self._counts[channel] = self._counts.get(channel, 0) + len(times)
        # one write: a chunk is never on the disk without its indexes unless the write was cut
        self._put(b"".join(parts))
        self._chunks.append(
            ChunkIndex(
                chunk_length=length,
                chunk_start_offset=offset,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                message_end_time=end,
                message_index_length=self._position - offset - length,
                message_index_offsets=indexes,
                message_start_time=start,
                uncompressed_size=chunk.size,
            )
        )

    def finish(self, *, verified: bool = True) -> None:
        """Write the summary and the footer; the stream stays open.

        Args:
            verified: whether all that was written is known to be right, so that the data get a
                checksum.
        """
        self._record(DataEnd(data_section_crc=self._data_crc if verified else 0))
        start = self._position
        builder = RecordBuilder()
        offsets = []
        for opcode, group in (
            (Opcode.SCHEMA, list(self._schemas.values())),
            (Opcode.CHANNEL, list(self._channels.values())),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        ):
            begin = builder.count
            for record in group:
                record.write(builder)
            if group:
                offsets.append(
                    SummaryOffset(
                        group_opcode=opcode,
                        group_start=start + begin,
                        group_length=builder.count - begin,
                    )
                )
        offset_start = start + builder.count
        for offset in offsets:
            offset.write(builder)
        summary: bytes = builder.end()  # type: ignore[no-untyped-call]  # mcap gives no types here
        crc = crc32(struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offset_start), crc32(summary))
        self._put(summary)
        self._record(
            Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=crc)
        )
        self._put(MAGIC)

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_start_time=min((c.message_start_time for c in self._chunks), default=0),
            message_end_time=max((c.message_end_time for c in self._chunks), default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _record(self, record: Any) -> int:
        builder = RecordBuilder()
        record.write(builder)
        content: bytes = builder.end()  # type: ignore[no-untyped-call]  # mcap gives no types here
        self._put(content)
        return len(content)

    def _put(self, content: bytes) -> None:
        self._data_crc = crc32(content, self._data_crc)
        left = memoryview(content)
        while left:
            # an unbuffered stream may take only a part, such as what still fits on the disk
            taken = self._stream.write(left) or 0
            self._position += taken
            left = left[taken:]
