"""Opens the chunks of an MCAP file one after the other, only those that are needed."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import partial
from itertools import pairwise

from mcap.opcode import Opcode

from eha_bench.recordings.budget import budget
from eha_bench.recordings.decompress import (
    DamagedChunk,
    DecompressBuffer,
    decompress,
    decompress_torn,
)
from eha_bench.recordings.file_bytes import forget
from eha_bench.recordings.mcap.demux import Split, Splitter
from eha_bench.recordings.mcap.file import (
    BareMessages,
    Chunk,
    McapFile,
    add_channel,
    add_schema,
    message_index,
)
from eha_bench.recordings.source import TimeSpan

Part = Chunk | BareMessages


class ChunkReader:
    """Yields the records of a file's chunks; what is damaged is left out and noted.

    Attributes:
        notes: what was found, one sentence each.
        lost: chunks that are damaged.
        unlike: chunks that do not hold what their index says, or more than records.
        counted: messages by channel of the parts that were opened, by their offset.
    """

    def __init__(self, file: McapFile) -> None:
        self._file = file
        self._budget = budget()
        self.notes: list[str] = []
        self.lost = 0
        self.unlike = 0
        self.counted: dict[int, dict[int, int]] = {}

    def splits(self, ids: Collection[int] | None, span: TimeSpan | None = None) -> Iterator[Split]:
        """Yield the records of every part that may hold one of the channels within the span."""
        splitter = Splitter()
        for part in self.needed_parts(ids, span):
            if not isinstance(part, Chunk):
                found = splitter.split(
                    self._file.buffer, part.start, part.stop, allowed=self._budget
                )
                self.counted[part.start] = _counts(found)
                yield found
                continue
            try:
                yield self.open(part, splitter)
            except DamagedChunk as error:
                self.lost += 1
                self.notes.append(f"the chunk at byte {part.offset} is lost: {error}")

    def open(self, chunk: Chunk, splitter: Splitter, room: DecompressBuffer | None = None) -> Split:
        """Return the records of a chunk, in `room` as long as no other chunk is opened into it.

        Raises:
            DamagedChunk: it cannot be decompressed, or its checksum is wrong.
        """
        data = self._file.buffer.data[chunk.data_start : chunk.data_start + chunk.data_size]
        if chunk.torn:
            buffer = decompress_torn(data, chunk.compression, self._budget)
        else:
            size = chunk.uncompressed_size
            buffer = decompress(data, chunk.compression, size, chunk.crc, room, self._budget)
            forget(self._file.buffer, chunk.offset, chunk.data_start + chunk.data_size)
        index = partial(message_index, self._file, chunk) if chunk.channels else None
        found = splitter.split(buffer, 0, buffer.size, index, self._budget)
        found.chunk = chunk
        self._declare(found)
        counts = self.counted[chunk.offset] = _counts(found)
        if chunk.torn:
            return found
        if found.end < buffer.size:
            self.unlike += 1
            self.notes.append(
                f"the chunk at byte {chunk.offset} holds {buffer.size - found.end} bytes "
                "that are not records"
            )
        elif chunk.channels is not None and _without_none(chunk.channels) != counts:
            self.unlike += 1
            declared, there = sum(chunk.channels.values()), sum(counts.values())
            self.notes.append(
                f"the chunk at byte {chunk.offset} does not hold what its index says: "
                + (
                    f"{there} messages, not {declared}"
                    if declared != there
                    else "they are of other topics"
                )
            )
        return found

    def _declare(self, found: Split) -> None:
        """Compare the channels and schemas inside a chunk with those that are known."""
        for opcode, start, length in found.others:
            if opcode == Opcode.SCHEMA:
                add_schema(self._file, start, length, found.buffer)
            elif opcode == Opcode.CHANNEL:
                add_channel(self._file, start, length, found.buffer)

    def needed_parts(self, ids: Collection[int] | None, span: TimeSpan | None) -> list[Part]:
        """Return the parts to open, in order of time."""
        known = self._file.channels.keys()
        parts = [
            part
            for part in self._in_order()
            if not isinstance(part, Chunk)
            or part.channels is None
            or not part.channels.keys() <= known
            or ids is None
            or not part.channels.keys().isdisjoint(ids)
        ]
        if span is None or ids is None:
            return parts
        return _within(parts, ids, span)

    def _in_order(self) -> list[Part]:
        """Return the parts by time, if chunks were written out of order but do not overlap."""
        parts = self._file.parts
        chunks = [part for part in parts if isinstance(part, Chunk) and not part.torn]
        if len(chunks) < 2 or len(chunks) != len(parts):
            return list(parts)
        ordered = sorted(chunks, key=lambda chunk: chunk.start_time)
        apart = all(a.end_time <= b.start_time for a, b in pairwise(ordered))
        if ordered == chunks or not apart:
            return list(parts)
        self.notes.append("its chunks are not in order of time; they were read in order")
        return list(ordered)


def _counts(found: Split) -> dict[int, int]:
    counts: dict[int, int] = {}
    for channel, payloads in found.messages:
        counts[channel] = counts.get(channel, 0) + payloads.count
    return counts


def _without_none(counts: dict[int, int]) -> dict[int, int]:
    return {channel: count for channel, count in counts.items() if count}


def _within(parts: list[Part], ids: Collection[int], span: TimeSpan) -> list[Part]:
    """Return the parts that overlap the span, and each channel's next ones on both sides."""
    keep = set()
    before = set(ids)
    after = set(ids)
    for number in range(len(parts) - 1, -1, -1):
        part = parts[number]
        if not isinstance(part, Chunk) or part.channels is None or part.torn:
            keep.add(number)
        elif part.end_time < span.start:
            if before & part.channels.keys():
                keep.add(number)
                before -= part.channels.keys()
        elif part.start_time <= span.stop:
            keep.add(number)
    for number, part in enumerate(parts):
        if (
            isinstance(part, Chunk)
            and part.channels is not None
            and part.start_time > span.stop
            and after & part.channels.keys()
        ):
            keep.add(number)
            after -= part.channels.keys()
    return [parts[number] for number in sorted(keep)]
