"""Where a candidate's fit begins."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from eha_bench.diagnosis.fit.beliefs import Belief
from eha_bench.diagnosis.fit.candidates import Start
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.own_parameters import RunParameter
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.search import refit
from eha_bench.diagnosis.search.refit import Near, Nearby, starting_point
from eha_bench.diagnosis.search.screen import Screened
from eha_bench.diagnosis.search.state import Search


class Squared:
    """Residuals that an effect moves by the square of its strength; 0.3 is the truth."""

    soft = 1e6

    def residual(self, vector: np.ndarray) -> np.ndarray:
        return np.array([100.0 * (0.3**2 - vector[0] ** 2)])


@pytest.mark.parametrize("predicted", [0.1, 0.4, 8.5, 300.0])
def test_a_fit_never_begins_where_it_is_worse_than_without(predicted: float) -> None:
    problem = Squared()
    nothing = problem.residual(np.zeros(1))
    fit = Fit(np.zeros(1), (), nothing, np.zeros((1, 0)), float(nothing @ nothing), 0, problem.soft)
    start = Start("effect", (), 0, 0.0, 1.0, 0.0, 1e3, ("effect.strength",), "force")
    item = Screened(start, predicted, 1.0, np.zeros(1, dtype=np.float32))
    vector = starting_point(problem, item, fit)
    residual = problem.residual(vector)
    assert 0.0 < vector[0] <= predicted
    if predicted < 30.0:
        assert float(residual @ residual) < fit.cost
    if predicted < 0.42:  # good as it was
        assert vector[0] == predicted


@pytest.mark.parametrize(
    ("behind", "rows", "chosen"), [(2.0, 10_000, 1), (4.0, 10_000, 2), (2.0, 500, 2)]
)
def test_a_form_needs_its_further_numbers_or_goes(behind: float, rows: int, chosen: int) -> None:
    """Of 100 that a form of two numbers gains, one number may leave 3, and 0.3 % of the noise."""
    none = np.zeros(0)
    nothing = Fit(none, (), none, np.zeros((0, 0)), 1000.0)
    one = Start("effect", (), 0, 0.0, 1.0, 0.0, 1e3, ("effect.strength",), "force")
    two = replace(one, keys=("effect.strength", "effect.damping"))
    near = object.__new__(Near)
    near.fit = nothing
    near.problem = SimpleNamespace(size=rows)
    forms = [
        Nearby((two,), replace(nothing, cost=900.0)),
        Nearby((one,), replace(nothing, cost=900.0 + behind)),
    ]
    assert len(near._simplest(forms).starts[0].keys) == chosen


@pytest.mark.parametrize(
    ("predicted", "gained", "top", "taken_on"),
    [
        (600.0, 590.0, 600.0, False),  # as good as the best
        (610.0, 490.0, 630.0, True),  # promised as much as the best gains, and stopped earlier
        (450.0, 400.0, 630.0, False),  # promised less than the best gains
        (450.0, 300.0, 310.0, True),  # much less than was predicted, though nearly the best
        (200.0, 108.0, 110.0, False),  # of so little, less than was predicted means nothing
    ],
)
def test_what_promised_as_much_as_the_best_is_fitted_as_far(
    predicted: float, gained: float, top: float, *, taken_on: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    none = np.zeros(0)
    nothing = Fit(none, (), none, np.zeros((0, 0)), 1700.0)
    start = Start("effect", (), 0, 0.0, 1.0, 0.0, 1e3, ("effect.strength",), "force")
    near = object.__new__(Near)
    near.fit = nothing
    near.problem = SimpleNamespace(size=1030)  # 700 are missing
    better = replace(nothing, cost=1000.0)
    monkeypatch.setattr(refit, "levenberg_marquardt", lambda *_, **__: better)
    item = Screened(start, 1.0, predicted, none)
    rough = Nearby((start,), replace(nothing, cost=1700.0 - gained))
    found = near._further(item, nothing, rough, top)
    assert (found.fit is better) is taken_on


@pytest.mark.parametrize(
    ("near_value", "declared", "within", "tried"),
    [
        (2.9, 1.0, None, False),
        (2.9, 1.0, 1.0, True),  # beyond what is given under `within`
        (1.9, 1.0, 1.0, False),
        (3.1, 1.0, None, True),  # three times as large
        (0.3, 1.0, None, True),
        (0.0, 1.0, None, True),  # at a bound: what scales it does nothing there
        (-1.0, 1.0, None, True),
        (5.0, 0.0, None, False),  # declared as none: how far is far is not known
    ],
)
def test_declared_values_are_tried_as_well_where_parameters_have_gone_far(
    near_value: float,
    declared: float,
    within: float | None,
    tried: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = []
    beliefs = () if within is None else (Belief("friction", 0, declared, within / math.sqrt(3.0)),)

    def fitted(_problem: object, vector: np.ndarray, *_: object, **__: object) -> Fit:
        found.append(vector.copy())
        return Fit(vector, (), np.zeros(0), np.zeros((0, 0)), 0.0)

    monkeypatch.setattr(refit, "levenberg_marquardt", fitted)
    near = object.__new__(Near)
    near.fit = Fit(np.array([near_value, 7.0]), (), np.zeros(0), np.zeros((0, 0)), 0.0)
    near.problem = SimpleNamespace(beliefs=beliefs)
    near.search = _search_of({"friction": 0}, np.array([declared, 7.0]))
    monkeypatch.setattr(near, "_free", lambda *_: ())
    assert len(list(near._as_declared())) == int(tried)
    for vector in found:
        assert vector.tolist() == [declared, 7.0]


def test_what_nobody_declared_stays_as_fitted() -> None:
    """A load of kilonewtons that is set to nothing bends all that is fitted after it."""
    load = RunParameter("load.force", "steps", 1)
    search = _search_of({"friction": 0, load.key: 1}, np.array([1.0, 0.0]), load)
    assert search.as_declared(np.array([5.0, 3000.0])).tolist() == [1.0, 3000.0]


def _search_of(index: dict[str, int], declared: np.ndarray, *behind: RunParameter) -> Search:
    search = object.__new__(Search)
    search.keys, search.declared_vector = tuple(index), declared
    places = SimpleNamespace(index=index, behind=behind)
    search.problem = cast(Problem, SimpleNamespace(places=places))
    return search
