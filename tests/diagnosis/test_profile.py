"""A profile sees through a rough cost what slopes cannot."""

from __future__ import annotations

import numpy as np
import pytest

from eha_bench.diagnosis.fit.least_squares import Fit, Free
from eha_bench.diagnosis.fit.problem import soften
from eha_bench.diagnosis.fit.profile import cost_with, profile_deviation


class Rough:
    """A residual that is linear in one parameter, with jumps of its own at every place."""

    def __init__(self, slope: float, jump: float) -> None:
        self.column = np.full(10_000, slope / 100.0)
        self.noise = np.random.default_rng(0).standard_normal(10_000)
        self.jump = jump

    def residual(self, vector: np.ndarray) -> np.ndarray:
        place = np.random.default_rng(int(1e6 * abs(vector[0]) + 0.5)).standard_normal(10_000)
        return self.noise + self.column * vector[0] + self.jump / 100.0 * place


def fit_at(problem: Rough, jacobian: float) -> Fit:
    residual = problem.residual(np.zeros(1))
    soft, _ = soften(residual)
    free = (Free("a", 0, -np.inf, np.inf, 1.0),)
    matrix = np.full((10_000, 1), jacobian / 100.0)
    return Fit(np.zeros(1), free, residual, matrix, float(soft @ soft))


def test_where_the_cost_is_smooth_the_profile_says_what_the_slopes_say():
    found = profile_deviation(Rough(50.0, 0.0), fit_at(Rough(50.0, 0.0), 50.0), "a", 1.0 / 50.0)
    assert found == pytest.approx(1.0 / 50.0, rel=0.5)


def test_where_the_cost_is_rough_slopes_are_not_believed():
    problem = Rough(50.0, 5.0)
    # a jump within the difference's step made the slope a hundred times too steep
    assert profile_deviation(problem, fit_at(problem, 5000.0), "a", 1.0 / 5000.0) > 1.0 / 100.0


class Balanced:
    """Two parameters whose columns are nearly alike: one makes up for the other."""

    def __init__(self) -> None:
        rng = np.random.default_rng(0)
        one = rng.standard_normal(10_000)
        self.matrix = np.column_stack([one, one + 1e-3 * rng.standard_normal(10_000)])
        self.noise = rng.standard_normal(10_000)

    def residual(self, vector: np.ndarray) -> np.ndarray:
        return self.noise + self.matrix @ vector


def test_a_parameter_that_only_balances_another_costs_nothing_to_take_back():
    problem = Balanced()
    vector = np.array([0.5, -0.5])
    residual = problem.residual(vector)
    soft, _ = soften(residual)
    free = tuple(Free(name, k, -np.inf, np.inf, 1.0) for k, name in enumerate("ab"))
    fit = Fit(vector, free, residual, problem.matrix, float(soft @ soft))
    assert cost_with(problem, fit, "b", 0.0) - fit.cost < 1.0
    alone, _ = soften(problem.residual(np.array([0.5, 0.0])))
    assert float(alone @ alone) - fit.cost > 1000.0, "with the other held it would seem to matter"


class Lopsided:
    """A smooth cost that is a parabola near its bottom, and rises by another law on each side."""

    def __init__(self) -> None:
        self.noise = np.random.default_rng(0).standard_normal(10_000)

    def residual(self, vector: np.ndarray) -> np.ndarray:
        x = float(vector[0])
        shape = x + 0.3 * x * x if x > -1.0 else -0.7 + 40.0 * (x + 1.0)
        return self.noise + 0.5 * shape


def test_a_smooth_cost_that_is_no_parabola_far_off_is_not_taken_for_a_rough_one() -> None:
    problem = Lopsided()
    found = profile_deviation(problem, fit_at(problem, 50.0), "a", 1.0 / 50.0)
    assert found < 3.0 / 50.0
