"""`recover`: a clean, indexed MCAP file from one that was torn."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.checksum import crc32
from eha_bench.recordings.mcap.chunk_reader import ChunkReader
from eha_bench.recordings.mcap.demux import LOG_TIME, PAYLOAD, Split
from eha_bench.recordings.mcap.file import Chunk, McapFile, add_channel, add_schema, open_mcap
from eha_bench.recordings.mcap.sink import Compressed, Index, McapSink
from eha_bench.recordings.mcap.source import damage
from eha_bench.recordings.writer import CHUNK_SIZE, writing

_SCHEMA, _CHANNEL = 3, 4


@dataclass(frozen=True)
class RecoveryReport:
    """What `recover` did.

    Attributes:
        source: the torn file.
        target: the clean file.
        messages: messages saved, by topic.
        duration: time between the first and the last message saved, s.
        bytes_lost: bytes of the source that are no whole records; most of them may have been saved
            from a torn chunk nevertheless.
        chunks_lost: chunks that could not be decompressed or had a wrong checksum.
        notes: what was found, one sentence each; empty if the source was whole.
    """

    source: str
    target: str
    messages: dict[str, int]
    duration: float
    bytes_lost: int
    chunks_lost: int
    notes: tuple[str, ...]

    @property
    def whole(self) -> bool:
        """Whether nothing was wrong with the source."""
        return not self.notes


def recover(source: str | Path, target: str | Path) -> RecoveryReport:
    """Write all that can be read of an MCAP file to a new one with an index.

    Whole chunks are copied as they are, so no message changes; messages of a torn chunk and those
    outside of chunks go into new ones. The target appears only when it is whole.

    Raises:
        RecordingError: the source is not MCAP or holds nothing, or the target cannot be written.
    """
    origin, goal = Path(source), Path(target)
    where = Place(file=str(origin))
    try:
        file = open_mcap(origin)
        same = goal.exists() and goal.samefile(origin)
    except FileNotFoundError as error:
        raise RecordingError("no such file", where=where, hint="check its path") from error
    except OSError as error:
        raise RecordingError(f"cannot be read ({error.strerror or error})", where=where) from error
    if same:
        raise RecordingError(
            "the target is the recording itself", where=where, hint="give another target"
        )
    reader = ChunkReader(file)
    tally = _Tally()
    with writing(goal) as stream:
        profile = file.header.profile if file.header else "ros2"
        sink = McapSink(stream, profile=profile)
        for record in file.metadata:
            sink.metadata(record.name, dict(record.metadata))
        for start, length in file.attachments:
            found = file.attachment(start, length)
            if found is not None:
                sink.attachment(found.name, found.data, found.media_type, found.log_time)
        known: set[tuple[str, int]] = set()
        _declare(sink, file, known)
        for split in reader.splits(None):
            _learn(file, split)
            _declare(sink, file, known)
            _copy(sink, file, split, tally)
        if not tally.counts and not file.metadata:
            raise RecordingError("nothing in it can be read", where=where)
        sink.finish()
    return _report(file, reader, goal, tally)


def _learn(file: McapFile, split: Split) -> None:
    for opcode, start, length in split.others:
        if opcode == _SCHEMA:
            add_schema(file, start, length, split.buffer)
        elif opcode == _CHANNEL:
            add_channel(file, start, length, split.buffer)


def _declare(sink: McapSink, file: McapFile, known: set[tuple[str, int]]) -> None:
    """Write the schemas and channels that were not written yet, before any message of theirs."""
    for schema in list(file.schemas.values()):
        if ("schema", schema.id) not in known:
            known.add(("schema", schema.id))
            sink.add(schema)
    for channel in list(file.channels.values()):
        if ("channel", channel.id) not in known:
            known.add(("channel", channel.id))
            sink.add(channel)


@dataclass(frozen=True)
class _Messages:
    """Messages of one stretch of records, in order: each array (n,)."""

    channels: NDArray[np.int64]
    stamps: NDArray[np.uint64]
    starts: NDArray[np.int64]
    sizes: NDArray[np.int64]

    def index(self, rows: slice, first: int) -> Index:
        """Return where each channel's records are, counted from `first`."""
        channels, stamps, starts = self.channels[rows], self.stamps[rows], self.starts[rows] - first
        return {
            int(channel): (stamps[channels == channel], starts[channels == channel])
            for channel in np.unique(channels)
        }


