"""The end of a fit: fine enough a step, the bottom of the cost, and what the step still moves."""

from __future__ import annotations

import numpy as np
import pytest

from eha_bench.diagnosis.fit.finish import FINEST, converged_fit, fine_enough
from eha_bench.diagnosis.fit.least_squares import Fit, Free
from eha_bench.diagnosis.fit.problem import soften

SIZE = 20_000
COLUMN = np.sin(np.arange(SIZE) / 9.0)
NOISE = np.random.default_rng(0).standard_normal(SIZE)
FREE = (Free("a", 0, -np.inf, np.inf, 1.0),)


class Stepped:
    """A residual linear in one parameter, whose error of integration is `error` times the step."""

    soft = 1.0
    size = SIZE
    beliefs = ()

    def __init__(self, error: float, step: float = 1e-4) -> None:
        self.error, self.step = error, step

    def at_step(self, step: float) -> Stepped:
        return Stepped(self.error, step)

    def halved(self) -> Stepped:
        return self.at_step(0.5 * self.step)

    @property
    def longest_step(self) -> float:
        return self.step

    def residual(self, vector: np.ndarray) -> np.ndarray:
        return NOISE + COLUMN * (vector[0] + self.error * self.step)


def fit_at(problem: Stepped, value: float) -> Fit:
    residual = problem.residual(np.array([value]))
    soft, _ = soften(residual)
    return Fit(np.array([value]), FREE, residual, COLUMN[:, None], float(soft @ soft))


def bottom() -> float:
    return -float(COLUMN @ NOISE) / float(COLUMN @ COLUMN)


def test_a_step_that_does_not_tell_is_kept():
    assert fine_enough(Stepped(1.0), np.zeros(1)).step == 1e-4


def test_a_step_that_tells_is_halved_until_it_does_not():
    found = fine_enough(Stepped(3000.0), np.zeros(1))
    assert FINEST <= found.step < 1e-4


def test_no_step_is_finer_than_the_finest():
    assert fine_enough(Stepped(1e8), np.zeros(1)).step == FINEST


def test_a_fit_that_stopped_early_ends_at_the_bottom():
    deviation = 1.0 / float(np.linalg.norm(COLUMN))
    early = bottom() + 3.0 * deviation
    found = converged_fit(Stepped(0.0), fit_at(Stepped(0.0), early))
    assert found.fit.vector[0] == pytest.approx(bottom(), abs=0.2 * deviation)


def test_the_error_that_is_left_is_about_what_the_last_halving_moves():
    problem = Stepped(1000.0)
    found = converged_fit(problem, fit_at(problem, bottom()))
    off = found.fit.vector[0] - bottom()
    assert abs(off) == pytest.approx(1000.0 * 0.5e-4, rel=0.1), "half the step, half the error"
    assert abs(found.shifts["a"]) == pytest.approx(abs(off), rel=0.1)
