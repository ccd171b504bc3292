"""Which format a file is: by its first bytes, since names lie."""

from __future__ import annotations

from pathlib import Path

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.mcap.file import MAGIC
from eha_bench.recordings.source import Source

_READ = "MCAP, ROS 1 bag, rosbag2 folder, CSV, Parquet and MAT v5"


def open_file(path: Path, head: bytes) -> Source:
    """Return one file as a source; `head` is its first 4096 bytes.

    Raises:
        RecordingError: it is no recording.
    """
    # imported here: each format brings its own library
    if head.startswith(MAGIC):
        from eha_bench.recordings.mcap.source import McapSource

        return McapSource(path)
    if head.startswith(b"#ROSBAG V"):
        from eha_bench.recordings.bags.bag1 import Bag1Source

        return Bag1Source(path)
    if head.startswith(b"SQLite format 3\0"):
        from eha_bench.recordings.bags.sqlite_source import SqliteSource

        return SqliteSource(path)
    if head.startswith(b"PAR1"):
        from eha_bench.recordings.tables.parquet import ParquetSource

        return ParquetSource(path)
    if head.startswith(b"MATLAB 5.0") or _is_mat5(head):
        from eha_bench.recordings.tables.mat import MatSource

        return MatSource(path)
    raise_for_relatives(path, head)
    if b"\0" not in head or head.startswith((b"\xff\xfe", b"\xfe\xff")):
        from eha_bench.recordings.tables.csv_source import CsvSource

        return CsvSource(path)
    raise RecordingError(
        "this is not a recording that eha-bench knows",
        where=Place(file=str(path)),
        hint=f"it reads {_READ}",
    )


def _is_mat5(head: bytes) -> bool:
    return len(head) >= 128 and head[124:128] in {b"\x00\x01IM", b"\x01\x00MI"}


def raise_for_relatives(path: Path, head: bytes) -> None:
    """Refuse formats that look close, with the way out.

    Raises:
        RecordingError: MAT v7.3 or v4, or an archive.
    """
    where = Place(file=str(path))
    if head.startswith((b"MATLAB 7.3", b"\x89HDF")):
        raise RecordingError(
            "this is a MAT v7.3 (HDF5) file, which is not read",
            where=where,
            hint="save it with save(..., '-v7')",
        )
    if path.suffix.lower() == ".mat" and b"\0" in head:
        raise RecordingError(
            "this is not a MAT file of version 5", where=where, hint="save it with save(..., '-v7')"
        )
    if path.suffix.lower() in {".xls", ".xlsx", ".xlsm", ".ods"} and b"\0" in head:
        raise RecordingError("this is a workbook", where=where, hint="save its sheet as CSV")
    if head.startswith((b"\x1f\x8b", b"PK\x03\x04")):
        raise RecordingError("this is an archive", where=where, hint="unpack it first")
