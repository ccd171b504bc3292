"""A complete recording as one MCAP file, chunk by chunk from its arrays."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np

from eha_bench.core.atomic_file import replacing, writing_to
from eha_bench.core.errors import RecordingError
from eha_bench.core.recording import Recording
from eha_bench.recordings import sample
from eha_bench.recordings.mcap.sink import Compressed, McapSink, compressed_chunk
from eha_bench.recordings.sample import WideMessage

MCAP = ".mcap"
"""Ending of the files."""
_WORKERS = 2
CHUNK_SIZE = 1 << 20
"""Bytes of a chunk before compression."""


def write_mcap(path: str | Path, recording: Recording, *, level: int = 3) -> Path:
    """Write a recording as MCAP (ROS 2 profile, one wide message a tick, zstd) and return its path.

    The file appears under its name only when it is whole. Everything in the recording survives
    `read` bit for bit.

    Args:
        path: the file; its folder must exist.
        recording: what to write.
        level: zstd compression level.

    Raises:
        RecordingError: the file cannot be written, or a time has no stamp.
    """
    target = Path(path)
    with writing(target) as stream:
        units = sample.checked_units(recording.units, tuple(recording.values))
        message = WideMessage.of(units)
        sink = McapSink(stream)
        channel = begin(
            sink, message, recording.epoch_ns, recording.metadata, recording.attachments
        )
        if recording.notes:
            notes = {str(number): note for number, note in enumerate(recording.notes)}
            sink.metadata(sample.NOTES, notes)
        _chunks(sink, message, channel, recording, level)
        sink.finish()
    return target


def begin(
    sink: McapSink,
    message: WideMessage,
    epoch_ns: int,
    metadata: Mapping[str, str],
    attachments: Mapping[str, bytes],
) -> int:
    """Write all that stands before the first tick; return the channel's id."""
    for name, content in message.metadata(epoch_ns).items():
        sink.metadata(name, content)
    if metadata:
        sink.metadata(sample.METADATA, dict(metadata))
    for name, data in attachments.items():
        sink.attachment(name, bytes(data), media_type(name), max(epoch_ns, 0))
    schema = sink.schema(sample.SCHEMA_NAME, "ros2msg", message.schema)
    return sink.channel(sample.TOPIC, "cdr", schema)


def media_type(name: str) -> str:
    """Return the media type that a file's name suggests."""
    suffix = Path(name).suffix.lower()
    known = {".yaml": "application/yaml", ".yml": "application/yaml", ".json": "application/json"}
    return known.get(
        suffix, "text/plain" if suffix in {".txt", ".md"} else "application/octet-stream"
    )


def _chunks(
    sink: McapSink, message: WideMessage, channel: int, recording: Recording, level: int
) -> None:
    size = message.record.itemsize
    rows = max(CHUNK_SIZE // size, 1)
    stamps = sample.log_times(recording.time, recording.epoch_ns)
    offsets = np.arange(rows, dtype=np.uint64) * np.uint64(size)
    waiting: deque[tuple[slice, Future[Compressed]]] = deque()

    def put() -> None:
        where, job = waiting.popleft()
        part = stamps[where]
        sink.compressed_chunk(job.result(), {channel: (part, offsets[: part.size])})

    with ThreadPoolExecutor(_WORKERS) as pool:
        for start in range(0, len(recording), rows):
            where = slice(start, min(start + rows, len(recording)))
            if len(waiting) == _WORKERS:
                put()
            records = _records(message, channel, recording, stamps, where)
            waiting.append((where, pool.submit(compressed_chunk, records, level)))
        while waiting:
            put()


def _records(
    message: WideMessage, channel: int, recording: Recording, stamps: np.ndarray, where: slice
) -> np.ndarray:
    """Return the records of some ticks."""
    records = message.records(where.stop - where.start, channel)
    sample.stamp(records, stamps[where])
    records["sequence"] = np.arange(where.start, where.stop)
    records[sample.TIME] = recording.time[where]
    for column, name in enumerate(message.channels):
        records["values"][:, column] = recording.values[name][where]
    return records


@contextmanager
def writing(target: Path) -> Iterator[BinaryIO]:
    """Open a file next to `target` that takes its place when all went well.

    Raises:
        RecordingError: the file cannot be written.
    """
    with (
        writing_to(target, RecordingError),
        replacing(target) as part,
        part.open("wb") as stream,
    ):
        yield stream
