"""Logs that are cut out of a motion, whose speed is read behind a gear, slowly, or not at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.fit.baseline import calibrated_baseline
from eha_bench.diagnosis.fit.evidence import excess
from eha_bench.diagnosis.replay.prediction import predict
from eha_bench.plants.model import Model, load_model
from eha_bench.plants.plant import Drive
from eha_bench.recordings import write

PLANT = """\
plant: geared_arm
nodes:
  shaft:  {{kind: rotation, inertia: 1e-5 kg*m^2}}
  output: {{kind: rotation, inertia: 0.05 kg*m^2}}
elements:
  motor:   {{kind: motor, on: shaft, torque_constant: 0.05 N*m/A}}
  gear:    {{kind: gear, from: shaft, to: output, ratio: {ratio}}}
  bearing: {{kind: friction, on: output, viscous: {viscous} N*m*s/rad}}
inputs:   {{current: motor.current}}
channels: {{{channels}}}
calibrate: [bearing.viscous]
"""
NOISE = {"angle": 1e-4, "motor_angle": 1e-3, "motor_speed": 0.05}
CHANNELS = {"angle": "output.angle", "motor_angle": "shaft.angle", "motor_speed": "shaft.speed"}


def declared(folder: Path, channels: tuple[str, ...], viscous: float, ratio: float = -10) -> Model:
    path = folder / "plant.yaml"
    shown = ", ".join(f"{name}: {CHANNELS[name]}" for name in channels)
    path.write_text(PLANT.format(viscous=viscous, channels=shown, ratio=ratio))
    return load_model(path)


def cut_out(folder: Path, channels: tuple[str, ...], every: int, first: int = 300) -> Path:
    """Write two logs of a motion from rest, from a sample on, each channel once in `every`."""
    truth = declared(folder, channels, 0.2)
    noise = np.random.default_rng(7)
    rows = []
    for number in (0, 1):
        time = np.arange(0.0, 2.6, 2e-3)
        current = 3.0 * np.sin(2.0 * np.pi * (0.8 + 0.7 * number) * time)
        out = truth.plant.simulate(truth.vector(), Drive(time, {"current": current}, {}), 2e-4)
        data = {"current": current[first:]}
        for name in channels:
            values = out[first:, truth.plant.outputs.index(name)].copy()
            values += NOISE[name] * noise.standard_normal(values.size)
            values[np.arange(values.size) % every != 0] = np.nan
            data[name] = values
        write(folder / f"{number}.mcap", Recording(time[first:] - time[first], data))
        rows.append(f"  - {{log: {number}.mcap}}\n")
    declared(folder, channels, 0.23)
    path = folder / "dataset.yaml"
    path.write_text("model: plant.yaml\ninputs: [current]\nruns:\n" + "".join(rows))
    return path


@pytest.mark.parametrize("every", [1, 2])
@pytest.mark.parametrize(
    "channels", [("angle", "motor_speed"), ("angle",), ("motor_angle",), ("motor_speed",)]
)
def test_nothing_is_missing(tmp_path: Path, channels: tuple[str, ...], every: int) -> None:
    base = calibrated_baseline(load_dataset(cut_out(tmp_path, channels, every)))
    layout = base.problem.plant.layout
    assert base.fit.vector[layout.index["bearing.viscous"]] == pytest.approx(0.2, rel=0.01)
    assert excess(base.problem, base.fit).relative < 0.05


def test_a_prediction_starts_at_the_speed_behind_a_gear(tmp_path: Path) -> None:
    """Known answer: the arm turns a tenth as fast as its motor, the other way."""
    path = cut_out(tmp_path, ("angle", "motor_speed"), 1)
    model = declared(tmp_path, ("angle", "motor_speed"), 0.2)
    for item in predict(load_dataset(path), model):
        (note,) = item.notes
        assert "no 'output_speed' in the log: it starts at" in note
        assert "from other channels" in note
        # the first sample's noise, 0.05 / 10 rad/s, turns the arm by so much as it dies away
        assert item.errors["angle"] < 0.005 * 0.25
        assert item.errors["motor_speed"] < 1.1 * NOISE["motor_speed"]


def test_what_rests_at_first_is_said_to_start_nowhere_else(tmp_path: Path) -> None:
    path = cut_out(tmp_path, ("angle",), 1, first=0)
    for item in predict(load_dataset(path), declared(tmp_path, ("angle",), 0.2)):
        assert item.notes == ()
        assert item.errors["angle"] < 1.5 * NOISE["angle"]


def test_a_ratio_that_is_fitted_moves_the_start_with_it(tmp_path: Path) -> None:
    model = declared(tmp_path, ("angle", "motor_speed"), 0.2)
    vector = model.vector()
    vector[model.plant.layout.index["gear.ratio"]] = 8.0
    assert model.plant.through_parts(vector, {"motor_speed": 4.0}) == {"output_speed": 0.5}
    assert model.plant.through_parts(vector, {"motor_speed": 4.0, "output_speed": 1.0}) == {}
