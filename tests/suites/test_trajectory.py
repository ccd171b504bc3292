"""A trajectory comes from a CSV file in the suite's folder, and from nowhere else."""

import math
from pathlib import Path

import numpy as np
import pytest
from writing import only, refusal, with_signal

from eha_bench.suites import trial_from_source

CSV = "t,angle,note\n0,50,a\n500,60,b\n1500,55,c\n"
SIGNAL = (
    "{kind: trajectory, file: walk.csv, time: {column: t, unit: ms},"
    " value: {column: angle, unit: deg}}"
)
TEXT = with_signal(SIGNAL, "joint_angle").replace("    duration: 1 s\n", "")


def test_trajectory_is_read_in_si(tmp_path: Path) -> None:
    (tmp_path / "walk.csv").write_text(CSV)
    trial = only(tmp_path, TEXT)
    assert trial.duration == 1.5
    values = trial.reference(np.array([-1.0, 0.0, 0.25, 0.5, 1.0, 1.5, 9.0]))
    np.testing.assert_allclose(np.degrees(values), [50, 50, 55, 60, 57.5, 55, 55])


def test_recording_needs_no_file(tmp_path: Path) -> None:
    (tmp_path / "walk.csv").write_text(CSV)
    trial = only(tmp_path, TEXT)
    (tmp_path / "walk.csv").unlink()
    assert trial_from_source(trial.source) == trial
    assert trial.signal.whole.file == "walk.csv"


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("prefix", ["", "\ufeff", "# made by hand\n\n"])
def test_dialects(tmp_path: Path, separator: str, prefix: str) -> None:
    (tmp_path / "walk.csv").write_text(prefix + CSV.replace(",", separator), encoding="utf-8")
    assert only(tmp_path, TEXT).duration == 1.5


def test_time_starts_at_zero_whatever_the_log_says(tmp_path: Path) -> None:
    (tmp_path / "walk.csv").write_text("t,angle\n1000,50\n2000,60\n")
    assert only(tmp_path, TEXT).duration == 1.0


def test_folders_below_the_suite_are_read(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "walk.csv").write_text(CSV)
    assert only(tmp_path, TEXT.replace("walk.csv", "data/walk.csv")).duration == 1.5


@pytest.mark.parametrize(
    "name", ["/etc/passwd", "../walk.csv", "a/../../walk.csv", "C:/walk.csv", "..\\walk.csv"]
)
def test_no_other_place_is_read(tmp_path: Path, name: str) -> None:
    (tmp_path.parent / "walk.csv").write_text(CSV)
    error = refusal(tmp_path, TEXT.replace("walk.csv", f"'{name}'"))
    assert "is outside the suite's folder" in error.what
    assert error.where.key == "trials.one.signal.file"


def test_missing_file_is_placed_in_the_suite(tmp_path: Path) -> None:
    error = refusal(tmp_path, TEXT)
    assert "there is no file 'walk.csv' in the suite's folder" in error.what
    assert (error.where.key, error.where.line) == ("trials.one.signal.file", 5)


@pytest.mark.parametrize(
    ("old", "new", "key", "what"),
    [
        ("unit: deg", "unit: MPa", "value", "wrong dimension"),
        ("unit: ms", "unit: deg", "time", "wrong dimension"),
        ("file: walk.csv,", "", "", "needs 'file' and 'value'"),
        (", value: {column: angle, unit: deg}", "", "", "needs 'file' and 'value'"),
        ("column: t,", "", "time.column", "missing"),
    ],
)
def test_wrong_keys(tmp_path: Path, old: str, new: str, key: str, what: str) -> None:
    (tmp_path / "walk.csv").write_text(CSV)
    error = refusal(tmp_path, TEXT.replace(old, new))
    assert what in error.what
    assert error.where.key == ".".join(filter(None, ("trials.one.signal", key)))


@pytest.mark.parametrize(
    ("csv", "line", "key", "what"),
    [
        ("", 0, "", "empty"),
        ("t,angle\n", 0, "", "fewer than two rows"),
        ("t,angle\n0,50\n", 0, "", "fewer than two rows"),
        ("time,angle\n0,1\n1,2\n", 1, "", "no column 't'"),
        ("t,angel\n0,1\n1,2\n", 1, "", "did you mean 'angel'"),
        ("t,angle\n0,50\n1,x\n2,3\n", 3, "angle", "'x' is not a finite number"),
        ("t,angle\n0,50\n1,nan\n2,3\n", 3, "angle", "'nan' is not a finite number"),
        ("t,angle\n0,50\n1\n2,3\n", 3, "angle", "'' is not a finite number"),
        ("t,angle\n0,50\n\n2,51\n1,3\n", 5, "t", "time does not increase"),
        ("t,angle\n0,50\n0,51\n", 3, "t", "time does not increase"),
    ],
)
def test_wrong_table_names_its_own_line(
    tmp_path: Path, csv: str, line: int, key: str, what: str
) -> None:
    (tmp_path / "walk.csv").write_text(csv)
    error = refusal(tmp_path, TEXT)
    assert what in str(error)
    assert error.where.file.endswith("walk.csv")
    assert (error.where.line, error.where.key) == (line, key)


def test_samples_may_stand_in_the_suite(tmp_path: Path) -> None:
    signal = "{kind: trajectory, samples: {time: [0, 1], value: [1.0, 2.0]}}"
    trial = only(tmp_path, with_signal(signal, "joint_angle"))
    assert trial.reference(np.array([0.5]))[0] == 1.5
    wrong = with_signal(signal.replace("[0, 1]", "[1, 0]"), "joint_angle")
    assert "does not increase" in refusal(tmp_path, wrong).what
    assert math.isfinite(trial.duration)
