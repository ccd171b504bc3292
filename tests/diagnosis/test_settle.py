"""Settle: the step of integration, the noise and the fit come to rest together."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from known_search import CHANNEL, LinearProblem, add, model, search_of, shape, strength

from eha_bench.diagnosis.fit.baseline import STEP
from eha_bench.diagnosis.fit.problem import cost_of
from eha_bench.diagnosis.search.settle import rebase, refine, settle

FRICTION, EFFECT = "viscous_friction", "coulomb_friction"
DECLARED = model().plant.layout.by_key[FRICTION].default


def problem(*, level: float = 1.0, stepping: float = 0.0) -> Any:
    slopes = {FRICTION: 0.2 * shape(0.0), "coulomb_friction.friction_force": 5.0 * shape(1.0)}
    truth = {FRICTION: DECLARED + 30.0, "coulomb_friction.friction_force": 7.0}
    return LinearProblem(slopes, truth, level=level, stepping=stepping)


def value(search: Any) -> float:
    return float(search.fit.vector[model().plant.layout.index[FRICTION]])


@pytest.mark.parametrize("level", [0.6, 1.0, 1.4])
def test_the_noise_of_the_readings_is_found(level: float) -> None:
    search = search_of(problem(level=level), FRICTION)
    add(search, EFFECT)
    settle(search)
    assert search.problem.noise[CHANNEL] == pytest.approx(level, rel=0.1)
    assert np.std(search.fit.residual) == pytest.approx(1.0, rel=0.1)
    assert abs(search.excess_left.relative) < 0.2
    assert value(search) == pytest.approx(DECLARED + 30.0, abs=1.0)
    assert strength(search, search.fit, EFFECT) == pytest.approx(7.0, rel=0.05)


def test_the_step_gets_as_fine_as_the_cost_asks_for() -> None:
    search = search_of(problem(stepping=4.0), FRICTION)
    add(search, EFFECT)
    left = search.excess_left.relative
    settle(search)
    assert search.problem.step < STEP
    assert search.excess_left.relative < 0.5 * left


def test_a_step_that_is_fine_enough_changes_nothing() -> None:
    search = search_of(problem(), FRICTION)
    kept = (search.problem, search.fit, search.excess_left)
    refine(search, search.fit.vector)
    assert (search.problem, search.fit, search.excess_left) == kept


def test_a_finer_step_weighs_the_fit_again_where_it_is() -> None:
    search = search_of(problem(stepping=4.0), FRICTION)
    add(search, EFFECT)
    fit = search.fit
    refine(search, fit.vector)
    assert search.problem.step < STEP
    assert np.array_equal(search.fit.vector, fit.vector)
    assert search.fit.cost < fit.cost
    assert np.array_equal(search.fit.residual, search.problem.residual(fit.vector))


def test_the_fit_without_effects_is_weighed_by_the_noise_that_they_revealed() -> None:
    search = search_of(problem(level=0.6), FRICTION)
    before = search.excess_base.total
    add(search, EFFECT)
    settle(search)
    fit = search.fit
    rebase(search)
    assert search.fit is fit
    assert strength(search, search.base, EFFECT) == 0.0
    # residuals in a smaller unit: the same excess counts for more
    assert search.excess_base.total > before
    # and what is calibrated is at its minimum there
    at = model().plant.layout.index[FRICTION]
    for move in (-10.0, 10.0):
        moved = search.base.vector.copy()
        moved[at] += move
        assert cost_of(search.problem, moved) > search.base.cost
