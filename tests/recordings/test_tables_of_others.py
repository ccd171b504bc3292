"""Tables as measuring programs and people with a spreadsheet leave them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eha_bench import recordings
from eha_bench.core.errors import RecordingError

ROWS = range(100)


def read(tmp_path: Path, text: str, time: dict[str, str], *columns: str) -> Any:
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    names = ("pressure_a", "pressure_b")
    channels = {
        name: {"column": column, "unit": "bar"}
        for name, column in zip(names, columns, strict=False)
    }
    return recordings.read(path, channels={"time": time, "channels": channels})


@pytest.mark.parametrize("missing", ["", "#N/A", "#DIV/0!", "#NV", "NaN", "-", "None"])
def test_a_missing_cell_costs_nothing_beside_it(tmp_path: Path, missing: str) -> None:
    lines = [f"{k / 100},{missing if k % 7 == 0 else k},{k}\n" for k in ROWS]
    back = read(tmp_path, "t,q,p\n" + "".join(lines), {"column": "t", "unit": "s"}, "p", "q")
    assert np.allclose(back["pressure_a"], np.array(ROWS) * 1e5)
    assert np.array_equal(np.isnan(back["pressure_b"]), np.array(ROWS) % 7 == 0)


def test_a_comment_behind_a_number_is_left_aside(tmp_path: Path) -> None:
    lines = [f"{k / 100},{k}{' # valve opened' if k == 20 else ''}\n" for k in ROWS]
    back = read(tmp_path, "t,p\n" + "".join(lines), {"column": "t", "unit": "s"}, "p")
    assert np.allclose(back["pressure_a"], np.array(ROWS) * 1e5)


@pytest.mark.parametrize(
    ("written", "epoch"),
    [
        ("2025-03-01T12:00:{:06.3f}+01:00", 1_740_826_800),
        ("2025-03-01 12:00:{:06.3f}Z", 1_740_830_400),
        ("2025-03-01 12:00:{:06.3f} UTC", 1_740_830_400),
        ("01.03.2025 12:00:{:06.3f}", 1_740_830_400),
        ("12:00:{:06.3f}", 12 * 3600),
    ],
)
@pytest.mark.parametrize("comma", [False, True])
def test_times_as_text(tmp_path: Path, written: str, epoch: int, comma: bool) -> None:
    lines = [f"{written.format(k / 10)};{k + 0.5}\n" for k in ROWS]
    text = "".join(lines).replace(".", ",") if comma else "".join(lines)
    if comma:
        text = text.replace("01,03,2025", "01.03.2025")
    back = read(tmp_path, "Zeit;p\n" + text, {"column": "Zeit"}, "p")
    assert back.epoch_ns == epoch * 10**9
    assert np.allclose(back.time, np.array(ROWS) / 10, rtol=0, atol=1e-12)
    assert np.allclose(back["pressure_a"], (np.array(ROWS) + 0.5) * 1e5)


def test_hours_that_change_with_the_season_do_not_move_the_time(tmp_path: Path) -> None:
    lines = [
        f"2025-03-30T01:59:{50 + k / 10:06.3f}+01:00,{k}\n"
        if k < 100
        else f"2025-03-30T03:00:{(k - 100) / 10:06.3f}+02:00,{k}\n"
        for k in range(200)
    ]
    back = read(tmp_path, "t,p\n" + "".join(lines), {"column": "t"}, "p")
    assert np.allclose(np.diff(back.time), 0.1)


@pytest.mark.parametrize("time", ["03/01/2025 12:00:01", "yesterday", "12:00"])
def test_a_time_that_may_be_two_is_refused_with_its_line(tmp_path: Path, time: str) -> None:
    lines = [f"2025-03-01 12:00:{k:02d},{k}\n" for k in range(50)]
    lines[20] = f"{time},20\n"
    with pytest.raises(RecordingError, match=r"log\.csv:22: .* neither a number nor a time"):
        read(tmp_path, "t,p\n" + "".join(lines), {"column": "t"}, "p")


def test_units_and_descriptions_below_the_names(tmp_path: Path) -> None:
    head = "time;p1;T\nsec;bar;°C\n-;Pressure sensor 1;Oil temperature\n"
    lines = [f"{k / 100};{k};{40 + k / 10}\n".replace(".", ",") for k in ROWS]
    back = read(tmp_path, head + "".join(lines), {"column": "time", "unit": "s"}, "p1")
    assert np.allclose(back["pressure_a"], np.array(ROWS) * 1e5)
    assert any("line 2 was taken as units" in note for note in back.notes)


def test_a_labview_table_with_a_name_for_comments(tmp_path: Path) -> None:
    head = "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\nChannels\t2\t\t\n"
    head += "Delta_X\t0.01\t0.01\n***End_of_Header***\t\t\t\nX_Value\tp\tq\tComment\n"
    lines = [f"{k / 100:.6f}\t{k}\t{-k}\n" for k in ROWS]
    back = read(tmp_path, head + "".join(lines), {"column": "X_Value", "unit": "s"}, "p", "q")
    assert np.allclose(back["pressure_b"], -np.array(ROWS) * 1e5)
    assert any("Comment" in note for note in back.notes)


def test_a_workbook_is_refused_with_the_way_out(tmp_path: Path) -> None:
    path = tmp_path / "log.xlsx"
    path.write_bytes(b"PK\x03\x04" + bytes(100))
    with pytest.raises(RecordingError, match="save its sheet as CSV"):
        recordings.read(path)
