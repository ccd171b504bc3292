"""The interval of a strength by its profile, where a linear one says nothing."""

from __future__ import annotations

import numpy as np
import pytest

from eha_bench.diagnosis.fit.evidence import Groups
from eha_bench.diagnosis.fit.least_squares import Fit, Free, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import soften
from eha_bench.diagnosis.fit.refitted_profile import strength_interval
from eha_bench.diagnosis.fit.uncertainty import spreads

SIZE = 4000


class Wave:
    """A strength and a phase, seen over a part of a period in which a constant tells most."""

    soft, step, beliefs = 1.0, 1e-3, ()
    size = SIZE

    def __init__(self, seed: int, strength: float = 0.3) -> None:
        self.angle = np.linspace(-0.1, 0.1, SIZE)
        noise = np.random.default_rng(seed).standard_normal(SIZE)
        self.read = strength * np.sin(self.angle + 0.8) + noise

    def residual(self, vector: np.ndarray) -> np.ndarray:
        return self.read - vector[0] * np.sin(self.angle + vector[1])


FREE = (
    Free("wave.strength", 0, 0.0, 10.0, 0.1, of_effect=True),
    Free("wave.phase", 1, -3.2, 3.2, 1.0, of_effect=True),
)


def fitted(problem: Wave) -> Fit:
    return levenberg_marquardt(problem, np.array([0.3, 0.8]), FREE, iterations=30, share=0.0)


def linear_half(fit: Fit) -> float:
    rows = np.arange(SIZE)
    groups = Groups((rows,), tuple(np.array_split(rows, 40)))
    return spreads(fit, groups)["wave.strength"].half_width


def test_what_is_certain_is_told_from_nothing_though_its_phase_is_open() -> None:
    problem = Wave(1)
    fit = fitted(problem)
    value = float(fit.vector[0])
    assert value - linear_half(fit) < 0.0, "the linear interval holds nothing"
    found = strength_interval(problem, fit, "wave.strength", 0.0, 3.84)
    assert found is not None
    low, high = found
    # the constant, 0.3 sin(0.8) = 0.215 +- 0.032, is the least strength that makes it
    assert 0.12 < low < 0.25
    assert high > value


def test_what_noise_may_have_made_stays_with_its_linear_interval() -> None:
    problem = Wave(2, strength=0.0)
    problem.read -= problem.read.mean()
    assert strength_interval(problem, fitted(problem), "wave.strength", 0.0, 3.84) is None


@pytest.mark.parametrize("seed", range(3))
def test_where_the_cost_is_a_parabola_it_is_the_linear_one(seed: int) -> None:
    problem = Wave(seed)
    vector = np.array([0.3, 0.8])
    fit = levenberg_marquardt(problem, vector, FREE[:1], iterations=30, share=0.0)
    column = np.sin(problem.angle + 0.8)
    half = 1.96 / float(np.linalg.norm(column))
    soft, _ = soften(fit.residual, fit.soft)
    assert soft.size == SIZE
    found = strength_interval(problem, fit, "wave.strength", 0.0, 1.96**2)
    assert found is not None
    value = float(fit.vector[0])
    assert found[0] == pytest.approx(value - half, abs=0.15 * half)
    assert found[1] == pytest.approx(value + half, abs=0.15 * half)
