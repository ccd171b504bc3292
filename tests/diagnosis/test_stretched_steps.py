"""Steps are as long as readings allow: long for a slow machine, usual for a stiff one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Dataset, load_dataset
from eha_bench.diagnosis.fit.baseline import COARSE, calibrated_baseline, gather
from eha_bench.diagnosis.fit.finish import fine_enough
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.short_windows import medium_problem
from eha_bench.diagnosis.fit.stretched_steps import STRETCHES, with_stretched_steps
from eha_bench.diagnosis.search.periodic import in_parts
from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive
from eha_bench.recordings import write

PLANT = """\
plant: spindle
nodes: {shaft: {kind: rotation, inertia: 1e-3 kg*m^2}}
elements:
  motor: {kind: motor, on: shaft, torque_constant: 0.13 N*m/A}
  drag: {kind: friction, on: shaft, viscous: %g N*m*s/rad}
inputs: {current_command: motor.current}
channels: {motor_speed: shaft.speed}
calibrate: [shaft.inertia, drag.viscous]
"""


def dataset_of(folder: Path, viscous: float, tick: float, declared: float) -> Dataset:
    """Record a run of a spindle, and return it with a model of a declared friction."""
    (folder / "plant.yaml").write_text(PLANT % viscous, encoding="utf-8")
    model = load_model(folder / "plant.yaml")
    time = tick * np.arange(400)
    generator = np.random.default_rng(2)
    current = np.repeat(generator.uniform(-3.0, 3.0, 20), 20)
    drive = Drive(time, {"current_command": current}, {"motor_speed": 0.0})
    out = model.plant.simulate(model.vector(), drive, 1e-5)
    speed = out[:, model.plant.outputs.index("motor_speed")]
    speed = speed + 1e-3 * np.ptp(speed) * generator.standard_normal(time.size)
    write(folder / "0.mcap", Recording(time, {"current_command": current, "motor_speed": speed}))
    (folder / "plant.yaml").write_text(PLANT % declared, encoding="utf-8")
    text = "model: plant.yaml\ninputs: [current_command]\nruns: [{log: 0.mcap}]\n"
    (folder / "dataset.yaml").write_text(text, encoding="utf-8")
    return load_dataset(folder / "dataset.yaml")


def problem_of(folder: Path, viscous: float, tick: float) -> tuple[Problem, np.ndarray]:
    """Return windows of a run of a spindle, and the parameters that it has."""
    dataset = dataset_of(folder, viscous, tick, viscous)
    _, windows, noise, _ = gather(dataset)
    return Problem(dataset.model.plant, windows, noise, COARSE), dataset.model.vector()


@pytest.mark.parametrize(
    ("viscous", "tick", "stretch"),
    [
        # time constants of 0.25 s and of 0.4 ms
        (4e-3, 0.01, STRETCHES[-1]),
        (2.4, 0.001, 1.0),
        # at most one step a tick, and two of them for the finer ones
        (4e-3, 0.001, 3.0),
        # no usual step fits into a tick: a longer one would change nothing
        (4e-3, 2e-4, 1.0),
        (2.4, 2e-4, 1.0),
    ],
)
def test_a_step_is_as_long_as_the_machine_is_slow(
    tmp_path: Path, viscous: float, tick: float, stretch: float
) -> None:
    problem, vector = problem_of(tmp_path, viscous, tick)
    found = with_stretched_steps(problem, vector)
    assert found.stretch == stretch
    assert found.longest_step == pytest.approx(stretch * COARSE)
    if stretch > 1.0:
        change = found.raw(vector) - problem.at_step(2e-5).raw(vector)
        assert np.abs(change).max() < 0.1


def test_finer_steps_are_found_from_longer_ones(tmp_path: Path) -> None:
    problem, vector = problem_of(tmp_path, 0.4, 0.01)
    long = problem.stretched(12.0)
    fine = fine_enough(long, vector)
    assert fine.stretch < long.stretch
    true = problem.at_step(2e-5)
    change = fine.raw(vector) - true.raw(vector)
    assert np.sqrt(np.mean(change**2)) < 0.05
    # and what comes after is stretched as little
    assert fine.at_step(COARSE).longest_step == fine.stretch * COARSE


def test_other_problems_over_the_same_runs_keep_it(tmp_path: Path) -> None:
    problem, vector = problem_of(tmp_path, 4e-3, 0.01)
    found = with_stretched_steps(problem, vector)
    for other in (
        found.at_step(2e-4), found.over(found.windows), found.with_noise(found.noise),
        found.subset([0]), medium_problem(found), in_parts(found, 1.0),
    ):  # fmt: skip
        assert other.stretch == found.stretch
    assert found.at_step(2e-4).longest_step == pytest.approx(found.stretch * 2e-4)


def test_no_step_is_longer_than_one_that_was_right_elsewhere(tmp_path: Path) -> None:
    problem, vector = problem_of(tmp_path, 4e-3, 0.01)
    assert with_stretched_steps(problem, vector, 3.0).stretch == 3.0


def test_a_machine_that_is_stiffer_than_declared_is_fitted_at_usual_steps(tmp_path: Path) -> None:
    # at 4 ms, steps of a machine of 1.5 ms grow without bound, and a fit cannot pass that wall
    base = calibrated_baseline(dataset_of(tmp_path, 0.67, 0.01, 4e-3))
    assert base.problem.stretch == 1.0
    at = base.problem.plant.layout.index["drag.viscous"]
    assert base.fit.vector[at] == pytest.approx(0.67, rel=0.1)
