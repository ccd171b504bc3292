"""dataset.yaml: errors with file, line and key; holdout runs are not read on loading."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from drive_data import write_drive

from eha_bench.core.errors import InputError, RecordingError
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.fit.baseline import gather


def write(folder: Path, runs: str) -> Path:
    (folder / "model.yaml").write_text("model: eha_knee\ncalibrate: [leakage]\n")
    (folder / "b").mkdir(exist_ok=True)
    for name in ("a.mcap", "b/a.mcap"):
        (folder / name).write_bytes(b"not a recording")
    path = folder / "dataset.yaml"
    path.write_text(f"model: model.yaml\ninputs: [current_command]\nruns:\n{runs}")
    return path


def test_runs_are_not_read_on_loading(tmp_path):
    dataset = load_dataset(
        write(
            tmp_path,
            "  - {log: a.mcap, piston: locked, use: train}\n"
            "  - {log: b/a.mcap, bypass: open, use: holdout}\n",
        )
    )
    assert [run.name for run in dataset.runs] == ["a", "a-2"]
    assert dataset.training[0].locked
    assert dataset.held_out[0].bypass_open


def test_every_run_has_a_name_of_its_own(tmp_path):
    """What is predicted of a run is a file of its name: no run may write over another's."""
    path = write(tmp_path, "  - {log: a.mcap}\n  - {log: b/a.mcap}\n  - {log: a-2.csv}\n")
    (tmp_path / "a-2.csv").touch()
    (tmp_path / "A.csv").touch()
    path.write_text(path.read_text() + "  - {log: A.csv}\n")
    names = [run.name for run in load_dataset(path).runs]
    assert names == ["a", "a-2", "a-2-2", "A-3"]


def test_a_log_that_is_fitted_cannot_be_held_out(tmp_path):
    with pytest.raises(InputError, match=r"dataset\.yaml:5.*runs\.1\.log.*both.*held out"):
        load_dataset(write(tmp_path, "  - {log: a.mcap}\n  - {log: ./b/../a.mcap, use: holdout}\n"))


def test_a_missing_log_is_named_with_its_line(tmp_path):
    with pytest.raises(InputError, match=r"dataset\.yaml:5.*runs\.1\.log.*b\.mcap"):
        load_dataset(write(tmp_path, "  - {log: a.mcap}\n  - {log: b.mcap}\n"))


def test_an_unknown_word_is_named_with_its_line(tmp_path):
    with pytest.raises(InputError, match=r"dataset\.yaml:4.*piston"):
        load_dataset(write(tmp_path, "  - {log: a.mcap, piston: loose}\n"))


def test_a_dataset_without_training_is_refused(tmp_path):
    with pytest.raises(InputError, match="no run is for training"):
        load_dataset(write(tmp_path, "  - {log: a.mcap, use: holdout}\n"))


def test_a_log_that_cannot_be_read_costs_its_own_run(tmp_path):
    path = write_drive(tmp_path, seconds=0.5)
    (tmp_path / "broken.csv").write_bytes(b"\0" * 400)
    path.write_text(path.read_text() + "  - {log: broken.csv, use: train}\n")
    measured, _, _, notes = gather(load_dataset(path))
    assert [item.run.name for item in measured] == ["train"]
    assert any("broken.csv" in note and "left out" in note for note in notes)


def test_where_no_log_can_be_read_that_is_an_error(tmp_path):
    path = write_drive(tmp_path, seconds=0.5)
    (tmp_path / "train.csv").write_bytes(b"\0" * 400)
    with pytest.raises(RecordingError, match=r"train\.csv"):
        gather(load_dataset(path))


def test_a_log_of_more_than_a_day_has_another_unit_of_time(tmp_path):
    """Simulated in steps of a tenth of a millisecond it would take days, without a word."""
    path = write_drive(tmp_path, seconds=0.5)
    channels = tmp_path / "channels.yaml"
    channels.write_text(channels.read_text().replace("column: t, unit: s", "column: t, unit: week"))
    with pytest.raises(RecordingError, match=r"train\.csv: .* more than a day; check the unit"):
        gather(load_dataset(path))


def drive(tmp_path, runs: str, **options) -> Path:
    path = write_drive(tmp_path, seconds=1.0, **options)
    head = path.read_text().split("runs:")[0]
    path.write_text(f"{head}runs:\n{runs}")
    return path


