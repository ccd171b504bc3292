"""Stamps that are late by always the same: found by a fit, and never an effect."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.core.shipped import shipped_file
from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.ticks import on_ticks
from eha_bench.diagnosis.data.windows import cut_windows
from eha_bench.diagnosis.fit.least_squares import free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.own_parameters import like_clocks, with_clocks
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive

TIME = np.arange(2000) * 1e-3
SIGMA = {"motor_speed": 0.1, "pressure_a": 3e4}


@pytest.fixture(scope="module")
def model():
    return load_model(shipped_file("models/physical.yaml"))


def _measured(model, late: float, name: str = "log") -> Measured:
    """A locked run whose pressure is stamped late, and whose speed comes at half the rate."""
    command = 10.0 + 5.0 * np.sin(2 * np.pi * 4.0 * TIME) + 2.0 * np.sin(2 * np.pi * 23.0 * TIME)
    start = {"pressure_a": 6e5, "pressure_b": 6e5}
    out = model.plant.simulate(
        model.vector(), Drive(TIME, {"current_command": command}, start, locked=True), 1e-4
    )
    rng = np.random.default_rng(0)
    place = {name: at for at, name in enumerate(model.plant.outputs)}
    read = {
        name: out[:, place[name]] + sigma * rng.standard_normal(TIME.size)
        for name, sigma in SIGMA.items()
    }
    topics = [
        Recording(TIME, {"current_command": command}),
        Recording(TIME[::2], {"motor_speed": read["motor_speed"][::2]}),
        Recording(TIME + late, {"pressure_a": read["pressure_a"]}),
    ]
    run = Run(name, Path("log.mcap"), None, True, False, Use.TRAIN, lambda: topics[0])
    outputs = ("motor_speed", "pressure_a")
    return admit(run, on_ticks(topics, ["current_command"], outputs), ["current_command"], outputs)


@pytest.mark.parametrize("late", [0.25e-3, -0.4e-3, 1.2e-3])
def test_a_fit_finds_by_how_much_stamps_are_late(model, late: float) -> None:
    (measured,) = with_clocks(model.plant.layout, [_measured(model, late)])
    problem = Problem(model.plant, cut_windows(measured, SIGMA), SIGMA, 2e-4)
    (item,) = problem.places.late
    vector = problem.places.lengthened(model.vector())
    problem.prepare(vector)
    before = float(np.mean(problem.residual(vector) ** 2))
    free = free_parameters(problem.places, [item.key], vector)
    assert not free[0].of_effect
    fit = levenberg_marquardt(problem, vector, free)
    assert problem.places.lateness(fit.vector)[item.clock] == pytest.approx(late, abs=15e-6)
    after = float(np.mean(fit.residual**2))
    assert after == pytest.approx(1.0, abs=0.06)
    assert before > 1.2


def test_stamps_at_the_ticks_of_the_command_are_not_late(model) -> None:
    (measured,) = with_clocks(model.plant.layout, [_measured(model, 0.0)])
    assert not measured.clocks
    problem = Problem(model.plant, cut_windows(measured, SIGMA), SIGMA, 2e-4)
    assert not problem.places.behind


def test_runs_share_a_clock_and_a_held_out_run_takes_its_place(model) -> None:
    layout = model.plant.layout
    one, two = with_clocks(layout, [_measured(model, 2e-4, "one"), _measured(model, 2e-4, "two")])
    assert one.clocks == two.clocks == {"pressure_a": layout.size}
    other = like_clocks(_measured(model, 2e-4, "held_out"), [one])
    assert other.clocks == one.clocks
