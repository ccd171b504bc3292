"""Stamps that scatter are found from the readings alone, and nothing else is taken for it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.colour import Colour
from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.measured import Measured, pooled_noise
from eha_bench.diagnosis.data.stamps import scatter_notes, scattered_like, with_scatter
from eha_bench.diagnosis.fit.whitening import whitening

SCATTER = 0.2e-3
NOISE = {"angle": 4e-4, "speed": 8e-3}


def _measured(time, columns, inputs=None) -> Measured:
    recording = Recording(time, dict(columns))
    run = Run("log", Path("log.csv"), None, False, False, Use.TRAIN, lambda: recording)
    values = np.column_stack([*columns.values()])
    inputs = inputs or {"goal": np.zeros(time.size)}
    return Measured(run, time, inputs, tuple(columns), values, np.isfinite(values))


def _sine(
    scatter: float, seed: int = 0, *, step: float = 0.0, even: bool = False, seconds: float = 25.0
) -> Measured:
    """Angle and speed of a swing of 1 Hz, polled every 9 to 13 ms or every 10 ms."""
    generator = np.random.default_rng(seed)
    count = round(seconds / 0.011)
    steps = np.full(count, 0.01) if even else generator.integers(9, 14, count) * 1e-3
    taken = np.cumsum(steps)
    turn = 2.0 * np.pi
    columns = {"angle": np.sin(turn * taken), "speed": turn * np.cos(turn * taken)}
    columns = {
        name: own + NOISE[name] * generator.standard_normal(count) for name, own in columns.items()
    }
    if step:
        columns["angle"] = np.round(columns["angle"] / step) * step
    return _measured(taken + generator.uniform(-1.0, 1.0, count) * 3**0.5 * scatter, columns)


@pytest.mark.parametrize(("even", "step"), [(False, 0.0), (True, 0.0), (False, 1.5e-3)])
def test_scatter_is_found_and_the_noise_without_it(even: bool, step: float) -> None:
    (found,) = with_scatter([_sine(SCATTER, step=step, even=even)])
    for name in NOISE:
        assert found.scattered[name].stamps == pytest.approx(SCATTER, rel=0.2)
    noise = pooled_noise([found], tuple(NOISE))
    assert noise["angle"] == pytest.approx(np.hypot(NOISE["angle"], step / 12**0.5), rel=0.15)
    assert noise["speed"] == pytest.approx(NOISE["speed"], rel=0.15)
    # a reading is off by slope times scatter
    swing = 2.0 * np.pi * SCATTER / 2**0.5
    moved = found.scattered["angle"].moved
    assert np.sqrt(np.mean(moved**2)) == pytest.approx(swing, rel=0.2)
    (note,) = scatter_notes([found])
    assert note.startswith("readings of angle, speed are stamped up to 0.4")


@pytest.mark.parametrize("step", [0.0, 1.5e-3])
def test_none_is_found_where_stamps_are_true(step: float) -> None:
    found = [
        seed
        for seed in range(50)
        for even in (False, True)
        if with_scatter([_sine(0.0, seed, step=step, even=even, seconds=12.0)])[0].scattered
    ]
    assert len(found) <= 2


def test_too_little_of_it_is_left_alone() -> None:
    (found,) = with_scatter([_sine(0.01e-3)])
    assert not found.scattered


@pytest.mark.parametrize("loop", [0.012, 0.02, 0.04])
@pytest.mark.parametrize("delay", [0.0, 0.023])
def test_what_bends_between_samples_is_no_scatter(loop: float, delay: float) -> None:
    """Answers of a loop of second order to steps, at 100 Hz, with a dead time that bends later."""
    generator = np.random.default_rng(1)
    time = np.arange(4000) * 0.01
    since = np.mod(time, 0.5)
    goal = np.repeat(generator.uniform(-1.0, 1.0, 80), 50)
    before = np.concatenate([[goal[0]], goal])[np.maximum(np.arange(4000) // 50 * 50, 0)]
    late = np.maximum(since - delay, 0.0) / loop
    gone = 1.0 - (1.0 + late) * np.exp(-late)
    columns = {
        "angle": before + (goal - before) * gone,
        "speed": (goal - before) * late * np.exp(-late) / loop,
    }
    columns = {
        name: own + NOISE[name] * generator.standard_normal(time.size)
        for name, own in columns.items()
    }
    (found,) = with_scatter([_measured(time, columns, {"goal": goal})])
    assert not found.scattered


def test_a_run_on_its_own_has_the_scatter_of_the_same_clock() -> None:
    (found,) = with_scatter([_sine(SCATTER)])
    other = scattered_like(_sine(SCATTER, 1, seconds=2.0), [found])
    assert other.scattered["angle"].stamps == found.scattered["angle"].stamps
    assert other.scattered["angle"].moved.shape == other.time.shape
    assert other.beginning(1.0).scattered["angle"].moved.size == other.beginning(1.0).time.size
    elsewhere = replace(_sine(SCATTER, 1, seconds=2.0), topic_of={"angle": "a", "speed": "a"})
    assert not scattered_like(elsewhere, [found]).scattered


def test_noise_that_remembers_in_part_is_made_white() -> None:
    colour, count = Colour((0.7,)), 60
    part = np.where(np.arange(count) % 20 < 10, 1.0, 0.5)
    matrix = whitening(
        np.arange(count) * 1e-3, np.ones((count, 1), dtype=np.bool_), [colour], part[:, None]
    )
    lags = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    covariance = np.outer(part, part) * 0.7**lags
    covariance[np.arange(count), np.arange(count)] = 1.0
    white = matrix @ covariance @ matrix.T.toarray()
    assert np.abs(white - np.eye(count)).max() < 1e-3
