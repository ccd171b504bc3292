"""Runs are cut where an encoder is read less often than the drive, as robots log them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.data.measured import Measured, pooled_noise
from eha_bench.diagnosis.data.windows import cut_windows
from eha_bench.diagnosis.diagnose import diagnose
from eha_bench.diagnosis.fit.baseline import gather
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.outcome.diagnosis import Verdict
from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive
from eha_bench.recordings import write

PLANT = """\
plant: pump_slide
nodes:
  shaft:  {kind: rotation, inertia: 4e-4 kg*m^2}
  side_a: {kind: volume, bulk_modulus: 1.0 GPa, pressure: 20 bar}
  side_b: {kind: volume, bulk_modulus: 1.0 GPa, pressure: 20 bar}
  rod:    {kind: translation, mass: 30 kg}
elements:
  motor:    {kind: motor, on: shaft, torque_constant: 0.11 N*m/A, current_limit: 40 A}
  pump:     {kind: pump, on: shaft, from: side_b, to: side_a, displacement: 1.5e-7 m^3/rad}
  drag:     {kind: friction, on: shaft, viscous: 5e-4 N*m*s/rad}
  slip:     {kind: laminar_leakage, between: [side_a, side_b], conductance: 4e-13 m^3/(s*Pa)}
  cylinder: {kind: cylinder, on: rod, a: side_a, b: side_b, area_a: 4 cm^2, area_b: 4 cm^2,
             volume_a: 30 cm^3, volume_b: 30 cm^3}
  seals:    {kind: friction, on: rod, viscous: 300 N*s/m}
  spring:   {kind: spring, on: rod, stiffness: 20000 N/m}
inputs: {current_command: motor.current}
channels: {motor_speed: shaft.speed, pressure_a: side_a.pressure, rod_position: rod.position}
calibrate: [{parameter: rod.mass, within: 10 %}, {parameter: seals.viscous, within: 20 %}]
"""
RATE, SLOWER = 1000, 5
NOISE = {"motor_speed": 0.2, "pressure_a": 1e4, "rod_position": 2e-6}
MASS, DAMPING = 32.5, 270.0


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three runs of a slide that a log was cut from: topics at 1 kHz, the encoder's at 200 Hz."""
    folder = tmp_path_factory.mktemp("slide")
    (folder / "plant.yaml").write_text(PLANT, encoding="utf-8")
    model = load_model(folder / "plant.yaml")
    vector, layout = model.vector(), model.plant.layout
    for key, value in (("rod.mass", MASS), ("seals.viscous", DAMPING)):
        vector[layout.index[key]] = value
    random = np.random.default_rng(8)
    cut = round(0.36 * RATE)
    for number, frequency in enumerate((1.3, 2.1, 1.7)):
        time = np.arange(0.0, 1.6, 1.0 / RATE)
        command = 6.0 * np.sin(2 * np.pi * frequency * time) + 3.0 * np.sin(11.0 * time + number)
        values = model.plant.simulate(vector, Drive(time, {"current_command": command}, {}), 5e-5)
        shown = dict(zip(model.plant.outputs, values.T, strict=True))
        columns = {
            name: shown[name] + size * random.standard_normal(time.size)
            for name, size in NOISE.items()
        }
        columns["rod_position"][np.arange(time.size) % SLOWER != 0] = np.nan
        rows = {name: column[cut:] for name, column in columns.items()}
        rows["current_command"] = command[cut:]
        write(folder / f"run{number}.csv", Recording(time[cut:] - time[cut], rows))
    uses = ("train", "train", "holdout")
    runs = "".join(f"  - {{log: run{k}.csv, use: {use}}}\n" for k, use in enumerate(uses))
    path = folder / "dataset.yaml"
    path.write_text(f"model: plant.yaml\ninputs: [current_command]\nruns:\n{runs}", "utf-8")
    return path


def measured(dataset: Path) -> tuple[Measured, ...]:
    return tuple(gather(load_dataset(dataset))[0])


def test_runs_are_cut_into_windows_that_know_the_speed_they_begin_with(dataset: Path) -> None:
    runs = measured(dataset)
    assert {run.strides["rod_position"] for run in runs} == {SLOWER}
    noise = pooled_noise(runs, runs[0].outputs)
    windows = [window for run in runs for window in cut_windows(run, noise)]
    lengths = [float(w.measured.time[w.last - 1] - w.measured.time[w.first]) for w in windows]
    assert max(lengths) < 0.8  # no run is one window
    assert all("rod_velocity" in window.initial for window in windows)
    model = load_dataset(dataset).model
    vector, layout = model.vector(), model.plant.layout
    for key, value in (("rod.mass", MASS), ("seals.viscous", DAMPING)):
        vector[layout.index[key]] = value
    problem = Problem(model.plant, windows, noise, 1e-4)
    problem.prepare(vector)
    left = problem.residual(vector)
    for piece in problem.pieces:
        assert np.mean(left[piece.rows] ** 2) < 2.0


def thinned(dataset: Path, every: int, stepped: bool) -> Measured:
    """Return a run of which one row in so many has an encoder's reading, with a stepped command."""
    run = measured(dataset)[0]
    valid = run.valid.copy()
    column = run.outputs.index("rod_position")
    valid[:, column] &= np.arange(run.time.size) % every == 0
    inputs = dict(run.inputs)
    if stepped:
        inputs["current_command"] = 5.0 * ((np.arange(run.time.size) // 60) % 3)
    return replace(run, valid=valid, inputs=inputs)


@pytest.mark.parametrize("every", [300, 500, 1500])
def test_a_channel_of_few_readings_permits_no_start(dataset: Path, every: int) -> None:
    run = thinned(dataset, every, stepped=False)
    assert len(cut_windows(run, dict(NOISE))) == 1


@pytest.mark.parametrize("every", [5, 20, 50])
def test_every_window_knows_where_it_begins_beside_steps_of_the_command(
    dataset: Path, every: int
) -> None:
    run = thinned(dataset, every, stepped=True)
    for window in cut_windows(run, dict(NOISE)):
        assert window.first == 0 or {"rod_position", "rod_velocity"} <= window.initial.keys()


@pytest.mark.slow
def test_a_healthy_slide_is_healthy(dataset: Path) -> None:
    found = diagnose(dataset)
    assert found.verdict is Verdict.NONE
    assert found.calibrated["rod.mass"].value == pytest.approx(MASS, rel=0.02)
    assert found.calibrated["seals.viscous"].value == pytest.approx(DAMPING, rel=0.02)
