"""Prediction: own recordings come back, at the log's stamps, from inputs and first sample only."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import eha_bench as eb
from eha_bench.core.errors import InputError
from eha_bench.core.linkage import Linkage
from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Dataset, Run, Use
from eha_bench.diagnosis.fit.baseline import gather
from eha_bench.diagnosis.replay.first_sample import first_state
from eha_bench.diagnosis.replay.prediction import STEP, predict, simulate_from
from eha_bench.diagnosis.replay.replay import replay
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive

MODEL = Model(
    "eha_knee",
    {"rotor_inertia": 0.001, "current_limit": 36.0},
    (),
    (DeclaredEffect("anti_cavitation", {"charge_pressure": 0.6e6}),),
)


def simulated(n: int = 400) -> Recording:
    time = np.arange(n) * 1e-3
    command = np.where(time > 0.02, 6.0, 0.0) + 2.0 * np.sin(2 * np.pi * 5 * time)
    drive = Drive(
        time,
        {"current_command": command},
        {"pressure_a": 0.6e6, "pressure_b": 0.6e6},
        locked=True,
    )
    plant = MODEL.plant
    values = plant.simulate(MODEL.vector(), drive, STEP)
    columns = {name: values[:, k] for k, name in enumerate(plant.outputs)}
    return Recording(time + 3.0, {"current_command": command, **columns})


def dataset(recording: Recording) -> Dataset:
    run = Run("one", Path("one.mcap"), None, True, False, Use.HOLDOUT, lambda: recording)
    return Dataset(MODEL, ("current_command",), (run,))


def test_a_simulated_recording_is_predicted_again(tmp_path):
    recording = simulated()
    (found,) = predict(dataset(recording), out=tmp_path)
    for name in ("motor_speed", "pressure_a", "pressure_b", "current"):
        scale = float(np.ptp(recording[name]))
        assert np.abs(found.values[name] - recording[name]).max() < 1e-6 * scale
    table = pq.read_table(tmp_path / "one.parquet").to_pandas()
    assert "pressure_difference" in table
    assert table["time"].to_numpy() == pytest.approx(recording.time)


def test_only_the_first_sample_of_an_output_is_used():
    recording = simulated()
    changed = {
        name: np.concatenate([np.array(recording[name][:1]), np.array(recording[name][1:]) * 1.5])
        for name in ("motor_speed", "pressure_a", "pressure_b")
    }
    (one,) = predict(dataset(recording))
    (other,) = predict(dataset(recording.with_values(changed)))
    assert other.values["pressure_a"] == pytest.approx(one.values["pressure_a"])


def test_a_measured_speed_may_drive_the_model():
    recording = simulated()
    driven = Dataset(MODEL, ("motor_speed",), dataset(recording).runs)
    (found,) = predict(driven)
    assert "motor_speed" not in found.values
    error = np.abs(found.values["pressure_a"] - recording["pressure_a"]).max()
    assert error < 0.02 * float(np.ptp(recording["pressure_a"]))


def test_what_nothing_drives_is_left_out_and_the_rest_predicted():
    """A log of pressures and position without a current says nothing of the shaft's speed."""
    recording = simulated()
    noise = 1e-6 * np.random.default_rng(1).standard_normal(len(recording))
    values = {**recording.values, "piston_position": recording["piston_position"] + noise}
    read = Recording(recording.time, values)
    run = Run("one", Path("one.mcap"), None, False, False, Use.TRAIN, lambda: read)
    pressures = Dataset(MODEL, ("pressure_a", "pressure_b"), (run,))
    (found,) = predict(pressures)
    assert set(found.values) == {"piston_position", "piston_velocity"}
    measured, _, noises, notes = gather(pressures)
    assert "motor_speed" not in measured[0].outputs
    assert "piston_position" in noises
    assert "motor_speed" not in noises
    assert any("'motor_speed' is not compared" in note for note in notes)


def test_what_was_bridged_in_an_input_is_said():
    recording = simulated()
    command = np.array(recording["current_command"])
    command[50:80] = np.nan
    (found,) = predict(dataset(recording.with_values({"current_command": command})))
    assert any("gaps of input 'current_command', bridged: 30" in note for note in found.notes)


# ---- where a prediction begins


