"""Every record of an MCAP file, one by one, as the mcap library's types; not meant to be fast."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from eha_bench.core.arrays import Bytes
from eha_bench.recordings.decompress import DamagedChunk, decompress
from eha_bench.recordings.encodings.payloads import Payloads
from eha_bench.recordings.mcap.demux import MESSAGE_HEAD, RECORD_HEAD, Splitter
from eha_bench.recordings.mcap.file import Chunk, McapFile, open_mcap, parse_record

_KINDS: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.FOOTER: Footer,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.ATTACHMENT: Attachment,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.SUMMARY_OFFSET: SummaryOffset,
    Opcode.DATA_END: DataEnd,
}


def records(path: Path) -> Iterator[McapRecord]:
    """Yield all records up to a tear, those inside chunks included, in file order.

    Chunks and message indexes themselves are left out: they say nothing that the others do not.

    Raises:
        RecordingError: the file is not MCAP.
    """
    file = open_mcap(path)
    stop = file.buffer.size if file.tear is None else file.tear
    yield from _between(file, file.buffer, 8, stop)


def _between(file: McapFile, buffer: Bytes, start: int, stop: int) -> Iterator[McapRecord]:
    chunks = {part.offset: part for part in file.parts if isinstance(part, Chunk)}
    splitter = Splitter()
    position = start
    while position + RECORD_HEAD <= stop:
        found = splitter.split(buffer, position, stop)
        places: list[tuple[int, Any]] = [
            (where - RECORD_HEAD, (opcode, where, length)) for opcode, where, length in found.others
        ]
        for channel, payloads in found.messages:
            places += [
                (payloads.start(row) - MESSAGE_HEAD - RECORD_HEAD, (channel, payloads, row))
                for row in range(payloads.count)
            ]
        for place, content in sorted(places, key=lambda item: item[0]):
            if isinstance(content[1], Payloads):
                yield _message(*content)
                continue
            opcode, where, length = content
            if opcode == Opcode.CHUNK and buffer is file.buffer:
                yield from _inside(file, chunks.get(place))
            elif opcode in _KINDS:
                record = parse_record(_KINDS[opcode], bytes(buffer.data[where : where + length]))
                if record is not None:
                    yield record
        if found.end == position:
            return
        position = found.end


def _inside(file: McapFile, chunk: Chunk | None) -> Iterator[McapRecord]:
    if chunk is None:
        return
    data = file.buffer.data[chunk.data_start : chunk.data_start + chunk.data_size]
    try:
        raw = decompress(data, chunk.compression, chunk.uncompressed_size, chunk.crc)
    except DamagedChunk:
        return
    yield from _between(file, raw, 0, raw.size)


def _message(channel: int, payloads: Payloads, row: int) -> Message:
    one = payloads.start(row)
    data = payloads.buffer.data
    head = bytes(data[one - MESSAGE_HEAD : one])
    return Message(
        channel_id=channel,
        sequence=int.from_bytes(head[2:6], "little"),
        log_time=int.from_bytes(head[6:14], "little"),
        publish_time=int.from_bytes(head[14:22], "little"),
        data=bytes(payloads.payload(row)),
    )
