"""A window that begins in the midst of a fast oscillation: its start is moved to its best."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.data.windows import window_at
from eha_bench.diagnosis.fit.least_squares import free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.prepared import best_start
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.starts import best_fit_of_starts
from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive

PLANT = """\
plant: swing
nodes:
  axis: {kind: rotation, inertia: 1e-6 kg*m^2}
elements:
  arm:  {kind: pendulum, on: axis, mass: 1 kg, length: 30 mm}
  drag: {kind: friction, on: axis, viscous: 1e-4 N*m*s/rad}
channels: {angle: axis.angle}
calibrate: [arm.length, drag.viscous]
"""
NOISE = {"angle": 2e-3}
TICK = 0.02
STEP = 1e-3


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("swing") / "plant.yaml"
    path.write_text(PLANT)
    return load_model(path)


def _measured(model, angle, seconds):
    """A pendulum that is released at an angle; some seven readings a period."""
    time = np.arange(0.0, seconds, TICK)
    out = model.plant.simulate(model.vector(), Drive(time, {}, {"angle": angle}), STEP)
    noise = NOISE["angle"] * np.random.default_rng(3).standard_normal(time.size)
    reading = out[:, model.plant.outputs.index("angle")] + noise
    recording = Recording(time, {"angle": reading})
    run = Run(f"{angle}", Path("swing.csv"), None, False, False, Use.TRAIN, lambda: recording)
    return admit(run, recording, [], model.plant.outputs, roles=model.plant.roles)


@pytest.fixture(scope="module")
def problem(model):
    """Most windows hang nearly still; the start of the last is far off, in the midst of a swing."""
    still, swings = _measured(model, 0.01, 12.0), _measured(model, 2.0, 4.0)
    windows = [window_at(still, k, k + 60, NOISE) for k in range(0, 540, 60)]
    windows.append(window_at(swings, 75, 135, NOISE))
    return Problem(model.plant, windows, NOISE, STEP)


def _squares(problem, vector):
    residual = problem.residual(vector)
    return np.array([float(np.mean(residual[piece.rows] ** 2)) for piece in problem.pieces])


def test_the_right_model_leaves_noise_in_the_midst_of_a_swing(model, problem) -> None:
    vector = model.vector()
    problem.prepare(vector)
    squares = _squares(problem, vector)
    assert squares[9] == pytest.approx(1.0, abs=0.6)
    assert squares[:9].mean() == pytest.approx(1.0, abs=0.2)


def test_a_start_that_is_a_little_off_is_moved_as_well(model) -> None:
    """Seven times the noise of one window in ten made an unknown where nothing is missing."""
    still, swings = _measured(model, 0.01, 12.0), _measured(model, 0.3, 4.0)
    windows = [window_at(still, k, k + 60, NOISE) for k in range(0, 540, 60)]
    problem = Problem(model.plant, [*windows, window_at(swings, 75, 135, NOISE)], NOISE, STEP)
    problem.prepare(model.vector())
    assert _squares(problem, model.vector())[9] == pytest.approx(1.0, abs=0.3)


def test_a_reading_is_the_start_where_no_polynomial_follows(model) -> None:
    swings, still = _measured(model, 2.0, 4.0), _measured(model, 0.01, 4.0)
    assert window_at(swings, 75, 135, NOISE).initial["angle"] == swings.values[75, 0]
    # and where one does, it takes the reading's noise off
    assert window_at(still, 75, 135, NOISE).initial["angle"] != still.values[75, 0]


def test_starts_are_moved_also_where_most_windows_swing(model) -> None:
    """None stands out from the others; that its slopes say nothing of it is seen of each alone."""
    swings = _measured(model, 1.0, 6.0)
    windows = [window_at(swings, first, first + 50, NOISE) for first in (25, 75, 125, 175, 225)]
    problem = Problem(model.plant, windows, NOISE, STEP)
    problem.prepare(model.vector())
    squares = _squares(problem, model.vector())
    assert np.median(squares) == pytest.approx(1.0, abs=0.3)
    assert squares.max() < 4.0
    wrong = model.vector()
    wrong[model.plant.layout.index["arm.length"]] *= 1.03
    problem.prepare(wrong)
    assert _squares(problem, wrong).min() > 10.0


def test_a_wrong_model_is_not_hidden_by_a_moved_start(model, problem) -> None:
    vector = model.vector()
    vector[model.plant.layout.index["arm.length"]] *= 1.03
    problem.prepare(vector)
    assert _squares(problem, vector)[9] > 100.0


def test_a_fit_arrives_over_a_window_that_swings(model, problem) -> None:
    vector = model.vector()
    at = model.plant.layout.index["arm.length"]
    vector[at] *= 1.05
    problem.prepare(vector)
    problem.scale_to(problem.residual(vector))
    free = free_parameters(problem.plant.layout, ["arm.length"], vector)
    arrival = best_fit_of_starts(problem, vector, free, lambda _better: None)
    fit = arrival.fit
    for _ in range(4):
        problem.prepare(fit.vector)
        fit = levenberg_marquardt(problem, fit.vector, free)
    assert fit.vector[at] == pytest.approx(0.03, rel=2e-3)
    assert _squares(problem, fit.vector).max() < 2.0


def test_the_best_start_of_a_straight_line_is_found_at_once() -> None:
    generator = np.random.default_rng(5)
    slopes, others = generator.standard_normal((40, 2)), generator.standard_normal((40, 3))
    start, shaking = np.array([0.7, -0.4]), np.array([0.2, 0.1, -0.3])
    residual = -1e3 * (slopes @ start + others @ shaking)
    half = np.arange(40) < 20
    for moved in (np.zeros(2), np.array([3.0, -5.0])):
        here = residual + 1e3 * slopes @ moved
        best, left = best_start(here, 1e3 * slopes, 1e3 * others, moved, half)
        assert best == pytest.approx(start, abs=1e-4)
        # what is left is what the normal prior asks for
        assert left == pytest.approx(start @ start + shaking @ shaking, rel=1e-3)
