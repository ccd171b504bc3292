"""Prediction: own recordings come back, at the log's stamps, from inputs and first sample only."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Dataset, Run, Use
from eha_bench.diagnosis.fit.baseline import gather
from eha_bench.diagnosis.replay.prediction import STEP, predict
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
    assert any("input 'current_command' has 30 gaps, bridged" in note for note in found.notes)