def freely(
    values: dict[str, np.ndarray], *, locked: bool = False, inputs: tuple[str, ...] = ()
) -> Dataset:
    """Return a dataset of one recording of a steady command and what is given."""
    n = next(iter(values.values())).size
    recording = Recording(np.arange(n) * 1e-3, {"current_command": np.zeros(n), **values})
    run = Run("one", Path("one.mcap"), None, locked, False, Use.TRAIN, lambda: recording)
    return Dataset(MODEL, inputs or ("current_command",), (run,), "dataset.yaml")


def only_first(value: float, n: int = 100) -> np.ndarray:
    return np.concatenate([[value], np.full(n - 1, np.nan)])


@pytest.mark.parametrize("column", [only_first, lambda value: np.full(100, value)])
def test_it_begins_at_the_first_sample_whatever_follows(column):
    """Outputs that are there in the first row only, or never change, are a first sample as well."""
    first = {
        "pressure_a": 8e6,
        "pressure_b": 3e6,
        "motor_speed": 52.0,
        "piston_position": 0.004,
        "piston_velocity": 0.01,
        "current": 1.0,
    }
    (found,) = predict(freely({name: column(value) for name, value in first.items()}))
    for name, value in first.items():
        assert found.values[name][0] == pytest.approx(value), name
        assert name not in found.errors
    assert not any("assumed" in note for note in found.notes)
    assert any("'pressure_a' starts at its first reading, 8e+06 Pa" in n for n in found.notes)


def test_readings_that_are_stuck_at_first_are_begun_with():
    """A speed stuck for the first 60 samples is not believed there, but it is what was read."""
    (found,) = predict(freely({"motor_speed": stuck_at_first(12.0)}))
    assert found.values["motor_speed"][0] == pytest.approx(12.0)


def test_a_first_reading_that_is_late_is_said():
    noise = 1e4 * np.random.default_rng(4).standard_normal((2, 200))
    values = {"pressure_a": 8e6 + noise[0], "pressure_b": 3e6 + noise[1]}
    values["pressure_a"][:3] = np.nan
    (found,) = predict(freely(values))
    assert found.values["pressure_a"][0] == pytest.approx(values["pressure_a"][3])
    assert any("the first sample has no 'pressure_a'" in n and "0.003 s" in n for n in found.notes)


def test_the_position_is_that_of_the_joint():
    """Known answer: c0 + x + half the stroke closes the triangle of the two links."""
    vector, layout = MODEL.vector(), MODEL.plant.layout
    a, b, c0, volume, area = (
        vector[layout.index[name]]
        for name in ("link_a", "link_b", "link_c0", "volume_a", "piston_area_a")
    )
    angle = Linkage(a, b, c0, volume / area).angle_at(-0.0267)
    (found,) = predict(freely({"joint_angle": np.full(100, angle)}))
    assert found.values["piston_position"][0] == pytest.approx(-0.0267, abs=1e-9)
    assert found.values["joint_angle"][0] == pytest.approx(angle, abs=1e-9)
    assert any("no 'piston_position'" in n and "-0.0267 m" in n for n in found.notes)
    (held,) = predict(freely({"joint_angle": np.full(100, angle)}, locked=True))
    assert held.values["piston_position"] == pytest.approx(np.full(100, -0.0267), abs=1e-9)


def test_a_joint_angle_is_compared_where_it_was_measured():
    recording = simulated()
    vector, plant = MODEL.vector(), MODEL.plant
    position = recording["piston_position"] + 1e-5 * np.sin(np.arange(len(recording)))
    angle = plant.linkage(vector).angle(position)
    values = {k: v for k, v in recording.values.items() if k != "piston_position"}
    (found,) = predict(dataset(Recording(recording.time, {**values, "joint_angle": angle})))
    expected = np.sqrt(np.mean((angle - found.values["joint_angle"]) ** 2))
    assert found.errors["joint_angle"] == pytest.approx(expected)
    assert "joint_angle" not in predict(dataset(recording))[0].values


@pytest.mark.parametrize(("difference", "low"), [(5e6, "pressure_b"), (-2e6, "pressure_a")])
def test_a_pressure_difference_is_begun_with(difference, low):
    (found,) = predict(freely({"pressure_difference": np.full(100, difference)}))
    assert found.values["pressure_difference"][0] == pytest.approx(difference)
    assert found.values[low][0] == pytest.approx(0.6e6)
    assert any("600000 Pa, which is assumed" in note for note in found.notes)
    both = {"pressure_difference": np.full(100, difference), "pressure_a": np.full(100, 4e6)}
    (found,) = predict(freely(both))
    assert found.values["pressure_b"][0] == pytest.approx(4e6 - difference)


