"""CSV, Parquet and MAT: columns instead of topics."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

from eha_bench import recordings
from eha_bench.core.errors import EhaBenchError, RecordingError
from eha_bench.core.recording import Recording
from eha_bench.recordings.tables.mat5 import read_mat5

CHANNELS = {
    "pressure_a": {"column": "p", "unit": "bar"},
    "piston_position": {"column": "pos_mm", "unit": "mm", "scale": 2.0, "offset": 1.0},
}
MAP: dict[str, Any] = {"time": {"column": "t", "unit": "ms"}, "channels": CHANNELS}
COUNT = 100


@pytest.fixture
def frame() -> pd.DataFrame:
    index = np.arange(COUNT)
    return pd.DataFrame({"t": index * 2.0 + 30, "p": index / 7, "pos_mm": index.astype(float)})


def check(back: Recording) -> None:
    index = np.arange(COUNT)
    assert np.allclose(back.time, index * 0.002)
    assert back.epoch_ns == 30_000_000
    assert np.allclose(back["pressure_a"], index / 7 * 1e5, rtol=1e-12)
    assert np.allclose(back["piston_position"], (index * 2.0 + 1.0) * 1e-3, rtol=1e-12)


def test_csv(tmp_path: Path, frame: pd.DataFrame) -> None:
    frame.to_csv(tmp_path / "a.csv", index=False)
    check(recordings.read(tmp_path / "a.csv", channels=MAP))


@pytest.mark.parametrize(
    "options", [{"sep": ";", "decimal": ","}, {"sep": "\t"}, {"sep": "|"}, {"sep": ";"}]
)
def test_csv_as_others_write_it(tmp_path: Path, frame: pd.DataFrame, options: Any) -> None:
    text = frame.to_csv(index=False, **options)
    (tmp_path / "a.txt").write_text("\ufeff# rig 2\n\n" + text.replace("\n", "\r\n"))
    check(recordings.read(tmp_path / "a.txt", channels=MAP))


def test_csv_with_a_delimiter_behind_the_last_cell(tmp_path: Path, frame: pd.DataFrame) -> None:
    head, *rows = frame.to_csv(index=False).splitlines()
    (tmp_path / "a.csv").write_text("\n".join([head, *(f"{row}," for row in rows)]) + "\n")
    check(recordings.read(tmp_path / "a.csv", channels=MAP))


def test_parquet(tmp_path: Path, frame: pd.DataFrame) -> None:
    frame.to_parquet(tmp_path / "a.parquet")
    check(recordings.read(tmp_path / "a.parquet", channels=MAP))


@pytest.mark.parametrize("packed", [False, True])
def test_mat(tmp_path: Path, frame: pd.DataFrame, packed: bool) -> None:
    columns = {name: frame[name].to_numpy() for name in frame}
    savemat(tmp_path / "a.mat", columns, do_compression=packed)
    check(recordings.read(tmp_path / "a.mat", channels=MAP))


def test_mat_structs_and_matrices(tmp_path: Path, frame: pd.DataFrame) -> None:
    content = {
        "log": {"t": frame["t"].to_numpy(), "inner": {"p": frame["p"].to_numpy()}},
        "y": np.column_stack([np.zeros(COUNT), frame["pos_mm"].to_numpy()]),
        "text": "hello",
        "cells": np.array([np.zeros(3), "x"], dtype=object),
    }
    savemat(tmp_path / "a.mat", content)
    channels = {
        "pressure_a": {**CHANNELS["pressure_a"], "column": "log.inner.p"},
        "piston_position": {**CHANNELS["piston_position"], "column": "y[1]"},
    }
    mapping = {"time": {"column": "log.t", "unit": "ms"}, "channels": channels}
    check(recordings.read(tmp_path / "a.mat", channels=mapping))
    for column in ("text", "cells", "y[2]", "log.q", "y"):
        wrong = {**mapping, "channels": {"pressure_a": {"column": column, "unit": "bar"}}}
        with pytest.raises(RecordingError, match="column"):
            recordings.read(tmp_path / "a.mat", channels=wrong)


def test_a_sample_rate_instead_of_a_time(tmp_path: Path, frame: pd.DataFrame) -> None:
    frame.to_csv(tmp_path / "a.csv", index=False)
    back = recordings.read(
        tmp_path / "a.csv", channels={"sample_rate": "3 kHz", "channels": CHANNELS}
    )
    assert np.allclose(back.time, np.arange(COUNT) / 3000, atol=1e-9)
    assert back.resampled == {"time"}
    with pytest.raises(RecordingError, match=r"needs a clock.*sample_rate"):
        recordings.read(tmp_path / "a.csv", channels={"channels": CHANNELS})


def test_a_time_that_starts_below_zero_keeps_its_zero(tmp_path: Path, frame: pd.DataFrame) -> None:
    frame["t"] -= 50
    frame.to_csv(tmp_path / "a.csv", index=False)
    back = recordings.read(tmp_path / "a.csv", channels=MAP)
    assert back.time[0] == pytest.approx(-0.02)
    assert back.epoch_ns == 0


def test_what_eha_bench_writes_as_a_table_needs_no_map(tmp_path: Path) -> None:
    clock = np.arange(50) / 1000 - 0.01
    recording = Recording(clock, {"current": np.sin(clock), "pressure_a": clock * 1e6})
    table = recording.to_frame()
    table.reset_index().to_parquet(tmp_path / "a.parquet")
    table.to_csv(tmp_path / "a.csv")
    for name in ("a.parquet", "a.csv"):
        back = recordings.read(tmp_path / name)
        assert np.allclose(back.time, clock, atol=1e-9)
        assert np.allclose(back["current"], recording["current"], rtol=1e-12)
        assert any("by their names, in SI" in note for note in back.notes)
    with pytest.raises(RecordingError, match="no channel map says"):
        recordings.read(tmp_path / "b.csv") if (tmp_path / "b.csv").write_text("a,b\n1,2\n") else 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,p,pos_mm\n0,1,2\n1,x,3\n2,1,1\n", r"a\.csv:3: 'x' in column 'p' is not a number"),
        ("t,p,pos_mm\n0,1,2\n1,2,3\n1,2,3\n", r"1 samples repeat the stamp"),
        ("t,p,pos_mm\n0,1,2\n2,2,3\n1,2,3\n", r"once the time steps back"),
        ("t,p,pos_mm\n0,1,2\n,2,3\n", r"time is not a number in 1 of 2 rows, first in row 2"),
        ("t,p,pos_mm\n", "the table is empty"),
        ("t,p\n0,1\n", "there is no column 'pos_mm'.*its columns are: t, p"),
        ("t,p,pos_mm\n0,1,2,9\n1,2,3,9\n", "its lines hold 4 cells, its header line 3"),
        ("t,p,pos_mm\n5,1,2\n5,2,3\n5,2,4\n", "time stands still"),
        ("just one column\n1\n2\n", "no delimiter"),
        ("t,p,pos_mm\n0,2026-03-01 12:00:00.5,2\n", r"'p' holds dates .*time: \{column: p\}"),
    ],
)
def test_mistakes_in_a_table(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(EhaBenchError, match=message) as caught:
        recordings.read(tmp_path / "a.csv", channels=MAP)
    assert "\n" not in str(caught.value)


def test_a_torn_table(tmp_path: Path, frame: pd.DataFrame) -> None:
    text = frame.to_csv(index=False)
    lines = text.splitlines(keepends=True)
    (tmp_path / "a.csv").write_text("".join(lines[:50]) + lines[50][:3])
    back = recordings.read(tmp_path / "a.csv", channels=MAP)
    assert len(back) == 49
    assert any("last line was cut off" in note for note in back.notes)
    frame.to_parquet(tmp_path / "a.parquet")
    content = (tmp_path / "a.parquet").read_bytes()
    (tmp_path / "a.parquet").write_bytes(content[:-100])
    with pytest.raises(RecordingError, match="torn"):
        recordings.read(tmp_path / "a.parquet", channels=MAP)


def test_empty_cells_are_nan_and_said(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,p,pos_mm\n0,1,2\n1,,3\n2,3,4\n")
    back = recordings.read(tmp_path / "a.csv", channels=MAP)
    assert np.isnan(back["pressure_a"][1])
    assert any("'pressure_a': 1 of 3 samples are not finite" in note for note in back.notes)


def test_counts_that_wrapped_in_a_table(tmp_path: Path) -> None:
    counts = np.arange(30_000, 36_000, 50).astype(np.uint16).view(np.int16)
    pd.DataFrame({"c": counts, "d": 0}).to_csv(tmp_path / "a.csv", index=False)
    mapping = {"sample_rate": 1000, "channels": {"probe": {"column": "c", "unit": ""}}}
    back = recordings.read(tmp_path / "a.csv", channels=mapping)
    assert any("16-bit integer wraps around once" in note for note in back.notes)


def test_time_as_dates(tmp_path: Path, frame: pd.DataFrame) -> None:
    frame["t"] = pd.to_datetime((frame["t"] * 1e6).astype("int64") + 1_760_000_000_000_000_000)
    frame.to_parquet(tmp_path / "a.parquet")
    back = recordings.read(tmp_path / "a.parquet", channels=MAP)
    assert np.allclose(back.time, np.arange(COUNT) * 0.002)
    assert back.epoch_ns == 1_760_000_000_030_000_000


SIMPLE: dict[str, Any] = {
    "time": {"column": "t", "unit": "s"},
    "channels": {"probe": {"column": "p", "unit": "V"}},
}


@pytest.mark.parametrize(
    ("text", "note"),
    [
        ("t,p\ns,bar\n0,1\n1,2\n", r"line 2 was taken as units \(s, bar\)"),
        ("t;p\n[s];[bar]\n0;1\n", r"line 2 was taken as units"),
        ("Logger;X\nSerial;12\nt;p\n0;1\n1;2\n", "2 lines before the table"),
        ("Logger X\n\nt,p\n0,1\n1,2\n", "one line before the table"),
        ("t p\n0  1\n1  2\n", ""),
        ("# t,p\n0,1\n1,2\n", ""),
        ("t,p\r0,1\r1,2\r", ""),
        ("t,p,p\n0,1,8\n1,2,9\n", r"2 columns are called 'p'.*'p\.1'"),
        ("t,p,q\n0,1,on\n1,2,off\n", ""),
        ("t,p\n0,1\n1,2\n,\n", ""),
    ],
)
def test_tables_as_loggers_write_them(tmp_path: Path, text: str, note: str) -> None:
    (tmp_path / "a.csv").write_bytes(text.encode())
    back = recordings.read(tmp_path / "a.csv", channels=SIMPLE)
    assert back["probe"].tolist() == [1.0, 2.0][: len(back)]
    assert back.time.tolist() == [0.0, 1.0][: len(back)]
    assert re.search(note, " ".join(back.notes))
    assert bool(note) == bool(back.notes)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig", "cp1252"])
def test_letters_of_other_machines(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "a.csv").write_bytes("t,p,\u00d6l\n0,1,7\n1,2,8\n".encode(encoding))
    channels = {"probe": {"column": "\u00d6l", "unit": "V"}}
    back = recordings.read(tmp_path / "a.csv", channels={**SIMPLE, "channels": channels})
    assert back["probe"].tolist() == [7.0, 8.0]


def test_a_table_without_names(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("0,1\n0.5,2\n")
    mapping = {"time": {"column": "0"}, "channels": {"probe": {"column": "1", "unit": "V"}}}
    back = recordings.read(tmp_path / "a.csv", channels=mapping)
    assert back["probe"].tolist() == [1.0, 2.0]
    assert any("no header line" in note for note in back.notes)


@pytest.mark.parametrize(
    ("times", "unit"),
    [
        (["1700000000000", "1700000000001"], "ms"),
        (["1700000000000000", "1700000000001000"], "us"),
        (["1700000000000000000", "1700000000001000000"], "ns"),
        (["1700000000000.0", "1700000000001.0"], "ms"),
        (["2023-11-14T22:13:20.000Z", "2023-11-14T22:13:20.001Z"], "s"),
        (["2023-11-14 23:13:20.000+01:00", "2023-11-14 23:13:20.001+01:00"], "s"),
    ],
)
def test_times_since_1970_are_exact(tmp_path: Path, times: list[str], unit: str) -> None:
    (tmp_path / "a.csv").write_text("t,p\n" + "".join(f"{t},1\n" for t in times))
    back = recordings.read(
        tmp_path / "a.csv", channels={**SIMPLE, "time": {"column": "t", "unit": unit}}
    )
    assert back.epoch_ns == 1_700_000_000_000_000_000
    assert back.time.tolist() == [0.0, 0.001]


def test_parquet_times_and_nested_columns(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    values = pa.array([[1.0, 5.0], [2.0, 6.0]])
    nested = pa.array([{"x": 7.0}, {"x": 8.0}])
    base = 1_700_000_000_000_000
    for kind, raw in (
        (pa.timestamp("us", tz="Europe/Berlin"), [base, base + 1000]),
        (pa.duration("us"), [0, 1000]),
        (pa.time64("us"), [0, 1000]),
        (pa.decimal128(9, 3), None),
    ):
        times = pa.array(raw, kind) if raw else pa.array([0.0, 0.001]).cast(kind)
        pq.write_table(pa.table({"t": times, "p": values, "n": nested}), tmp_path / "a.parquet")
        for column, expected in (("p[1]", [5.0, 6.0]), ("n.x", [7.0, 8.0])):
            channels = {"probe": {"column": column, "unit": "V"}}
            back = recordings.read(
                tmp_path / "a.parquet", channels={**SIMPLE, "channels": channels}
            )
            assert back["probe"].tolist() == expected
            assert back.time.tolist() == [0.0, 0.001]
    pq.write_table(
        pa.table({"t": pa.array([base, None], pa.timestamp("us")), "p": [1.0, 2.0]}),
        tmp_path / "a.parquet",
    )
    with pytest.raises(RecordingError, match="time is not a number in 1 of 2 rows"):
        recordings.read(tmp_path / "a.parquet", channels=SIMPLE)


def test_mat_struct_arrays_and_cells(tmp_path: Path) -> None:
    signals = np.zeros((2,), dtype=[("values", "O"), ("label", "O")])
    signals[0], signals[1] = (np.arange(4.0), "a"), (np.arange(4.0) * 3, "b")
    cells = np.empty(2, dtype=object)
    cells[0], cells[1] = np.arange(4.0), np.arange(4.0) * 2
    clock = np.arange(4) / 1000
    content = {"log": {"time": clock, "signals": signals}, "c": cells, "z": clock * 1j}
    savemat(tmp_path / "a.mat", content)
    for column, factor in (("log.signals[1].values", 3.0), ("c[1]", 2.0)):
        mapping = {
            "time": {"column": "log.time"}, "channels": {"probe": {"column": column, "unit": "V"}}
        }  # fmt: skip
        back = recordings.read(tmp_path / "a.mat", channels=mapping)
        assert back["probe"].tolist() == [0.0, factor, 2 * factor, 3 * factor]
    mapping["channels"]["probe"]["column"] = "z"
    with pytest.raises(RecordingError, match="'z' holds complex numbers"):
        recordings.read(tmp_path / "a.mat", channels=mapping)
    savemat(tmp_path / "b.mat", {"t": clock}, format="4")
    with pytest.raises(RecordingError, match=r"not a MAT file of version 5.*-v7"):
        recordings.read(tmp_path / "b.mat", channels=SIMPLE)


def test_a_misspelt_column_is_guessed(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,pressure\n0,1\n")
    mapping = {**SIMPLE, "channels": {"probe": {"column": "presure", "unit": "V"}}}
    with pytest.raises(RecordingError, match="did you mean 'pressure'"):
        recordings.read(tmp_path / "a.csv", channels=mapping)


def test_a_damaged_mat_file_is_read_up_to_the_damage(tmp_path: Path, frame: pd.DataFrame) -> None:
    """SciPy's reader ends the process on some of these."""
    columns = {name: frame[name].to_numpy() for name in ("t", "p", "pos_mm")}
    savemat(tmp_path / "a.mat", {**columns, "last": np.arange(4.0)})
    content = (tmp_path / "a.mat").read_bytes()
    place = content.rindex(np.arange(4.0).tobytes()) - 8
    for kind in (0, 8, 14, 16, 99):
        wrong = content[:place] + kind.to_bytes(4, "little") + content[place + 4 :]
        (tmp_path / "b.mat").write_bytes(wrong)
        back = recordings.read(tmp_path / "b.mat", channels=MAP)
        check(back)
        assert any("damaged or torn" in note for note in back.notes)
    (tmp_path / "c.mat").write_bytes(content[: len(content) // 4])
    with pytest.raises(RecordingError, match=r"there is no column|damaged or torn"):
        recordings.read(tmp_path / "c.mat", channels=MAP)


def test_a_mat_array_that_stands_twice_is_no_good_file(tmp_path: Path, frame: pd.DataFrame) -> None:
    savemat(tmp_path / "log.mat", {name: frame[name].to_numpy() for name in frame})
    content = (tmp_path / "log.mat").read_bytes()
    (tmp_path / "log.mat").write_bytes(content + content[128:])
    found = recordings.info(tmp_path / "log.mat")
    assert found.health == "damaged"
    assert "occurs in it twice" in found.notes[0]


def test_mat_arrays_are_those_of_scipy(tmp_path: Path) -> None:
    from scipy.io import loadmat

    generator = np.random.default_rng(3)
    content = {
        name: (100 * generator.normal(size=shape)).astype(kind)
        for name, kind, shape in (
            ("a", "f8", (7, 3)), ("b", "f4", (5,)), ("c", "i2", (4, 1)), ("d", "u8", (1, 9)),
            ("e", "i1", (2, 2)), ("f", "bool", (6,)), ("g", "i8", (3, 2)),
        )
    }  # fmt: skip
    for packed in (False, True):
        savemat(tmp_path / "a.mat", content, do_compression=packed)
        theirs = loadmat(tmp_path / "a.mat", squeeze_me=True)
        found = read_mat5(memoryview((tmp_path / "a.mat").read_bytes()))
        assert not found.damage
        assert found.numbers.keys() == content.keys()
        for name, array in found.numbers.items():
            assert np.array_equal(array, theirs[name]), name


def test_a_table_of_more_than_a_century_is_a_slip_in_the_rate(tmp_path):
    path = tmp_path / "slow.csv"
    path.write_text("a,i\n" + "0,1\n" * 20)
    channels = {"sample_rate": "1e-9 Hz", "channels": {"current": {"column": "i"}}}
    with pytest.raises(RecordingError, match="20 samples at 1e-09 Hz are longer than"):
        recordings.read(path, channels=channels)


@pytest.mark.parametrize("double", ["p", "t"])
def test_columns_of_one_name_are_not_guessed_between(tmp_path: Path, double: str) -> None:
    """A table may hold two columns of one name; which of them a map means, nobody knows."""
    frame = pd.DataFrame(np.arange(12.0).reshape(4, 3), columns=["t", "p", "q"])
    table = pa.Table.from_pandas(frame).rename_columns(["t", "p", double])
    path = tmp_path / "double.parquet"
    pq.write_table(table, path)
    found = recordings.info(path)
    unread = [item.name for item in found.topics if item.readable == "2 columns have this name"]
    assert unread == [double, double]
    columns = {"pressure_a": {"column": "p", "unit": "bar"}}
    with pytest.raises(RecordingError, match="2 columns have this name"):
        recordings.read(path, channels={"time": {"column": "t", "unit": "s"}, "channels": columns})


def test_a_clock_that_was_set_back_is_not_to_be_sorted(tmp_path: Path) -> None:
    """Sorted, two stretches would be mixed; a rate in the clock's place keeps every sample."""
    path = tmp_path / "log.csv"
    times = [*(0.01 * k for k in range(200)), *(1.0 + 0.01 * k for k in range(200))]
    path.write_text("t,i\n" + "".join(f"{t:.2f},{k}\n" for k, t in enumerate(times)))
    entry = {"current": {"column": "i", "unit": "A"}}
    mapping = {"time": {"column": "t"}, "channels": entry}
    with pytest.raises(RecordingError, match=r"99 samples follow.*set back.*sample_rate"):
        recordings.read(path, channels=mapping)
    found = recordings.read(path, channels={"sample_rate": "100 Hz", "channels": entry})
    assert found["current"].tolist() == list(range(400))
    dropped = recordings.read(path, channels={**mapping, "repair": {"steps_back": "drop"}})
    assert dropped["current"].tolist() == [*range(200), *range(300, 400)]


def test_a_table_without_rows_is_empty_and_not_damaged(tmp_path: Path, frame: pd.DataFrame) -> None:
    path = tmp_path / "none.parquet"
    frame[:0].to_parquet(path)
    with pytest.raises(RecordingError, match="the table is empty"):
        recordings.read(path, channels=MAP)
    assert recordings.info(path).health == "good"


def test_a_column_that_a_torn_file_lacks_may_be_behind_the_damage(tmp_path: Path) -> None:
    path = tmp_path / "torn.mat"
    savemat(path, {"t": np.arange(300.0), "F": np.arange(300.0)})
    path.write_bytes(path.read_bytes()[:3000])
    channels = {"time": {"column": "t"}, "channels": {"force": {"column": "F", "unit": "N"}}}
    with pytest.raises(RecordingError, match=r"no column 'F'; the file is damaged or torn .*: t"):
        recordings.read(path, channels=channels)


def _pairs(folder: Path, head: str, shift: float) -> Path:
    rows = "".join(f"{k},{3 * k},{k + shift},{k * k}\n" for k in range(12))
    (folder / "pairs.csv").write_text(head + rows)
    return folder / "pairs.csv"


@pytest.mark.parametrize("shift", [0.0, 0.5])
@pytest.mark.parametrize("end", ["", ","])
def test_pairs_go_by_the_names_above_them(tmp_path: Path, shift: float, end: str) -> None:
    path = _pairs(tmp_path, f"Speed,,Current{end}\nX,Y,X,Y\n", shift)
    entries = {name: {"column": name, "unit": ""} for name in ("Speed", "Current")}
    found = recordings.read(path, channels={"time": {"column": "X"}, "channels": entries})
    # the time of each is its own; the recording begins where both are known
    time = found.time + np.ceil(shift)
    expected = np.interp(time, np.arange(12) + shift, np.arange(12.0) ** 2)
    assert found["Speed"] == pytest.approx(3 * time)
    assert found["Current"] == pytest.approx(expected)


@pytest.mark.parametrize("head", ["Speed,,Current,\nX,Y,X,Y\n", "X,Y,X,Y\n"])
def test_pairs_still_go_by_the_line_right_above_the_numbers(tmp_path: Path, head: str) -> None:
    path = _pairs(tmp_path, head, 0.0)
    entries = {name: {"column": name, "unit": ""} for name in ("Y", "X.1", "Y.1")}
    found = recordings.read(path, channels={"time": {"column": "X"}, "channels": entries})
    assert found["Y"].tolist() == [3 * k for k in range(12)]
    assert found["X.1"].tolist() == list(range(12))
    assert found["Y.1"].tolist() == [k * k for k in range(12)]


def test_one_x_and_one_y_are_no_pairs(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("Title,\nx,y\n0,1\n1,2\n2,4\n")
    assert [column.name for column in recordings.info(tmp_path / "log.csv").topics] == ["x", "y"]
