"""Tables in which slower channels fill their column only now and then."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench import recordings
from eha_bench.core.errors import RecordingError
from eha_bench.recordings.tables.csv_layout import CsvLayout

NAMES = ["zeit", "i_A", "p1", "Kommentar", "2", "x3"]
UNITS = ["s", "A", "bar", "-", "mm", "V"]
HEADS = {
    "names": [NAMES],
    "names and units": [NAMES, UNITS],
    "names, units and descriptions": [NAMES, UNITS, [f"what is {name}" for name in NAMES]],
    "a preamble": [["Logger 7"], [], ["Serial 12"], NAMES],
    "a comment": [["# rig 2"], NAMES],
    "none": [],
}
NUMBER = st.one_of(st.floats(-1e6, 1e6, allow_nan=False).map(repr), st.integers(-999, 999).map(str))


@pytest.mark.parametrize("every", [2, 3, 10, 500])
@pytest.mark.parametrize("first", [0, 1, 7])
@pytest.mark.parametrize("missing", ["", "nan", "NaN", "-", "null"])
def test_a_column_filled_every_few_rows(
    tmp_path: Path, every: int, first: int, missing: str
) -> None:
    rows = [
        f"{k / 1000:.3f},{k},{80 + k if k % every == first % every else missing}\n"
        for k in range(1000)
    ]
    (tmp_path / "a.csv").write_text("t,i,p\n" + "".join(rows))
    channels = {"current": {"column": "i"}, "pressure_a": {"column": "p", "unit": "bar"}}
    back = recordings.read(
        tmp_path / "a.csv", channels={"time": {"column": "t"}, "channels": channels}
    )
    assert len(back) == 1000
    there = np.arange(1000) % every == first % every
    assert np.array_equal(np.isfinite(back["pressure_a"]), there)
    assert np.allclose(back["pressure_a"][there], (80 + np.flatnonzero(there)) * 1e5)


def test_two_sensors_that_take_turns(tmp_path: Path) -> None:
    rows = [f"{k},{k},," if k % 2 else f"{k},,{k},{k}" for k in range(40)]
    (tmp_path / "a.csv").write_text("t,i,pa,pb\n" + "\n".join(rows) + "\n")
    channels = {"current": {"column": "i"}, "pressure_b": {"column": "pb"}}
    mapping = {"time": {"column": "t", "unit": "ms"}, "channels": channels}
    back = recordings.read(tmp_path / "a.csv", channels=mapping)
    assert np.nansum(back["current"]) == sum(range(1, 40, 2))
    assert np.nansum(back["pressure_b"]) == sum(range(0, 40, 2))


def test_rows_of_one_stamp_that_hold_other_channels_are_joined(tmp_path: Path) -> None:
    rows = [f"{k},{k},,\n" + (f"{k},,{k},{k}\n" if k % 3 else f"{k}.4,,{k},\n") for k in range(30)]
    (tmp_path / "a.csv").write_text("t,i,pa,pb\n" + "".join(rows))
    channels = {name: {"column": name[0] + name[9:]} for name in ("pressure_a", "pressure_b")}
    channels["current"] = {"column": "i"}
    mapping = {"time": {"column": "t", "unit": "ms"}, "channels": channels}
    back = recordings.read(tmp_path / "a.csv", channels=mapping)
    assert any("20 rows share the stamp" in str(note) for note in back.notes)
    assert len(back) == 40
    assert np.array_equal(back["current"][np.isfinite(back["current"])], np.arange(30.0))
    assert np.nansum(back["pressure_b"]) == sum(k for k in range(30) if k % 3)
    assert np.all(np.diff(back.time) > 0.0)


def test_rows_of_one_stamp_that_hold_the_same_channel_are_not_joined(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,i,pa\n0,1,\n0,,2\n1,3,\n1,4,5\n2,5,6\n")
    mapping = {"time": {"column": "t"}, "channels": {"current": {"column": "i"}}}
    with pytest.raises(RecordingError, match="2 samples repeat the stamp"):
        recordings.read(tmp_path / "a.csv", channels=mapping)


def test_rows_before_the_first_sensor_speaks(tmp_path: Path) -> None:
    rows = [f"2025-03-01T12:00:{k:02d},{k if k > 5 else ''},\n" for k in range(60)]
    (tmp_path / "a.csv").write_text("t,i,p\n" + "".join(rows))
    mapping = {"time": {"column": "t"}, "channels": {"current": {"column": "i"}}}
    back = recordings.read(tmp_path / "a.csv", channels=mapping)
    assert len(back) == 60
    assert back.epoch_ns == 1_740_830_400_000_000_000


@st.composite
def tables(draw: st.DrawFn) -> tuple[str, str, int, list[str]]:
    """A table's text, its delimiter, the line of its first row from 0, and its names."""
    columns = draw(st.integers(2, len(NAMES)))
    delimiter = draw(st.sampled_from(";,\t|"))
    comma = delimiter != "," and draw(st.booleans())
    head = draw(st.sampled_from(list(HEADS)))
    named = head != "none"
    dated, remarks = named and draw(st.booleans()), named and draw(st.booleans())
    missing = draw(st.sampled_from(["", "nan", "-", "null", '""']))
    lines = [delimiter.join(line[:columns]) for line in HEADS[head]]
    first = len(lines)
    for k in range(draw(st.integers(4, 40))):
        row = [f"2025-03-01 12:00:{k:02d}" if dated else f"{k}.5"]
        for column in range(1, columns):
            word = remarks and column == 3
            cell = draw(st.sampled_from(["on", "off", "valve opened"]) if word else NUMBER)
            row.append(cell if draw(st.booleans()) else "" if word else missing)
        if k == 3:  # no table of words alone: nothing tells names from what is below them
            row[1] = "7"
        text = delimiter.join(row)
        lines.append(text.replace(".", ",") if comma else text)
    names = NAMES[:columns] if named else [str(k) for k in range(columns)]
    return "\n".join(lines) + "\n", delimiter, first, names


@given(tables())
def test_the_table_is_found_however_little_of_it_is_filled_in(
    table: tuple[str, str, int, list[str]],
) -> None:
    text, delimiter, first, names = table
    found = CsvLayout.of(text)
    assert (found.delimiter, found.first, list(found.names)) == (delimiter, first, names)
