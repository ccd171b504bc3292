"""What is periodic in the shaft's angle is found where the model loses the angle."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.windows import window_at
from eha_bench.diagnosis.fit.candidates import effect_starts
from eha_bench.diagnosis.fit.least_squares import free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.search.periodic import best_counts, in_parts, least_count, scan
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive
from eha_bench.plants.registry import get_plant

NOISE = {"current": 0.05, "motor_speed": 0.1, "pressure_a": 3e4, "pressure_b": 3e4}
COUNT, PHASE, AMPLITUDE = 7, 0.8, 0.05


def turning() -> Measured:
    """A shaft that turns with the bypass open while its magnets pull."""
    pull = {"amplitude": AMPLITUDE, "count": float(COUNT), "phase": PHASE}
    truth = Model("eha_knee", {}, (), (DeclaredEffect("cogging_torque", pull),))
    time = np.arange(0.0, 0.8, 1e-3)
    command = 3.5 * np.sin(2 * np.pi * 1.25 * time)
    drive = Drive(time, {"current_command": command}, {}, True, True)
    values = truth.plant.simulate(truth.vector(), drive, 5e-5)[:, :4]
    values += np.random.default_rng(1).standard_normal(values.shape) * list(NOISE.values())
    run = Run("ramps", Path("ramps.mcap"), None, True, True, Use.TRAIN, lambda: None)
    good = np.ones(values.shape, dtype=np.bool_)
    return Measured(run, time, {"current_command": command}, tuple(NOISE), values, good)


@pytest.fixture(scope="module")
def problem() -> Problem:
    measured = turning()
    windows = [window_at(measured, k, k + 100, NOISE) for k in range(100, 800, 100)]
    return Problem(Model("eha_knee", {}).plant, windows, NOISE, 2e-4)


def test_count_phase_and_amplitude_are_found_beside_a_wrong_friction(problem):
    layout = problem.plant.layout
    vector = Model("eha_knee", {}).vector()
    vector[layout.index["viscous_torque"]] *= 1.1
    problem.prepare(vector)
    keys = ["viscous_torque", "coulomb_torque"]
    free = free_parameters(layout, keys, vector)
    fit = levenberg_marquardt(problem, vector, free, iterations=3)
    starts = effect_starts(layout, layout.effect("cogging_torque"))
    best = best_counts(scan(problem, fit, layout, starts))[0]
    settings = dict(best.settings)
    assert settings[layout.index["cogging_torque.count"]] == COUNT
    off = settings[layout.index["cogging_torque.phase"]] - PHASE
    assert np.cos(off) > 0.9
    assert best.strength == pytest.approx(AMPLITUDE, rel=0.3)
    assert "cogging_torque.count" not in best.keys


def test_parts_follow_each_other_and_begin_at_the_angle_that_was_measured(problem):
    measured = problem.windows[0].measured
    whole = window_at(measured, 0, 800, NOISE)
    parts = in_parts(Problem(problem.plant, [whole], NOISE, 1e-4), 0.2).windows
    assert [part.first for part in parts] == [0, *(part.last for part in parts[:-1])]
    assert parts[-1].last == 800
    angle = measured.shaft_angle
    for part in parts[1:]:
        assert part.initial["shaft_angle"] == angle[part.first]
        assert 0.0 < part.spread["shaft_angle"] < 0.01
    assert parts[0].spread["shaft_angle"] == 0.0, "angles count from the first sample"


def test_the_right_phase_explains_where_the_model_turns_at_another_speed(problem):
    """With friction 30 % off the model's own angle is off by turns of the magnets in 0.4 s."""
    measured = problem.windows[0].measured
    window = window_at(measured, 100, 600, NOISE)
    long = Problem(problem.plant, [window], NOISE, 1e-4)
    layout = problem.plant.layout
    vector = Model("eha_knee", {}).vector()
    vector[layout.index["viscous_torque"]] *= 1.3

    def change(kind: Problem, phase: float) -> np.ndarray:
        on = vector.copy()
        on[layout.index["cogging_torque.amplitude"]] = AMPLITUDE
        on[layout.index["cogging_torque.count"]] = COUNT
        on[layout.index["cogging_torque.phase"]] = phase
        return kind.raw(on) - kind.raw(vector)

    short = in_parts(long, 0.1)
    left = short.raw(vector)
    held = change(short, PHASE) @ left
    opposite = change(short, PHASE + np.pi) @ left
    # the right phase takes from the residual, the opposite one adds to it
    assert held < 0.0 < opposite


@pytest.mark.parametrize(
    ("at", "travel", "least"),
    [
        # a quarter of a turn holds two periods of eight a turn and more
        ("output", math.pi / 2, 8.0),
        ("output", 4.0 * math.pi, 1.0),
        # the rotor's own angle is not measured: any count
        ("motor", math.pi / 2, 0.0),
    ],
)
def test_a_period_has_to_come_twice(at: str, travel: float, least: float) -> None:
    layout = get_plant("geared_servo").layout
    places = layout.effect("cogging_torque").parameter("at").choices
    start = next(
        item
        for item in effect_starts(layout, layout.effect("cogging_torque"))
        if dict(item.settings)[layout.index["cogging_torque.at"]] == places.index(at)
    )
    angle = np.array([np.nan, 0.3, 0.3 + travel, 0.5])
    runs = [
        SimpleNamespace(run=SimpleNamespace(name=name), column={"angle": values}.get)
        for name, values in (("far", angle), ("near", 0.1 * angle))
    ]
    problem: Any = SimpleNamespace(windows=[SimpleNamespace(measured=item) for item in runs])
    assert least_count(problem, layout, start) == pytest.approx(least)
