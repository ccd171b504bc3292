"""What another form of an effect explains is no evidence of a second cause."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from known_search import LinearProblem, add, assumed, model, search_of, shape, strength

from eha_bench.diagnosis.fit.candidates import effect_starts
from eha_bench.diagnosis.fit.evidence import NOT_COMPARED
from eha_bench.diagnosis.search.exchange import compared
from eha_bench.diagnosis.search.forms import forms_of, held_keys, places, take_best_form
from eha_bench.diagnosis.search.state import Accepted
from eha_bench.plants.network.file import load_plant

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
    assert take_best_form(search, search.accepted[-1])
    # these readings do not tell how it falls
    assert form(search) in {"stribeck", "exponential"}
    assert search.excess_left.total < 0.05 * left
    assert search.fit.vector[INDEX[RATIO]] == pytest.approx(2.0, abs=0.05)
    assert strength(search, search.fit, EFFECT) == pytest.approx(7.0, rel=0.05)
    (item,) = search.accepted
    assert RATIO in item.start.keys
    # the whole of it is credited to the one effect
    assert item.comparison.share > 0.95


@pytest.mark.parametrize(("ratio", "missing", "equivalent"), [
    # beside what is missing the form hardly counts
    (1.1, 3.0, ("current_lag",)),
    (2.0, 3.0, ()),
    # at the noise it does
    (1.1, 0.0, ()),
])  # fmt: skip
def test_what_is_as_good_stays_where_the_form_hardly_counts(
    ratio: float, missing: float, equivalent: tuple[str, ...]
) -> None:
    own = problem(**{RATIO: ratio})
    own.readings += missing * shape(5.0)
    search = search_of(own, "viscous_friction")
    add(search, EFFECT)
    search.accepted = [replace(search.accepted[-1], equivalent=("current_lag",))]
    before = search.fit.cost
    assert take_best_form(search, search.accepted[-1])
    assert search.fit.cost < before - 30.0
    assert search.accepted[-1].equivalent == equivalent


def test_the_gain_of_a_form_is_that_over_the_calibrated_model() -> None:
    """Without the effect a calibrated parameter takes most of what it does."""
    slopes = {"viscous_friction": 0.1 * shape(0.0), FORCE: 20.0 * (shape(0.0) + 0.2 * shape(1.0))}
    search = search_of(LinearProblem(slopes, {FORCE: 7.0}), "viscous_friction")
    add(search, EFFECT)
    (item,) = search.accepted
    found = compared(search, item, search.fit)
    assert found.gain == pytest.approx(search.base.cost - search.fit.cost, rel=0.05)
    assert 0.9 < found.share_out < 1.2


def test_a_shape_that_ran_off_is_fitted_anew_at_the_present_size() -> None:
    """A friction that falls at speeds that no run reaches says no more than a constant one."""
    search = search_of(problem(**{RATIO: 2.0}), "viscous_friction")
    add(search, EFFECT)
    assert take_best_form(search, search.accepted[-1])
    velocity, vector = INDEX["coulomb_friction.stribeck_velocity"], search.fit.vector.copy()
    vector[velocity] = 99.0
    search.fit = replace(search.fit, vector=vector)
    (item,) = search.accepted
    starts = forms_of(model().plant.layout, item, search.fit)
    found = [(start, place) for start, place in places(search, item, starts) if RATIO in start.keys]
    anew = [place for start, place in found if place[velocity] < 10.0]
    assert len({place[velocity] for place in anew}) > 1
    assert all(place[INDEX[FORCE]] == pytest.approx(vector[INDEX[FORCE]]) for place in anew)
    assert len({place.tobytes() for _, place in found}) == len(found)


@pytest.mark.parametrize("ratio", [None, 2.0])
def test_another_cause_is_left_to_be_found(ratio: float | None) -> None:
    truth = {"current_lag.time_constant": 2e-3} | ({RATIO: ratio} if ratio else {})
    search = search_of(problem(**truth), "viscous_friction")
    add(search, EFFECT)
    assert take_best_form(search, search.accepted[-1]) is (ratio is not None)
    assert search.excess_left.relative > 0.5
    add(search, OTHER)
    assert strength(search, search.fit, OTHER) == pytest.approx(2e-3, rel=0.05)
    assert search.excess_left.relative < 0.05


def test_a_form_whose_shape_ends_at_a_bound_is_not_taken() -> None:
    """A ratio of static friction beyond what it may be says that something else is there."""
    search = search_of(problem(**{RATIO: 9.0}), "viscous_friction")
    add(search, EFFECT)
    assert not take_best_form(search, search.accepted[-1])
    assert form(search) == "constant"


def test_an_assumed_parameter_has_no_forms() -> None:
    search = search_of(problem(**{RATIO: 2.0}), "viscous_friction")
    search.accepted.append(assumed("mass"))
    assert not take_best_form(search, search.accepted[-1])


def test_forms_are_of_the_place_where_the_effect_acts() -> None:
    search = search_of(problem(), "viscous_friction")
    add(search, EFFECT)
    found = forms_of(model().plant.layout, search.accepted[0], search.fit)
    assert found
    assert all(dict(item.settings)[INDEX["coulomb_friction.form"]] != 0.0 for item in found)


def test_a_count_that_a_scan_has_found_stays(repository: Path) -> None:
    """Free, a count of teeth runs to one a turn, where it is a weight."""
    layout = load_plant(repository / "suites/plants/geared_servo.yaml").layout
    effect = layout.effect("cogging_torque")
    plain = effect_starts(layout, effect)[0]
    keys = tuple(key for key in plain.keys if not key.endswith(".count"))
    vector = plain.apply(layout.defaults())
    vector[layout.index["cogging_torque.count"]] = 18.0
    item = Accepted(replace(plain, keys=keys), NOT_COMPARED, ())
    fit: Any = SimpleNamespace(vector=vector)
    assert held_keys(layout, item, fit) == {"cogging_torque.count"}
    found = forms_of(layout, item, fit)
    assert all("cogging_torque.count" not in start.keys for start in found)
    assert any("cogging_torque.second" in start.keys for start in found)


def test_teeth_that_give_way_are_a_form_of_play(repository: Path) -> None:
    """Looked for once a play is found: at the present play, from several stiffnesses."""
    layout = load_plant(repository / "suites/plants/geared_servo.yaml").layout
    effect = layout.effect("gear_backlash")
    contact = layout.index["gear_backlash.contact"]
    own = effect_starts(layout, effect)
    assert own
    assert all(dict(start.settings)[contact] == 0.0 for start in own)
    assert all("gear_backlash.compliance" not in start.keys for start in own)
    vector = own[0].apply(layout.defaults())
    item = Accepted(own[0], NOT_COMPARED, ())
    found = forms_of(layout, item, cast(Any, SimpleNamespace(vector=vector)))
    elastic = [start for start in found if dict(start.settings)[contact] == 1.0]
    compliance = layout.index["gear_backlash.compliance"]
    assert len({dict(start.settings)[compliance] for start in elastic} - {0.0}) == 4
    assert all("gear_backlash.compliance" in start.keys for start in elastic)
