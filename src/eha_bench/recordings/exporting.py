"""`export`: a recording as CSV, Parquet or MDF 4, which other tools open."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from eha_bench.core.atomic_file import replacing, writing_to
from eha_bench.core.channels import CHANNELS
from eha_bench.core.errors import InputError, RecordingError
from eha_bench.core.extras import require
from eha_bench.core.near_miss import suggest
from eha_bench.core.output_folder import spare_inputs
from eha_bench.core.recording import Recording
from eha_bench.recordings.tables.library import writing_with
from eha_bench.recordings.tables.mdf import OWN
from eha_bench.recordings.tables.parquet import DESCRIPTION

SUFFIXES = (".csv", ".parquet", ".mf4")
"""Endings of the files that are written."""


def export(path: str | Path, recording: Recording) -> Path:
    """Write a recording in the format of the file's suffix, and return its path.

    Time (s) and all channels are written in SI, bit for bit; `read` takes them back without a map.
    Parquet and MDF hold the units and when time zero was; attachments are left out everywhere.

    Args:
        path: a file ending in .csv, .parquet or .mf4; its folder must exist.
        recording: what to write.

    Raises:
        InputError: the suffix is none of these, or the file is the one that was read.
        RecordingError: the file cannot be written, or the library for its format is not installed.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(
            f"'{target.name}' does not say a format to export to",
            hint=f"end it in {', '.join(SUFFIXES)} ({suggest(suffix or 'csv', SUFFIXES)})",
        )
    spare_inputs((target,), (recording.origin or recording.source or None,), "name another file")
    with writing_to(target, RecordingError), replacing(target) as part:
        if suffix == ".csv":
            _csv(part, recording)
        elif suffix == ".parquet":
            _parquet(part, recording)
        else:
            with writing_with("asammdf", "mdf", str(target)):
                _mdf(part, recording)
    return target


def _headings(recording: Recording) -> dict[str, str]:
    """Return channel -> heading; one whose name does not say its unit carries it."""
    headings = {}
    for name in recording.values:
        unit = recording.unit(name)
        implied = name in CHANNELS and CHANNELS[name].unit in ("", unit)
        headings[name] = name if implied else f"{name} [{unit}]"
    return headings


def _csv(path: Path, recording: Recording) -> None:
    import pandas as pd

    columns = {head: recording.values[name] for name, head in _headings(recording).items()}
    frame = pd.DataFrame({"time": recording.time, **columns})
    frame.to_csv(path, index=False, lineterminator="\n")


def _description(recording: Recording) -> Mapping[str, Any]:
    return {
        "version": 1,
        "epoch_ns": recording.epoch_ns,
        "units": dict(recording.units),
        "metadata": dict(recording.metadata),
        "notes": list(recording.notes),
    }


def _parquet(path: Path, recording: Recording) -> None:
    require("pyarrow", "parquet", "a Parquet file", error=RecordingError)
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = list(recording.values)
    columns = [recording.time, *(recording.values[name] for name in names)]
    table = pa.table(dict(zip(["time", *names], columns, strict=True)))
    described = json.dumps(_description(recording), ensure_ascii=False).encode()
    pq.write_table(table.replace_schema_metadata({DESCRIPTION: described}), path)


def _mdf(path: Path, recording: Recording) -> None:
    from asammdf import MDF, Signal

    log = MDF(version="4.10")
    log.header.abs_time = recording.epoch_ns
    log.header.comment = f"{OWN}: {json.dumps(dict(recording.metadata), ensure_ascii=False)}"
    log.append(
        [
            Signal(values, recording.time, name=name, unit=recording.unit(name) or "1")
            for name, values in recording.values.items()
        ],
        acq_source=None,
        comment="recording",
        common_timebase=True,
    )
    written = path.with_suffix(".mf4")  # the library puts its own suffix behind any other
    try:
        log.save(written, overwrite=True, compression=2)
        written.replace(path)
    finally:
        try:
            log.close()
        finally:
            written.unlink(missing_ok=True)
