"""Logs that are cut out of a motion, whose speed is read behind a gear, slowly, or not at all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.core.shipped import shipped_file
from eha_bench.diagnosis.data.dataset import Dataset, Run, Use, load_dataset
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.start_angle import StartAngle
from eha_bench.diagnosis.data.windows import cut_windows
from eha_bench.diagnosis.fit.baseline import calibrated_baseline, gather
from eha_bench.diagnosis.fit.evidence import excess
from eha_bench.diagnosis.fit.unmeasured import missing
from eha_bench.diagnosis.replay.first_sample import first_sample, first_state
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
NOISE = {"angle": 1e-4, "motor_angle": 1e-3, "motor_speed": 0.05, "speed": 5e-3}
CHANNELS = {
    "angle": "output.angle",
    "speed": "output.speed",
    "motor_angle": "shaft.angle",
    "motor_speed": "shaft.speed",
}


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
    "channels",
    [
        ("angle", "motor_speed"),
        ("speed", "motor_angle"),
        ("angle",),
        ("motor_angle",),
        ("motor_speed",),
    ],
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
    assert model.plant.tells_through_parts


def first_run(dataset: Dataset) -> Measured:
    (measured, *_), *_ = gather(dataset)
    return measured


def test_an_angle_behind_a_gear_is_no_angle_that_nobody_reads(tmp_path: Path) -> None:
    def angle_of(channels: tuple[str, ...]) -> float | None:
        folder = tmp_path / channels[-1]
        folder.mkdir()
        measured = first_run(load_dataset(cut_out(folder, channels, 1)))
        (_, second, *_) = cut_windows(measured, NOISE)
        return second.initial.get("output_angle")

    assert angle_of(("speed", "motor_angle")) is None
    assert angle_of(("motor_speed", "speed")) is not None


def test_what_a_channel_behind_a_gear_tells_is_not_carried(tmp_path: Path) -> None:
    channels = ("angle", "speed", "motor_angle", "motor_speed")
    data = load_dataset(cut_out(tmp_path, channels, 1))
    measured = first_run(data)
    (_, second, *_) = cut_windows(measured, NOISE)
    plant = data.model.plant

    def without(*names: str) -> tuple[str, ...]:
        known = {name: value for name, value in second.initial.items() if name not in names}
        return missing(plant, replace(second, initial=known))

    assert without("angle", "speed") == ()
    assert without("angle", "motor_angle") == ("angle",)
    assert without("speed", "motor_speed") == ("speed",)


def test_a_speed_behind_a_gear_that_differs_from_rest_by_noise_is_rest(tmp_path: Path) -> None:
    channels = ("angle", "motor_speed", "speed")
    data = load_dataset(cut_out(tmp_path, channels, 1, first=0))
    measured = first_run(data)
    column = measured.outputs.index("speed")
    measured.valid[:, column] = False
    first = {name: item for name, item in measured.first.items() if name != "speed"}
    start = first_sample(replace(measured, first=first), data.model)
    assert start.state["speed"] == 0.0
    assert start.state["motor_speed"] == 0.0


def test_an_angle_that_is_estimated_is_from_no_other_channel(tmp_path: Path) -> None:
    data = load_dataset(cut_out(tmp_path, ("speed", "motor_speed"), 1))
    measured = replace(first_run(data), start=StartAngle(0.3, 0.1))
    start = first_sample(measured, data.model)
    assert start.state["output_angle"] == 0.3
    assert start.notes == ()


def test_what_turns_a_piston_that_is_locked_stands_still(tmp_path: Path) -> None:
    text = shipped_file("plants/valve_cylinder.yaml").read_text()
    node = "nodes:\n  wheel: {kind: rotation, inertia: 1e-4 kg*m^2}\n"
    rack = "elements:\n  rack: {kind: gear, from: wheel, to: rod, ratio: 40 rad/m}\n"
    text = text.replace("nodes:\n", node).replace("elements:\n", rack)
    text = text.replace("channels: {", "channels: {wheel_angle: wheel.angle, ")
    path = tmp_path / "plant.yaml"
    path.write_text(text)
    model = load_model(path)
    roles = model.plant.roles
    assert {"piston_position", "piston_velocity", "wheel_angle"} == {*roles.locked}
    time = np.arange(0.0, 1.0, 1e-3)
    data = {
        "valve_command": np.sin(20.0 * time),
        "pressure_a": 7e6 + 1e5 * np.sin(20.0 * time),
        "wheel_angle": np.full(time.size, 2.0),
    }
    reading = Recording(time, data)
    run = Run("log", Path("log.mcap"), None, True, False, Use.TRAIN, lambda: reading)
    measured = admit(run, reading, ["valve_command"], model.plant.outputs, roles=roles)
    assert first_state(measured, model)["piston_position"] == pytest.approx(0.05)


@pytest.mark.parametrize(("first", "begins"), [(0.0, True), (2.0, False)])
def test_a_log_that_begins_with_a_valves_step_is_cut_where_the_spool_is_known(
    first: float, begins: bool
) -> None:
    model = Model("valve_cylinder")
    time = np.arange(-0.2, 2.0, 1e-3)
    command = np.where(time < 0.0, 0.0, first) + 2.0 * np.sin(8.0 * np.maximum(time, 0.0))
    out = model.plant.simulate(model.vector(), Drive(time, {"valve_command": command}), 1e-4)
    noise = {"pressure_a": 1e4, "pressure_b": 1e4, "piston_position": 1e-5}
    rng = np.random.default_rng(3)
    data = {
        name: out[200:, model.plant.outputs.index(name)] + size * rng.standard_normal(2000)
        for name, size in noise.items()
    }
    reading = Recording(time[200:] - time[200], {"valve_command": command[200:], **data})
    run = Run("log", Path("log.mcap"), None, False, False, Use.TRAIN, lambda: reading)
    roles = model.plant.roles
    measured = admit(run, reading, ["valve_command"], model.plant.outputs, roles=roles)
    windows = cut_windows(measured, noise)
    assert (windows[0].first == 0) is begins
    assert windows[0].first < 400
