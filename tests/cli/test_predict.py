"""`eha-bench predict` as a user calls it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from eha_bench import recordings
from eha_bench.core.errors import RecordingError
from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import load_dataset

CHANNELS = """\
time: {column: t, unit: s}
channels:
  current_command: {column: i, unit: A}
  pressure_a:      {column: p, unit: bar}
"""


def write_dataset(folder: Path) -> None:
    generator = np.random.default_rng(2)
    for name in ("one", "two"):
        pressure = 6.0 + 0.3 * generator.standard_normal(200)
        rows = (f"{k / 1e3:.3f},0.0,{value:.4f}\n" for k, value in enumerate(pressure))
        (folder / f"{name}.csv").write_text("t,i,p\n" + "".join(rows))
    (folder / "channels.yaml").write_text(CHANNELS)
    (folder / "model.yaml").write_text("model: eha_knee\n")
    (folder / "dataset.yaml").write_text(
        "model: model.yaml\nchannels: channels.yaml\nruns:\n"
        "  - {log: one.csv, piston: locked}\n  - {log: two.csv, piston: locked, use: holdout}\n"
    )


def test_json_is_one_document_of_the_files_with_errors_and_notes(cli, tmp_path) -> None:
    write_dataset(tmp_path)
    arguments = ("predict", "dataset.yaml", "--model", "model.yaml", "--out", "out")
    done = cli(*arguments, "--json", check=0)
    found = json.loads(done.stdout)
    assert [item["run"] for item in found["runs"]] == ["one", "two"]
    for item in found["runs"]:
        assert (tmp_path / "out" / item["file"]).exists()
        assert item["error"]["pressure_a"]["unit"] == "Pa"
        assert item["error"]["pressure_a"]["rms"] > 1e4
        assert "motor_speed" not in item["error"]
        assert any("assumed: motor_speed at 0 rad/s" in note for note in item["notes"])
        # people read the same
        assert all(note in done.stderr for note in item["notes"])
    assert json.loads((tmp_path / "out" / "prediction.json").read_text()) == found
    # without --json: the folder alone; and without --model it is the dataset's
    assert cli("predict", "dataset.yaml", "--out", "out", check=0).stdout == "out\n"
    assert json.loads((tmp_path / "out" / "prediction.json").read_text()) == found


def test_inputs_that_drive_nothing_leave_no_folder(cli, tmp_path) -> None:
    write_dataset(tmp_path)
    path = tmp_path / "dataset.yaml"
    path.write_text(path.read_text() + "inputs: [pressure_a]\n")
    done = cli("predict", "dataset.yaml", "--model", "model.yaml", "--out", "out", check=2)
    assert "dataset.yaml:6, key 'inputs': nothing that eha_knee gives is driven by" in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_window_by_the_stamps_of_the_log_is_said_from_its_first_sample(cli, tmp_path) -> None:
    write_dataset(tmp_path)
    log = tmp_path / "one.csv"
    head, *rows = log.read_text().splitlines()
    late = (f"{float(row.partition(',')[0]) + 5:.3f},{row.partition(',')[2]}" for row in rows)
    log.write_text("\n".join((head, *late)))
    path = tmp_path / "dataset.yaml"
    whole = path.read_text()
    predict = ("predict", "dataset.yaml", "--out", "out")
    path.write_text(whole.replace("one.csv,", "one.csv, from: 5.05 s, to: 5.15 s,"))
    done = cli(*predict, check=2)
    assert "only 0 samples from 5.05 s to 5.15 s" in done.stderr
    way = "'from' and 'to' count from the log's first sample"
    assert f"{way}, which is stamped 5 s: give from: 0.05 s, to: 0.15 s" in done.stderr
    # as it says
    path.write_text(whole.replace("one.csv,", "one.csv, from: 0.05 s, to: 0.15 s,"))
    cli(*predict, check=0)
    (found, _) = json.loads((tmp_path / "out" / "prediction.json").read_text())["runs"]
    assert abs(found["samples"] - 100) <= 1
    assert found["epoch_ns"] == 5_000_000_000
    # and where no reading of it leaves anything
    path.write_text(whole.replace("one.csv,", "one.csv, from: 3 s,"))
    assert f"{way}, and the log lasts 0.199 s" in cli(*predict, check=2).stderr


def test_stamps_since_1970_are_said_with_all_their_digits(cli, tmp_path) -> None:
    write_dataset(tmp_path)
    log = tmp_path / "one.csv"
    head, *rows = log.read_text().splitlines()
    first = 1_718_060_000
    late = (
        f"{first + k // 1000}.{k % 1000:03d},{row.partition(',')[2]}" for k, row in enumerate(rows)
    )
    log.write_text("\n".join((head, *late)))
    path = tmp_path / "dataset.yaml"
    window = f"from: {first}.05 s, to: {first}.15 s"
    path.write_text(path.read_text().replace("one.csv,", f"one.csv, {window},"))
    done = cli("predict", "dataset.yaml", "--out", "out", check=2)
    assert f"only 0 samples from {first}.05 s to {first}.15 s" in done.stderr
    assert f"is stamped {first} s: give from: 0.05 s, to: 0.15 s" in done.stderr


def test_a_window_of_topics_is_said_from_the_earliest_of_them(
    cli, tmp_path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_dataset(tmp_path)
    path = tmp_path / "dataset.yaml"
    path.write_text(path.read_text().replace("one.csv,", "one.csv, from: 5.5 s, to: 5.6 s,"))
    early = Recording(np.array([5.0, 5.2, 6.5]), {"current_command": np.zeros(3)})
    long = Recording(5.25 + np.arange(10) / 1e2, {"pressure_a": np.ones(10)})
    monkeypatch.setattr(recordings, "read_topics", lambda *_, **__: (early, long))
    by_topic = load_dataset(path).training[0].by_topic
    assert by_topic is not None
    with pytest.raises(RecordingError, match=r"is stamped 5 s: give from: 0\.5 s, to: 0\.6 s"):
        by_topic()


def test_readings_beyond_all_sensors_are_refused_without_a_page_of_warnings(
    cli, tmp_path, recwarn
) -> None:
    write_dataset(tmp_path)
    log = tmp_path / "one.csv"
    head, *rows = log.read_text().splitlines()
    log.write_text("\n".join((head, *(f"{row}e199" for row in rows))))
    (tmp_path / "model.yaml").write_text("model: eha_knee\ncalibrate: [leakage]\n")
    done = cli("calibrate", "dataset.yaml", "--out", "out", check=2)
    assert "one.csv, at 0" in done.stderr
    assert "s: 'pressure_a' reads" in done.stderr
    assert "e+204 Pa, as no sensor does; check its column, unit and scale" in done.stderr
    assert not [item for item in recwarn if issubclass(item.category, RuntimeWarning)]


def test_single_readings_beyond_all_sensors_are_marks_of_invalid_samples(
    cli, tmp_path, recwarn
) -> None:
    write_dataset(tmp_path)
    log = tmp_path / "one.csv"
    head, *rows = log.read_text().splitlines()
    for k, mark in ((50, "1.79e308"), (51, "-1.79e308"), (120, "1.79e303")):
        rows[k] = f"{rows[k].rpartition(',')[0]},{mark}"
    # in bar: the largest numbers are infinite in Pa, which is missing without a word of this
    log.write_text("\n".join((head, *rows)))
    done = cli("predict", "dataset.yaml", "--out", "out", check=0)
    said = "readings of 'pressure_a' beyond all sensors (1.79e+308 Pa), taken as missing: 1"
    assert f"one: {said}" in done.stderr
    channels = tmp_path / "channels.yaml"
    channels.write_text(CHANNELS.replace("bar", "Pa"))
    done = cli("predict", "dataset.yaml", "--out", "out", "--json", check=0)
    said = "readings of 'pressure_a' beyond all sensors (1.79e+308 Pa), taken as missing: 3"
    assert f"one: {said}" in done.stderr
    error = json.loads(done.stdout)["runs"][0]["error"]["pressure_a"]
    assert 0.0 < error["rms"] < 1e9
    assert not [item for item in recwarn if issubclass(item.category, RuntimeWarning)]


def test_no_input_is_said_as_none(cli, tmp_path) -> None:
    write_dataset(tmp_path)
    path = tmp_path / "dataset.yaml"
    path.write_text(path.read_text() + "inputs: []\n")
    (tmp_path / "plant.yaml").write_text(
        "plant: spindle\nnodes: {shaft: {kind: rotation, inertia: 9e-4 kg*m^2}}\n"
        "elements:\n  motor: {kind: motor, on: shaft, torque_constant: 0.13 N*m/A}\n"
        "inputs: {current_command: motor.current}\nchannels: {motor_speed: shaft.speed}\n"
    )
    done = cli("predict", "dataset.yaml", "--model", "plant.yaml", "--out", "out", check=2)
    assert "'inputs' is empty, and nothing that spindle gives moves by itself" in done.stderr
