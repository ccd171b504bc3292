"""`write`: a recording in the format that the file's ending says."""

from __future__ import annotations

from pathlib import Path

from eha_bench.core.errors import InputError
from eha_bench.core.near_miss import suggest
from eha_bench.core.output_folder import spare_inputs
from eha_bench.core.recording import Recording
from eha_bench.recordings.exporting import SUFFIXES, export
from eha_bench.recordings.writer import MCAP, write_mcap


def write(path: str | Path, recording: Recording, *, level: int = 3) -> Path:
    """Write a recording in the format of the file's ending, and return its path.

    An MCAP holds everything: `read` gives it back bit for bit. CSV, Parquet and MDF 4 are written
    as `eha_bench.recordings.export` does, without attachments.

    Args:
        path: a file ending in .mcap, .csv, .parquet or .mf4; its folder must exist.
        recording: what to write.
        level: zstd compression level of an MCAP.

    Raises:
        InputError: the ending is none of these, or the file is the one that was read.
        RecordingError: the file cannot be written, or a time has no stamp.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    known = (MCAP, *SUFFIXES)
    if suffix not in known:
        raise InputError(
            f"'{target.name}' does not say a format to write",
            hint=f"end it in {', '.join(known)} ({suggest(suffix or MCAP, known)})",
        )
    spare_inputs((target,), (recording.origin or recording.source or None,), "name another file")
    if suffix == MCAP:
        return write_mcap(target, recording, level=level)
    return export(target, recording)