def test_every_state_that_was_assumed_is_said_with_its_value():
    (found,) = predict(freely({"force": np.zeros(100)}))
    (note,) = (note for note in found.notes if "assumed" in note)
    for name, value in (
        ("motor_speed", "0 rad/s"),
        ("pressure_a", "600000 Pa"),
        ("pressure_b", "600000 Pa"),
        ("piston_position", "0 m"),
        ("piston_velocity", "0 m/s"),
        ("current", "0 A"),
    ):
        assert f"{name} at {value}" in note
    # what is held is known to stand still, and what is measured is not assumed
    (found,) = predict(freely({"piston_position": np.full(100, 0.01)}, locked=True))
    (note,) = (note for note in found.notes if "assumed" in note)
    assert "piston" not in note


@pytest.mark.parametrize("read", [{"pressure_a": 4e6}, {}])
def test_what_is_assumed_is_what_is_simulated_from(read):
    """Without a declared charge a chamber begins as the other, or as the model's rest."""
    model = Model("eha_knee", {"initial_pressure": 5e5})
    values = {"force": np.zeros(100), **{k: np.full(100, v) for k, v in read.items()}}
    (found,) = predict(replace(freely(values), model=model))
    (note,) = (note for note in found.notes if "assumed" in note)
    expected = next(iter(read.values()), 5e5)
    assert found.values["pressure_b"][0] == pytest.approx(expected)
    assert f"pressure_b at {expected:.6g} Pa" in note


def test_a_voltage_that_is_assumed_is_the_state_and_not_what_is_asked_for():
    recording = Recording(np.arange(50) * 1e-3, {"reference": np.full(50, 0.01)})
    run = Run("one", Path("one.csv"), None, False, False, Use.TRAIN, lambda: recording)
    (found,) = predict(Dataset(Model("linear_drive"), ("reference",), (run,)))
    assert found.values["voltage"][0] > 100.0
    (note,) = found.notes
    assert "voltage at 0 V" in note


def stuck_at_first(value: float = 12.0) -> np.ndarray:
    noise = np.random.default_rng(3).standard_normal(400)
    speed = 20.0 + 0.1 * noise + np.linspace(0.0, 30.0, 400)
    speed[:60] = value
    return speed


def test_a_replay_gives_what_predict_gives_beside_what_may_be_believed():
    """A diagnosis compares from what may be believed; beside that stands what `predict` gives."""
    held = freely({"motor_speed": stuck_at_first()}, locked=True)
    (found,) = predict(held)
    measured, _, noise, _ = gather(held)
    (item,) = replay(measured, [MODEL], noise)
    assert np.array_equal(item.predicted[0]["motor_speed"], found.values["motor_speed"])
    believed = simulate_from(measured[0], MODEL, first_state(measured[0], MODEL), STEP)
    at = MODEL.plant.outputs.index("motor_speed")
    assert np.abs(item.simulated[0]["motor_speed"] - believed[:, at]).max() < 1.0
    assert np.abs(item.simulated[0]["motor_speed"] - found.values["motor_speed"]).max() > 1.0


def test_nothing_begins_at_what_a_dead_sensor_reads():
    """It reads the same however the rest moves: no pressure of the oil, only of the sensor."""
    moving = 8e6 + 1e4 * np.random.default_rng(7).standard_normal(400)
    (found,) = predict(freely({"pressure_a": moving, "pressure_b": np.zeros(400)}))
    assert found.values["pressure_b"][0] == pytest.approx(0.6e6)
    assert any("assumed" in note and "pressure_b at 600000 Pa" in note for note in found.notes)


