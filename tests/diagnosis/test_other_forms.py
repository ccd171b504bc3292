"""The other forms of an effect that fit as well as the one that was found."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from known_search import LinearProblem, add, assumed, search_of, shape, start_of, strength

from eha_bench.diagnosis.outcome.other_forms import other_forms

SIZE = "asymmetric_friction.asymmetry"


def test_every_form_that_fits_as_well_is_found_with_what_differs():
    search = search_of(LinearProblem({SIZE: 20.0 * shape(1.0)}, {SIZE: 0.5}))
    add(search, "asymmetric_friction")
    item = search.accepted[0]
    found = other_forms(search, item, item.start, search.fit)
    own = search.problem.plant.layout.effect("asymmetric_friction").parameters
    words = next(parameter.choices for parameter in own if parameter.name == "kind")
    chosen = words[int(search.fit.vector[search.problem.plant.layout.index[
        "asymmetric_friction.kind"]])]  # fmt: skip
    assert {one.words for one in found} == {f"kind {word}" for word in words if word != chosen}
    for fit in (one.fit for one in found):
        assert abs(strength(search, fit, "asymmetric_friction") - 0.5) < 0.02


def test_a_form_that_is_behind_is_none():
    wanted = {SIZE: 20.0 * shape(1.0), "mass": shape(2.0)}
    search = search_of(LinearProblem(wanted, {SIZE: 0.5, "mass": 100.0}))
    add(search, "asymmetric_friction")
    item = search.accepted[0]
    # what was found fits better than any form can from where this fit stands
    behind = search.fit
    search.keys = ("mass",)
    add(search, "asymmetric_friction")
    search.keys = ()
    assert behind.cost - search.fit.cost > 12.0
    assert other_forms(search, item, item.start, behind) == []


def test_an_assumed_parameter_and_an_effect_of_one_form_have_no_others():
    search = search_of(LinearProblem({"current_lag.time_constant": 1e3 * shape(1.0)}, {}))
    add(search, "current_lag")
    item, mass = search.accepted[0], assumed("mass")
    assert other_forms(search, item, item.start, search.fit) == []
    assert other_forms(search, mass, mass.start, search.fit) == []


def test_what_an_effect_stands_in_place_of_stays_off():
    slopes = {SIZE: 20.0 * shape(1.0), "current_lag.time_constant": 1e3 * shape(1.0)}
    search = search_of(LinearProblem(slopes, {SIZE: 0.5}))
    add(search, "current_lag")
    item = search.accepted[0]
    start = start_of("asymmetric_friction")
    off = search.base.vector.copy()
    fit = replace(search.fit, vector=start.apply(off))
    found = other_forms(search, item, start, fit)
    assert found
    for other in (one.fit for one in found):
        assert strength(search, other, "current_lag") == 0.0
        assert abs(strength(search, other, "asymmetric_friction") - 0.5) < 0.02
