"""A calibration that ended far from what is believed begins again from there."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from known_search import LinearProblem, model, shape

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit import starts
from eha_bench.diagnosis.fit.beliefs import Belief
from eha_bench.diagnosis.fit.least_squares import free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.starts import MultistartFit, best_fit_of_starts

KEY = "viscous_friction"
SLOPE = 0.02 * shape(1.0)


def _arrival(monkeypatch: pytest.MonkeyPatch, stuck_at: float, truth: float) -> MultistartFit:
    """The best fit where the one from the declared values stays at a place far from any minimum."""
    problem = LinearProblem({KEY: SLOPE}, {KEY: truth})
    layout = problem.plant.layout
    vector = model().vector()
    at = layout.index[KEY]
    problem.beliefs = (Belief(KEY, at, float(vector[at]), 0.1 * float(vector[at])),)
    free = free_parameters(layout, [KEY], vector)
    stuck = vector.copy()
    stuck[at] = stuck_at
    fit = levenberg_marquardt(problem, stuck, free, iterations=0)
    monkeypatch.setattr(starts, "_from_declared", lambda *_: MultistartFit(fit))
    seen: list[FloatArray] = []
    found = best_fit_of_starts(problem, vector, free, seen.append)
    assert [*seen[-1:]] == [found.fit.vector] * (found.fit is not fit)
    return found


def test_it_begins_again_from_what_is_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    declared = float(model().vector()[model().plant.layout.index[KEY]])
    found = _arrival(monkeypatch, 10.0 * declared, 1.1 * declared)
    at = model().plant.layout.index[KEY]
    assert found.fit.vector[at] == pytest.approx(1.1 * declared, abs=8.0)
    # the end before was no other way to the same
    assert (found.tried, found.agreed) == (2, 1)


@pytest.mark.parametrize("off", [1.2, 1.0])
def test_what_agrees_with_what_is_believed_stays(
    monkeypatch: pytest.MonkeyPatch, off: float
) -> None:
    declared = float(model().vector()[model().plant.layout.index[KEY]])
    found = _arrival(monkeypatch, off * declared, 1.1 * declared)
    assert found.fit.vector[model().plant.layout.index[KEY]] == pytest.approx(off * declared)
    assert (found.tried, found.agreed) == (1, 1)


def test_what_the_data_ask_for_stays_however_far_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    declared = float(model().vector()[model().plant.layout.index[KEY]])
    truth = 3.0 * declared
    problem = LinearProblem({KEY: SLOPE}, {KEY: truth})
    at = problem.plant.layout.index[KEY]
    best = truth - float(SLOPE @ problem.readings / (SLOPE @ SLOPE))
    found = _arrival(monkeypatch, best, truth)
    assert found.fit.vector[at] == pytest.approx(best, rel=1e-3)
    # both starts end there
    assert (found.tried, found.agreed) == (2, 2)