def test_inputs_that_drive_nothing_are_refused(tmp_path):
    driven_by = freely(
        {"piston_position": np.linspace(0.0, 0.01, 100)}, inputs=("piston_position",)
    )
    with pytest.raises(InputError, match="nothing that eha_knee gives is driven by piston_pos"):
        predict(driven_by, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_where_inputs_drive_nothing_is_said(tmp_path):
    (tmp_path / "log.csv").write_text("t,x\n" + "".join(f"{k / 1e3},{k}\n" for k in range(50)))
    (tmp_path / "channels.yaml").write_text(
        "time: {column: t, unit: s}\nchannels:\n  piston_position: {column: x, unit: um}\n"
    )
    MODEL.write(tmp_path / "model.yaml")
    path = tmp_path / "dataset.yaml"
    path.write_text(
        "model: model.yaml\nchannels: channels.yaml\ninputs: [piston_position]\n"
        "runs:\n  - {log: log.csv}\n"
    )
    for command in (predict, eb.calibrate):
        with pytest.raises(InputError, match=r"dataset.yaml:3, key 'inputs': .*; name a command"):
            command(path)


def test_a_log_without_anything_to_compare_is_refused_with_a_way_out():
    with pytest.raises(InputError, match=r"one of current, .* it has: .*pressure_difference"):
        gather(freely({"pressure_difference": np.linspace(0.0, 1e6, 100)}))


# ---- what is written


def test_time_is_that_of_read_and_its_zero_is_told(tmp_path):
    """A table whose time begins at 5 s: `time` as `read` gives it, and what it counts from."""
    command = np.sin(np.arange(200) / 9.0)
    rows = (f"{5.0 + k / 1e3:.3f},{value:.6f}\n" for k, value in enumerate(command))
    (tmp_path / "log.csv").write_text("t,i\n" + "".join(rows))
    (tmp_path / "channels.yaml").write_text(
        "time: {column: t, unit: s}\nchannels:\n  current_command: {column: i, unit: A}\n"
    )
    MODEL.write(tmp_path / "model.yaml")
    path = tmp_path / "dataset.yaml"
    path.write_text("model: model.yaml\nchannels: channels.yaml\nruns:\n  - {log: log.csv}\n")
    (found,) = predict(path, out=tmp_path / "out")
    read = eb.read(tmp_path / "log.csv", channels=tmp_path / "channels.yaml")
    table = pq.read_table(tmp_path / "out" / "log.parquet")
    assert np.array_equal(table["time"].to_numpy(), read.time)
    epoch = int(table.schema.metadata[b"epoch_ns"])
    assert epoch == read.epoch_ns == found.epoch_ns
    assert table["time"].to_numpy() + epoch / 1e9 == pytest.approx(5.0 + np.arange(200) / 1e3)
    assert table.schema.field("current").metadata[b"unit"] == b"A"


def test_a_summary_stands_beside_the_tables(tmp_path):
    recording = simulated()
    generator = np.random.default_rng(8)
    noisy = recording.with_values(
        {"motor_speed": recording["motor_speed"] + 0.5 * generator.standard_normal(len(recording))}
    )
    (found,) = predict(dataset(noisy), out=tmp_path)
    summary = json.loads((tmp_path / "prediction.json").read_text())
    (run,) = summary["runs"]
    assert run["file"] == "one.parquet"
    assert (tmp_path / run["file"]).exists()
    assert run["channels"] == list(found.values)
    assert run["error"]["motor_speed"]["unit"] == "rad/s"
    assert run["error"]["motor_speed"]["rms"] == pytest.approx(0.5, rel=0.2)
    difference = found.values["pressure_difference"] - recording["pressure_difference"]
    rms = float(np.sqrt(np.mean(difference**2)))
    assert run["error"]["pressure_difference"]["rms"] == pytest.approx(rms)
    assert run["notes"] == list(found.notes)


def test_a_log_of_topics_is_predicted_from_every_command_at_the_stamps_of_its_recording() -> None:
    whole = simulated()
    state = {name: whole[name][::2] for name in ("motor_speed", "current", "pressure_a")}
    stamps = whole.time[::2] + 40e-6
    asked = Recording(whole.time, {"current_command": whole["current_command"]})
    alone = Recording(stamps, {"current_command": whole["current_command"][::2], **state})
    run = Run(
        "one", Path("one.mcap"), None, True, False, Use.HOLDOUT, lambda: alone,
        by_topic=lambda: (asked, Recording(stamps, state)),
    )  # fmt: skip
    (found,) = predict(Dataset(MODEL, ("current_command",), (run,)))
    assert found.time == pytest.approx(stamps)
    for name, values in state.items():
        assert np.abs(found.values[name] - values).max() < 1e-6 * np.ptp(values), name
