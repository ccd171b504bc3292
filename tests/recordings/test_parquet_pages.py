"""Parquet files whose index lies about their pages; and pages of every kind, counted."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from eha_bench import recordings
from eha_bench.core.errors import RecordingError
from eha_bench.recordings import info
from eha_bench.recordings.tables import parquet
from eha_bench.recordings.tables.parquet_pages import MissingPage, pages_of

ROWS = 1000
MAP: dict[str, Any] = {
    "time": {"column": "time", "unit": "s"},
    "channels": {"force": {"column": "x", "unit": "N"}},
}


def written(number: int) -> bytes:
    """Return a number as Thrift's compact protocol writes it."""
    value, out = number << 1, b""
    while value > 0x7F:
        out += bytes([value & 0x7F | 0x80])
        value >>= 7
    return out + bytes([value])


def lying(path: Path, changes: dict[int, int]) -> None:
    """Replace numbers of a file's index."""
    content = path.read_bytes()
    size = struct.unpack("<I", content[-8:-4])[0]
    pages, index = content[: -8 - size], content[-8 - size : -8]
    for old, new in changes.items():
        assert written(old) in index
        index = index.replace(written(old), written(new))
    path.write_bytes(pages + index + struct.pack("<I", len(index)) + b"PAR1")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    table = pa.table({"time": np.arange(ROWS) / 1e3, "x": np.random.default_rng(0).random(ROWS)})
    pq.write_table(table, tmp_path / "a.parquet", use_dictionary=False, compression="none")
    return tmp_path / "a.parquet"


@pytest.mark.parametrize("rows", [ROWS - 100, ROWS + 100])
def test_rows_that_the_pages_do_not_hold_are_said(path: Path, rows: int) -> None:
    lying(path, {ROWS: rows})
    with pytest.raises(RecordingError, match=f"its pages hold {ROWS} values, not the {rows}"):
        recordings.read(path, channels=MAP)
    assert info(path).health == "damaged"


@pytest.mark.parametrize("place", [7, 2**40])
def test_pages_that_are_not_where_the_index_says(path: Path, place: int) -> None:
    lying(path, {pq.ParquetFile(path).metadata.row_group(0).column(1).data_page_offset: place})
    with pytest.raises(RecordingError, match="its pages are damaged"):
        recordings.read(path, channels=MAP)
    assert info(path).health == "damaged"


def test_a_size_that_the_index_hides_takes_no_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, rows = tmp_path / "few.parquet", 20_000_000
    column = pa.array(np.zeros(rows))
    pq.write_table(
        pa.table({"x": column}), path, compression="zstd", use_dictionary=False,
        row_group_size=rows,
    )  # fmt: skip
    assert path.stat().st_size < 200_000
    size = pq.ParquetFile(path).metadata.row_group(0).column(0).total_uncompressed_size
    lying(path, {rows: 600, size: 5000})

    def never(*_: Any, **__: Any) -> None:
        raise AssertionError("it was read")

    monkeypatch.setattr(pq.ParquetFile, "read", never)
    table = {"sample_rate": "1 kHz", "channels": {"force": {"column": "x", "unit": "N"}}}
    with pytest.raises(RecordingError, match=f"its pages hold {rows} values, not the 600"):
        recordings.read(path, channels=table)


@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("compression", ["none", "snappy", "zstd", "gzip"])
def test_pages_of_every_kind_are_counted(tmp_path: Path, version: str, compression: str) -> None:
    """Dictionaries, nulls, lists, structs, statistics, checksums, page indices, row groups."""
    path = tmp_path / "kinds.parquet"
    number = np.arange(ROWS)
    table = pa.table(
        {
            "time": number / 1e3,
            "few": pa.array((number % 3).tolist()),
            "null": pa.array([None if k % 7 else float(k) for k in number]),
            "list": pa.array([[float(k)] * (k % 4) for k in number]),
            "text": pa.array([f"{k}" * 50 for k in number]),
            "s": pa.array([{"a": float(k), "b": {"c": k}} for k in number]),
        }
    )
    pq.write_table(
        table, path, compression=compression, data_page_version=version, row_group_size=300,
        data_page_size=500, write_page_checksum=True, write_page_index=True,
    )  # fmt: skip
    source = parquet.ParquetSource(path)
    content = path.read_bytes()
    for name, chunks in source._chunks.items():
        for chunk in chunks:
            found = pages_of(content, chunk.start, chunk.end)
            assert found.values == chunk.values, name
            assert 0 < found.size <= chunk.size, name
    assert source.column("s.b.c").tolist() == number.tolist()
    assert source.column("few").tolist() == (number % 3).tolist()


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x00",
        b"\x15",
        b"\x15\x00" * 9,
        b"\x1c" * 100,
        b"\x19\xfc\xff\xff\xff\x7f",
        b"\x18\xff\x7f",
    ],
)
def test_what_is_no_page_is_said(content: bytes) -> None:
    with pytest.raises(MissingPage):
        pages_of(content, 0, len(content) + 1)


def test_a_wide_table_is_gone_through_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, columns = tmp_path / "wide.parquet", 300
    pq.write_table(pa.table({f"c{k}": np.arange(3.0) for k in range(columns)}), path)
    looked: list[int] = []
    monkeypatch.setattr(parquet, "pages_of", lambda *a: looked.append(a[1]) or pages_of(*a))
    assert [topic.count for topic in info(path).topics] == [3] * columns
    assert len(looked) == columns
