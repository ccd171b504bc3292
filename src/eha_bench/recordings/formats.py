"""Which format a file is: by its first bytes, since names lie."""

from __future__ import annotations

import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from eha_bench.core.errors import InputError, Place, RecordingError
from eha_bench.recordings.mcap.file import MAGIC
from eha_bench.recordings.source import Source

_READ = "MCAP, ROS 1 bag, rosbag2, CSV, Parquet, MAT, HDF5, MDF, TDMS, ULog, JSON and JSON lines"
_LARGEST_YAML = 1_000_000
"""Bytes up to which a file is looked at as YAML."""
_HDF5 = b"\x89HDF\r\n\x1a\n"
_JSON = re.compile(rb"(?:\xef\xbb\xbf)?\s*(?:\{|\[\s*[\[{\d\"tfn-])")
"""How JSON begins; a preamble of CSV such as `[Header]` does not."""

_NAMED = {
    ".mcap": "an MCAP", ".bag": "a ROS 1 bag", ".db3": "a rosbag2 database",
    ".parquet": "a Parquet file", ".h5": "an HDF5 file", ".hdf5": "an HDF5 file",
    ".mf4": "an MDF file", ".tdms": "a TDMS file", ".ulg": "a ULog",
}  # fmt: skip
"""Endings of formats that begin with bytes of their own: what does not is damaged, or a table."""
_BETWEEN_CELLS = re.compile(rb"[,;\t]")
_NUMBER = re.compile(rb"\s*\"?[-+]?\d[\d.]*(?:[eE][-+]?\d+)?\"?\s*")
_POINTER = b"version https://git-lfs"


def open_file(path: Path, head: bytes) -> Source:
    """Return one file as a source; `head` is its first 4096 bytes.

    Raises:
        RecordingError: it is not a recording.
    """
    for fits, place in _FORMATS:
        if fits(path, head):
            return _open_as(place, path)
    raise_for_relatives(path, head)
    _refuse_our_files(path)
    if _JSON.match(head):
        return _open_as("tables.json_source:JsonSource", path)
    is_text = b"\0" not in head or head.startswith((b"\xff\xfe", b"\xfe\xff"))
    named = _NAMED.get(path.suffix.lower(), "")
    if named and not (is_text and _is_table(head)):
        raise RecordingError(
            f"this is not {named}, as its name says (it does not begin like one), and not a table",
            where=Place(file=str(path)),
            hint="give a whole copy of it, or end the name of a table in .csv",
        )
    if is_text:
        return _open_as("tables.csv_source:CsvSource", path)
    raise RecordingError(
        "this is not a recording that eha-bench knows",
        where=Place(file=str(path)),
        hint=f"it reads {_READ}",
    )


def _is_table(head: bytes) -> bool:
    """Whether text is one of several columns with numbers below its first line, by its head."""
    for line in head.splitlines()[1:]:
        cells = _BETWEEN_CELLS.split(line.replace(b"\0", b""))
        if len(cells) > 1 and any(map(_NUMBER.fullmatch, cells)):
            return True
    return False


def _refuse_our_files(path: Path) -> None:
    """Refuse a YAML file of a kind that we know, of which CSV would make columns."""
    if path.suffix not in (".yaml", ".yml") or path.stat().st_size > _LARGEST_YAML:
        return
    # what reads YAML takes a tenth of a second to import
    from eha_bench.core import yaml_file
    from eha_bench.core.file_kind import kind_by_keys

    try:
        kind = kind_by_keys(yaml_file.load(path))
    except InputError:
        return
    if kind is not None:
        raise RecordingError(
            f"this is a {kind.title}, not a recording",
            where=Place(file=str(path), line=1),
            hint=f"a {kind.title} goes to: {kind.use}" if kind.use else f"it reads {_READ}",
        )


def _open_as(place: str, path: Path) -> Source:
    # imported only now: each format brings its own library
    module, _, name = place.partition(":")
    source = getattr(import_module(f"eha_bench.recordings.{module}"), name)(path)
    assert isinstance(source, Source)
    return source


def _starts(*marks: bytes) -> Callable[[Path, bytes], bool]:
    return lambda _, head: head.startswith(marks)


def _is_mat5(head: bytes) -> bool:
    return len(head) >= 128 and head[124:128] in {b"\x00\x01IM", b"\x01\x00MI"}


def _is_mat73(path: Path, head: bytes) -> bool:
    """MATLAB writes 512 bytes before the HDF5 file; others write only the suffix."""
    if head.startswith(b"MATLAB 7.3"):
        return head[512:].startswith(_HDF5)
    return head.startswith(_HDF5) and path.suffix.lower() == ".mat"


_FORMATS: tuple[tuple[Callable[[Path, bytes], bool], str], ...] = (
    (_starts(MAGIC), "mcap.source:McapSource"),
    (_starts(b"#ROSBAG V"), "bags.bag1:Bag1Source"),
    (_starts(b"SQLite format 3\0"), "bags.sqlite_source:SqliteSource"),
    (_starts(b"PAR1"), "tables.parquet:ParquetSource"),
    (_is_mat73, "tables.apart:Mat73Table"),
    (_starts(_HDF5), "tables.apart:Hdf5Table"),
    (_starts(b"TDSm"), "tables.apart:TdmsTable"),
    (_starts(b"ULog\x01\x12\x35"), "tables.apart:UlogTable"),
    (_starts(b"MDF     ", b"UnFinMF "), "tables.apart:MdfTable"),
    (lambda _, head: head.startswith(b"MATLAB 5.0") or _is_mat5(head), "tables.mat:MatSource"),
)
"""How each format is recognised, and who reads it."""


def raise_for_relatives(path: Path, head: bytes) -> None:
    """Refuse formats that look close, with the way out.

    Raises:
        RecordingError: MAT v4, a workbook, an archive, or a pointer to a file elsewhere.
    """
    where = Place(file=str(path))
    if path.suffix.lower() == ".mat" and b"\0" in head:
        raise RecordingError(
            "this is not a MAT file of version 5 or 7.3",
            where=where,
            hint="save it with save(..., '-v7')",
        )
    if path.suffix.lower() in {".xls", ".xlsx", ".xlsm", ".ods"} and b"\0" in head:
        raise RecordingError("this is a workbook", where=where, hint="save its sheet as CSV")
    if head.startswith(_POINTER):
        raise RecordingError(
            "this is a pointer to a file of Git LFS, not the file",
            where=where,
            hint="fetch it with 'git lfs pull'",
        )
    if head.startswith((b"\x1f\x8b", b"PK\x03\x04")):
        raise RecordingError("this is an archive", where=where, hint="unpack it first")
