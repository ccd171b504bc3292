"""What another form of an effect explains is no evidence of a second cause."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from known_search import LinearProblem, add, assumed, model, search_of, shape, strength

from eha_bench.diagnosis.search.forms import forms_of, reform
from eha_bench.diagnosis.search.state import Thresholds

EFFECT, OTHER = "coulomb_friction", "current_lag"
FORCE, RATIO = "coulomb_friction.friction_force", "coulomb_friction.static_ratio"
INDEX = model().plant.layout.index


def problem(**truth: float) -> Any:
    """Friction that may fall with speed is missing: its ratio at rest shows in other waves."""
    slopes = {"viscous_friction": 0.1 * shape(0.0), FORCE: 20.0 * shape(1.0) / 7.0,
              RATIO: 10.0 * shape(2.0), "current_lag.time_constant": 5e3 * shape(3.0)}  # fmt: skip
    return LinearProblem(slopes, {FORCE: 7.0} | truth)


def form(search: Any) -> object:
    parameter = model().plant.layout.by_key["coulomb_friction.form"]
    return parameter.decode(search.fit.vector[INDEX["coulomb_friction.form"]])


def test_the_form_that_fits_takes_what_is_left() -> None:
    search = search_of(problem(**{RATIO: 2.0}), "viscous_friction")
    add(search, EFFECT)
    assert form(search) == "constant"
    left = search.excess_left.total
    assert reform(search, Thresholds())
    assert form(search) == "stribeck"
    assert search.excess_left.total < 0.05 * left
    assert search.fit.vector[INDEX[RATIO]] == pytest.approx(2.0, abs=0.05)
    assert strength(search, search.fit, EFFECT) == pytest.approx(7.0, rel=0.05)
    (item,) = search.accepted
    assert RATIO in item.start.keys
    # the whole of it is credited to the one effect
    assert item.comparison.share > 0.95


@pytest.mark.parametrize("ratio", [None, 2.0])
def test_another_cause_is_left_to_be_found(ratio: float | None) -> None:
    truth = {"current_lag.time_constant": 2e-3} | ({RATIO: ratio} if ratio else {})
    search = search_of(problem(**truth), "viscous_friction")
    add(search, EFFECT)
    assert reform(search, Thresholds()) is (ratio is not None)
    assert search.excess_left.relative > 0.5
    add(search, OTHER)
    assert strength(search, search.fit, OTHER) == pytest.approx(2e-3, rel=0.05)
    assert search.excess_left.relative < 0.05


def test_an_assumed_parameter_has_no_forms() -> None:
    search = search_of(problem(**{RATIO: 2.0}), "viscous_friction")
    search.accepted.append(assumed("mass"))
    assert not reform(search, Thresholds())


def test_forms_are_of_the_place_where_the_effect_acts() -> None:
    search = search_of(problem(), "viscous_friction")
    add(search, EFFECT)
    found = forms_of(model().plant.layout, search.accepted[0], search.fit)
    assert found
    assert all(dict(item.settings)[INDEX["coulomb_friction.form"]] == 1.0 for item in found)
