"""`write`: a recording as MCAP, or in the format that the file's ending says."""

from __future__ import annotations

from pathlib import Path

from eha_bench.core.errors import InputError
from eha_bench.core.output_folder import spare_inputs
from eha_bench.core.recording import Recording
from eha_bench.recordings.exporting import SUFFIXES, export
from eha_bench.recordings.writer import MCAP, write_mcap

_READ_ALONE = (
    *(".bag", ".db3", ".mat", ".h5", ".hdf5", ".mdf", ".tdms", ".ulg", ".json", ".jsonl"),
    *(".ndjson", ".tsv", ".xls", ".xlsx", ".xlsm", ".ods", ".gz", ".zip", ".zst", ".zstd"),
)
"""Endings of other formats, none of which is written: an MCAP under such a name is a trap."""


def write(path: str | Path, recording: Recording, *, level: int = 3) -> Path:
    """Write a recording as MCAP, or in another format that the file's ending says; return its path.

    An MCAP holds everything: `read` gives it back bit for bit. CSV, Parquet and MDF 4 are written
    as `eha_bench.recordings.export` does, without attachments.

    Args:
        path: the file; its folder must exist. One ending in .csv, .parquet or .mf4 is written so,
            any other is an MCAP.
        recording: what to write.
        level: zstd compression level of an MCAP.

    Raises:
        InputError: the ending is that of a format that is only read, or it is the file that was
            read.
        RecordingError: the file cannot be written, or a time has no stamp.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix in _READ_ALONE:
        raise InputError(
            f"'{target.name}' names a format that is not written",
            hint=f"end it in {', '.join((MCAP, *SUFFIXES))}",
        )
    if suffix in SUFFIXES:
        return export(target, recording)
    spare_inputs((target,), (recording.origin or recording.source or None,), "name another file")
    return write_mcap(target, recording, level=level)