def test_a_run_may_be_a_window_of_its_log(tmp_path):
    run = load_dataset(drive(tmp_path, "  - {log: train.csv, from: 0.2 s, to: 600 ms}\n")).runs[0]
    time = run.read().time
    assert (time[0], time[-1]) == pytest.approx((0.2, 0.598), abs=1e-9)


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ("{log: train.csv, from: 2 s, to: 1 s}", r"dataset\.yaml:5.*runs\.0\.to.*not after"),
        ("{log: train.csv, from: -1 s}", r"runs\.0\.from.*greater than or equal to 0"),
        ("{log: train.csv, to: 3 m}", r"runs\.0\.to.*wrong dimension"),
        ("{log: train.csv, piston: locked}", r"yaml:5.*runs\.0\.piston.*nothing to lock.*free"),
        ("{log: train.csv, bypass: open}", r"yaml:5.*runs\.0\.bypass.*no bypass.*closed"),
        ("{log: 'x*.csv'}", r"runs\.0\.log.*no log matches 'x\*\.csv'"),
        ("{log: train.csv, parameters: {mas: 3}}", r"runs\.0\.parameters\.mas.*did you mean"),
        ("{log: train.csv, parameters: {mass: 3 m}}", r"runs\.0\.parameters\.mass.*dimension"),
    ],
)
def test_a_wrong_run_is_told_with_line_and_key(tmp_path, entry, says):
    with pytest.raises(InputError, match=says):
        load_dataset(drive(tmp_path, f"  - {entry}\n"))


def test_a_window_beyond_the_log_is_told(tmp_path):
    dataset = load_dataset(drive(tmp_path, "  - {log: train.csv, from: 7 s}\n"))
    with pytest.raises(RecordingError, match="only 0 samples from 7 s on"):
        dataset.runs[0].read()


def test_a_window_that_ends_behind_the_log_is_noted(tmp_path):
    """The last sample of 0.998 s is held until 1 s: that is all of it, and no more."""
    runs = "".join(f"  - {{log: train.csv, to: {stop}}}\n" for stop in ("3 s", "1 s", "0.5 s"))
    beyond, whole, part = (run.read() for run in load_dataset(drive(tmp_path, runs)).runs)
    assert not [note for item in (whole, part) for note in item.notes if "the log ends" in note]
    (note,) = [note for note in beyond.notes if "the log ends" in note]
    assert "the log ends 0.998 s after its first sample" in note
    assert "(to: 3 s)" in note
    np.testing.assert_array_equal(beyond.time, whole.time)
    notes = gather(load_dataset(drive(tmp_path, runs)))[3]
    assert len([note for note in notes if note.startswith("train: the log ends")]) == 1


def test_parts_of_one_log_may_be_fitted_and_held_out(tmp_path):
    runs = "  - {log: train.csv, to: 0.5 s}\n  - {log: train.csv, from: 0.5 s, use: unseen}\n"
    dataset = load_dataset(drive(tmp_path, runs))
    assert [run.use for run in dataset.runs] == ["train", "unseen"]
    overlapping = runs.replace("from: 0.5", "from: 0.4")
    with pytest.raises(InputError, match="both for training and held out"):
        load_dataset(drive(tmp_path, overlapping))


def test_a_pattern_names_several_runs_in_order(tmp_path):
    dataset = load_dataset(drive(tmp_path, "  - {log: '*.csv', use: train}\n"))
    assert [run.name for run in dataset.runs] == ["held", "train"]


def test_channels_may_be_computed_for_all_runs(tmp_path):
    path = drive(tmp_path, "  - {log: train.csv, channels: channels.yaml}\n")
    path.write_text(path.read_text().replace(
        "channels: channels.yaml\ninputs: [reference]",
        "channels:\n  half: {expression: voltage / 2, unit: V}\ninputs: [half]",
    ))  # fmt: skip
    recording = load_dataset(path).runs[0].read()
    assert recording["half"] == pytest.approx(recording["voltage"] / 2)


def test_a_run_knows_parameters_of_its_own(tmp_path):
    runs = "  - {log: train.csv, parameters: {mass: 100 kg}}\n  - {log: held.csv}\n"
    dataset = load_dataset(drive(tmp_path, runs))
    layout = dataset.model.plant.layout
    at = layout.index["mass"]
    vectors = [run.vector(layout, dataset.model.vector()) for run in dataset.runs]
    assert [vector[at] for vector in vectors] == [100.0, 95.0]


@pytest.mark.parametrize(
    ("model", "inputs"),
    [("eha_knee", ("current_command",)), ("geared_servo", ("duty",))],
)
def test_inputs_that_are_left_out_are_those_of_the_plant(tmp_path, model, inputs):
    path = write(tmp_path, "  - {log: a.mcap}\n")
    path.write_text(path.read_text().replace("inputs: [current_command]\n", ""))
    (tmp_path / "model.yaml").write_text(f"model: {model}\ncalibrate: []\n")
    assert load_dataset(path).inputs == inputs
