"""The fit of a residual: steps that lead nowhere are followed by shorter ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.least_squares import Free, _vector_after, levenberg_marquardt


class Weight:
    """Readings of a small weight at an angle that hardly shows while the weight is small.

    r = G cos(x - a) - truth, over a small range of x: far from the minimum a step in the angle `a`
    leads nowhere.
    """

    soft, beliefs, step = 5.0, (), 1.0

    def __init__(self) -> None:
        self.x = np.linspace(-0.1, 1.6, 400)
        rng = np.random.default_rng(1)
        self.read = 8.0 * np.sin(self.x + 0.78) + rng.standard_normal(self.x.size)
        self.asked = 0

    @property
    def size(self) -> int:
        return int(self.x.size)

    def residual(self, vector: FloatArray) -> FloatArray:
        self.asked += 1
        return np.asarray(vector[0] * np.cos(self.x - vector[1]) - self.read)


def free() -> tuple[Free, ...]:
    return (Free("G", 0, -1e4, 1e4, 50.0), Free("a", 1, -2 * np.pi, 2 * np.pi, 1.8))


@pytest.mark.parametrize(
    ("weight", "angle"), [(0.05, -1.0), (0.3, -1.5), (1.0, -1.5), (1.0, 2.0), (0.3, 2.0)]
)
def test_a_fit_arrives_from_an_angle_that_hardly_shows(weight: float, angle: float):
    problem: Any = Weight()
    found = levenberg_marquardt(problem, np.array([weight, angle]), free(), iterations=30)
    best = levenberg_marquardt(problem, np.array([8.0, 0.79]), free(), iterations=30)
    assert found.cost == pytest.approx(best.cost, abs=2.0)
    x = problem.x
    fitted = found.vector[0] * np.cos(x - found.vector[1])
    assert np.abs(fitted - 8.0 * np.sin(x + 0.78)).max() < 0.5


def test_what_has_arrived_tries_no_more_steps_than_it_did():
    problem: Any = Weight()
    first = levenberg_marquardt(problem, np.array([8.0, 0.79]), free(), iterations=30)
    problem.asked = 0
    again = levenberg_marquardt(problem, first.vector, free(), iterations=30, tries=4)
    # one residual, two for the slopes, and at most four steps
    assert problem.asked <= 7
    assert again.cost == pytest.approx(first.cost, abs=1.0)


def test_a_step_to_a_bound_ends_there_and_not_a_rounding_away() -> None:
    """From 1e-16 on no step has a size, and a slope by such steps is one of 1e53."""
    free = [Free("creep", 0, 0.0, 10.0, 0.3), Free("mass", 1, 0.0, 5.0, 0.1)]
    vector = np.array([0.9, 4.3])
    assert 0.9 + (0.0 - 0.9) / 0.3 * 0.3 > 0.0
    after = _vector_after(vector, free, np.array([(0.0 - 0.9) / 0.3, (5.0 - 4.3) / 0.1]))
    assert after.tolist() == [0.0, 5.0]
    assert _vector_after(vector, free, np.array([-1.0, 1.0])).tolist() == pytest.approx([0.6, 4.4])
