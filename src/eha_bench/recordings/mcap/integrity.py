"""Compares what an MCAP file holds with what it says of itself: checksums, counts, index.

Format: https://mcap.dev/spec. A checksum of zero means that there is none.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator, Mapping

from mcap.opcode import Opcode

from eha_bench.core.arrays import Bytes
from eha_bench.recordings.budget import budget
from eha_bench.recordings.checksum import crc32
from eha_bench.recordings.file_bytes import forget
from eha_bench.recordings.mcap.file import Chunk, McapFile
from eha_bench.recordings.naming import printable

_STEP = 1 << 20
_FOOTER = struct.Struct("<BQQQ")


def summary_problems(file: McapFile) -> Iterator[str]:
    """Say where the index at the file's end is damaged, or knows of other records than there are.

    A torn file has none, and says so elsewhere.
    """
    if file.tear is not None:
        return
    if not file.data_ended:
        yield "the end of its data is not marked: the record that says so is missing or damaged"
    if file.footer is not None:
        stop, start, offset_start, crc = file.footer
        if crc:
            head = _FOOTER.pack(Opcode.FOOTER, 20, start, offset_start)
            if crc32(head, _crc(file.buffer, start or stop, stop)) != crc:
                yield "the checksum of its summary is wrong"
    found = {part.offset for part in file.parts if isinstance(part, Chunk)}
    if file.chunk_index and file.chunk_index != found:
        lost, more = file.chunk_index - found, found - file.chunk_index
        yield (
            f"its index lists {len(file.chunk_index)} chunks, of which {len(lost)} are missing"
            + (f"; {len(more)} others are" if more else "")
        )
    for what, declared, there in (
        ("attachments", file.attachment_names, [name for name, _ in file.attachment_checks()]),
        ("metadata records", file.metadata_names, [record.name for record in file.metadata]),
    ):
        if declared and Counter(declared) != Counter(there):
            held = printable(there) or "none"
            yield f"its index names the {what} {printable(declared)}, it holds {held}"


def data_problems(file: McapFile) -> Iterator[str]:
    """Say whether the checksum over all that was recorded is wrong."""
    if (
        file.data_crc
        and file.tear is None
        and _crc(file.buffer, 0, file.data_stop) != file.data_crc
    ):
        yield "the checksum of its data is wrong: something in it is not as it was written"


def count_problems(
    file: McapFile, counted: Mapping[int, Mapping[int, int]], stretches: Mapping[int, int] | None
) -> Iterator[str]:
    """Say where the file's statistics do not agree with what it holds.

    Args:
        file: the scanned file.
        counted: messages by channel of every chunk that was opened, by its offset.
        stretches: messages by channel outside of chunks; None where they were not looked at.
    """
    declared = file.statistics
    if declared is None or file.tear is not None or file.holes:
        return
    chunks = [part for part in file.parts if isinstance(part, Chunk)]
    for what, number, there in (
        ("chunks", declared.chunk_count, len(chunks)),
        ("attachments", declared.attachment_count, len(file.attachments)),
        ("metadata records", declared.metadata_count, len(file.metadata)),
    ):
        if number != there:
            yield f"its statistics count {number} {what}, it holds {there}"
    if stretches is None:
        return
    total: Counter[int] = Counter(stretches)
    for chunk in chunks:
        known = counted.get(chunk.offset, chunk.channels)
        if known is None:
            return
        total.update(known)
    if total.total() != declared.message_count:
        yield f"its statistics count {declared.message_count} messages, it holds {total.total()}"
        return
    by_channel = declared.channel_message_counts
    wrong = [
        number
        for number in sorted({*by_channel, *total})
        if by_channel and by_channel.get(number, 0) != total[number]
    ]
    for number in wrong[:3]:
        channel = file.channels.get(number)
        name = f"topic {printable([channel.topic])}" if channel else f"channel {number}"
        yield (
            f"its statistics count {by_channel.get(number, 0)} messages of {name}, "
            f"it holds {total[number]}"
        )


def _crc(buffer: Bytes, start: int, stop: int) -> int:
    allowed = budget()
    crc = 0
    for begin in range(start, stop, _STEP):
        end = min(begin + _STEP, stop)
        crc = crc32(buffer.data[begin:end], crc)
        forget(buffer, begin, end)
        allowed.tick()
    return crc