def _messages(split: Split) -> _Messages:
    """Return where the messages of a split stand."""
    parts = []
    for channel, payloads in split.messages:
        starts = (
            payloads.starts
            if payloads.starts is not None
            else payloads.first + payloads.step * np.arange(payloads.count, dtype=np.int64)
        )
        parts.append(
            _Messages(
                np.full(payloads.count, channel, dtype=np.int64),
                payloads.column(LOG_TIME, "<u8"),
                starts - PAYLOAD,
                np.full(payloads.count, payloads.size + PAYLOAD, dtype=np.int64),
            )
        )
    joined = [
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("channels", "stamps", "starts", "sizes")
    ]
    order = np.argsort(joined[2])
    return _Messages(*(array[order] for array in joined))


def _copy(sink: McapSink, file: McapFile, split: Split, tally: _Tally) -> None:
    """Write one chunk or stretch; messages of a channel that nobody declares cannot be kept."""
    if not split.messages:
        return
    found = _messages(split)
    known = np.isin(found.channels, list(file.channels))
    tally.undeclared += int(np.count_nonzero(~known))
    tally.count(found.channels[known], found.stamps[known])
    chunk = split.chunk
    if isinstance(chunk, Chunk) and not chunk.torn and split.whole and known.all():
        data = file.buffer.data[chunk.data_start : chunk.data_start + chunk.data_size]
        crc = chunk.crc or crc32(split.buffer.data)
        index = found.index(slice(None), 0)
        whole = Compressed(data, chunk.compression, chunk.uncompressed_size, crc)
        sink.compressed_chunk(whole, index)
        return
    starts, sizes = found.starts[known], found.sizes[known]
    places = np.cumsum(sizes) - sizes
    moved = _Messages(found.channels[known], found.stamps[known], places, sizes)
    cuts = np.flatnonzero(np.diff(places // CHUNK_SIZE)) + 1
    data = split.buffer.data
    for rows in np.split(np.arange(starts.size), cuts):
        if rows.size:
            raw = b"".join(
                [
                    data[start : start + size]
                    for start, size in zip(starts[rows].tolist(), sizes[rows].tolist(), strict=True)
                ]
            )
            sink.chunk(raw, moved.index(slice(rows[0], rows[-1] + 1), int(places[rows[0]])))


class _Tally:
    """What was saved."""

    def __init__(self) -> None:
        self.counts: dict[int, int] = {}
        self.first = 2**64
        self.last = 0
        self.undeclared = 0

    def count(self, channels: NDArray[np.int64], stamps: NDArray[np.uint64]) -> None:
        """Add messages."""
        for channel, number in zip(*np.unique(channels, return_counts=True), strict=True):
            self.counts[int(channel)] = self.counts.get(int(channel), 0) + int(number)
        if stamps.size:
            self.first = min(self.first, int(stamps.min()))
            self.last = max(self.last, int(stamps.max()))


def _report(file: McapFile, reader: ChunkReader, target: Path, tally: _Tally) -> RecoveryReport:
    messages: dict[str, int] = {}
    for channel, count in tally.counts.items():
        topic = file.channels[channel].topic
        messages[topic] = messages.get(topic, 0) + count
    lost = sum(stop - start for start, stop in file.holes)
    if file.tear is not None:
        lost += file.buffer.size - file.tear
    notes = [*damage(file), *reader.notes]
    if tally.undeclared:
        notes.append(
            f"{tally.undeclared} messages were left out, since nothing describes their channel"
        )
    return RecoveryReport(
        source=str(file.path),
        target=str(target),
        messages=messages,
        duration=(tally.last - tally.first) / 1e9 if messages else 0.0,
        bytes_lost=lost,
        chunks_lost=reader.lost,
        notes=tuple(dict.fromkeys(notes)),
    )
