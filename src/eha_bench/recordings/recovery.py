"""`recover`: a clean, indexed MCAP file from one that was torn."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings import sample
from eha_bench.recordings.budget import spending
from eha_bench.recordings.mcap.chunk_reader import ChunkReader
from eha_bench.recordings.mcap.demux import LOG_TIME, PAYLOAD, Split
from eha_bench.recordings.mcap.file import MAGIC, BareMessages, Chunk, McapFile, open_mcap
from eha_bench.recordings.mcap.integrity import count_problems, data_problems, summary_problems
from eha_bench.recordings.mcap.sink import Compressed, Index, McapSink
from eha_bench.recordings.mcap.source import RECOVERY, damage, joined_metadata, recovery_notes
from eha_bench.recordings.naming import printable
from eha_bench.recordings.opening import refuse_special
from eha_bench.recordings.writer import CHUNK_SIZE, writing


@dataclass(frozen=True)
class RecoveryReport:
    """What `recover` did.

    Attributes:
        source: the torn file.
        target: the clean file.
        messages: messages saved, by topic.
        duration: time between the first and the last message saved, s.
        bytes_lost: bytes of the source that are not whole records; most of them may have been saved
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
        refuse_special(origin)
        file = open_mcap(origin)
        same = goal.exists() and goal.samefile(origin)
        other = goal.is_file() and goal.stat().st_size > 0 and not _is_mcap(goal)
    except FileNotFoundError as error:
        raise RecordingError("no such file", where=where, hint="check its path") from error
    except OSError as error:
        raise RecordingError(f"cannot be read ({error.strerror or error})", where=where) from error
    if same:
        raise RecordingError(
            "the target is the recording itself", where=where, hint="give another target"
        )
    if other:
        raise RecordingError(
            "is no MCAP file, and would be overwritten",
            where=Place(file=str(goal)),
            hint="give another target",
        )
    with spending(origin):
        return _recover(file, goal)


def _is_mcap(path: Path) -> bool:
    with path.open("rb") as stream:
        return stream.read(len(MAGIC)) == MAGIC


def _recover(file: McapFile, goal: Path) -> RecoveryReport:
    where = Place(file=str(file.path))
    reader = ChunkReader(file)
    tally = _Tally()
    with writing(goal) as stream:
        profile = file.header.profile if file.header else "ros2"
        sink = McapSink(stream, profile=profile)
        for record in file.metadata:
            sink.metadata(record.name, dict(record.metadata))
        damaged = [name for name, sound in file.attachment_checks() if not sound]
        for start, length in file.attachments:
            found = file.attachment(start, length)
            if found is not None:
                # with the checksum that it has: a fresh one would make damage look right
                content = bytes(file.buffer.data[start : start + length])
                sink.copied_attachment(content, found.name, found.media_type, len(found.data))
        known: set[tuple[str, int]] = set()
        _declare(sink, file, known)
        for split in reader.splits(None):
            _declare(sink, file, known)
            _copy(sink, file, split, tally)
        if not tally.counts and not file.attachments:
            raise RecordingError("nothing in it can be read", where=where)
        problems = _problems(file, reader, damaged)
        if problems:
            # a reader of the new file has to know: it is whole, but not to be believed
            sink.metadata(RECOVERY, {str(number): note for number, note in enumerate(problems)})
        # where it had no checksum, or a wrong one, a fresh one would prove nothing
        sink.finish(verified=file.data_crc != 0 and file.tear is None and not problems)
    notes = (*damage(file), *problems, *reader.notes, *_notes_of_unverified(tally))
    return _report(file, reader, goal, tally, tuple(dict.fromkeys(notes)))


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


def _problems(file: McapFile, reader: ChunkReader, damaged: list[str]) -> tuple[str, ...]:
    """Say what in the source is not as it was written, apart from what is missing."""
    starts = [part.start for part in file.parts if isinstance(part, BareMessages)]
    bare: Counter[int] = Counter()
    for start in starts:
        bare.update(reader.counted.get(start, {}))
    records = joined_metadata(file)
    own = next((c for c in file.channels.values() if c.topic == sample.TOPIC), None)
    schema = file.schemas.get(own.schema_id) if own else None
    described = ""
    if sample.is_own(records) and schema is not None:
        described = sample.description_problem(records, schema.data)
    return (
        *recovery_notes(file),
        *file.conflicts.values(),
        *summary_problems(file),
        *data_problems(file),
        *count_problems(file, reader.counted, bare),
        *([described] if described else []),
        *(
            f"the attachment {printable([name])} is damaged: it was copied with its wrong checksum"
            for name in damaged
        ),
    )


def _notes_of_unverified(tally: _Tally) -> list[str]:
    notes = []
    if tally.undeclared:
        notes.append(f"{tally.undeclared} messages were left out, since their type is not certain")
    if tally.unverified:
        notes.append(
            f"{tally.unverified} of its messages have no checksum: they were copied without one"
        )
    return notes


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
    """Write one chunk or stretch; messages of an undeclared channel cannot be kept."""
    if not split.messages:
        return
    found = _messages(split)
    twice = {channel for channel, _ in file.conflicts if channel is not None}
    known = np.isin(found.channels, list(file.channels.keys() - twice))
    tally.undeclared += int(np.count_nonzero(~known))
    tally.count(found.channels[known], found.stamps[known])
    chunk = split.chunk
    if isinstance(chunk, Chunk) and not chunk.torn and split.whole and known.all():
        data = file.buffer.data[chunk.data_start : chunk.data_start + chunk.data_size]
        tally.unverified += 0 if chunk.crc else int(found.channels.size)
        index = found.index(slice(None), 0)
        whole = Compressed(data, chunk.compression, chunk.uncompressed_size, chunk.crc)
        sink.compressed_chunk(whole, index)
        return
    verified = isinstance(chunk, Chunk) and not chunk.torn and chunk.crc != 0
    tally.unverified += 0 if verified else int(np.count_nonzero(known))
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
            index = moved.index(slice(rows[0], rows[-1] + 1), int(places[rows[0]]))
            sink.chunk(raw, index, verified=verified)


class _Tally:
    """What was saved."""

    def __init__(self) -> None:
        self.counts: dict[int, int] = {}
        self.first = 2**64
        self.last = 0
        self.undeclared = 0
        self.unverified = 0

    def count(self, channels: NDArray[np.int64], stamps: NDArray[np.uint64]) -> None:
        """Add messages."""
        for channel, number in zip(*np.unique(channels, return_counts=True), strict=True):
            self.counts[int(channel)] = self.counts.get(int(channel), 0) + int(number)
        if stamps.size:
            self.first = min(self.first, int(stamps.min()))
            self.last = max(self.last, int(stamps.max()))


def _report(
    file: McapFile, reader: ChunkReader, target: Path, tally: _Tally, notes: tuple[str, ...]
) -> RecoveryReport:
    messages: dict[str, int] = {}
    for channel, count in tally.counts.items():
        topic = file.channels[channel].topic
        messages[topic] = messages.get(topic, 0) + count
    lost = sum(stop - start for start, stop in file.holes)
    if file.tear is not None:
        lost += file.buffer.size - file.tear
    return RecoveryReport(
        source=str(file.path),
        target=str(target),
        messages=messages,
        duration=(tally.last - tally.first) / 1e9 if messages else 0.0,
        bytes_lost=lost,
        chunks_lost=reader.lost,
        notes=notes,
    )
