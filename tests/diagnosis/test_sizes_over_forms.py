"""Intervals of sizes span all forms of a law that fit as well."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any, cast

from hypothesis import given
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).parent))

from known_search import LinearProblem, add, model, search_of, shape

from eha_bench.diagnosis.fit.uncertainty import Estimate
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis, FoundEffect, Verdict
from eha_bench.diagnosis.outcome.other_forms import OtherForm, other_forms
from eha_bench.diagnosis.outcome.sizes_over_forms import with_sizes_over_forms

AIR = "entrained_air"
NO_FIT = cast(Any, None)


def estimate(value: float, half: float) -> Estimate:
    return Estimate(value, value - half, value + half, "")


def found(**numbers: Estimate) -> Diagnosis:
    effect = FoundEffect(AIR, "flow", numbers)
    return Diagnosis(Verdict.EFFECT, model(), model(), (effect,), None, (), {}, ())


def form(words: str, **numbers: Estimate) -> OtherForm:
    return OtherForm(words, NO_FIT, numbers)


def test_an_interval_spans_the_forms_that_fit_as_well_and_a_note_says_so() -> None:
    polytrope = form("gas polytropic", air_fraction=estimate(0.0222, 0.0099))
    gauge = form("gas gauge", air_fraction=estimate(0.0316, 0.0009))
    result = with_sizes_over_forms(
        found(air_fraction=estimate(0.0298, 0.001)), {AIR: [polytrope, gauge]}
    )
    size = result.effects[0].parameters["air_fraction"]
    assert size.value == 0.0298
    assert math.isclose(size.low, 0.0123)
    assert math.isclose(size.high, 0.0325)
    assert "gas polytropic (air_fraction 0.0222) or gas gauge (air_fraction 0.0316)" in str(
        result.notes
    )


def test_forms_that_agree_change_nothing() -> None:
    before = found(air_fraction=estimate(0.03, 0.001))
    same = form("gas gauge", air_fraction=estimate(0.03, 0.00105))
    assert with_sizes_over_forms(before, {AIR: [same]}) == before
    assert with_sizes_over_forms(before, {}) == before


def test_a_number_without_an_interval_gets_none() -> None:
    before = found(air_fraction=estimate(0.03, math.inf))
    other = form("gas gauge", air_fraction=estimate(0.04, 0.001))
    assert with_sizes_over_forms(before, {AIR: [other]}) == before


def test_a_number_that_a_form_does_not_have_stays() -> None:
    own = {"air_fraction": estimate(0.03, 0.001), "index": estimate(1.2, 0.1)}
    other = form("gas absolute", air_fraction=estimate(0.04, 0.001))
    (effect,) = with_sizes_over_forms(found(**own), {AIR: [other]}).effects
    assert effect.parameters["index"] == own["index"]
    assert effect.parameters["air_fraction"].high == 0.041


@given(
    st.floats(-1.0, 1.0), st.floats(1e-3, 1.0),
    st.lists(st.tuples(st.floats(-2.0, 2.0), st.floats(1e-3, 1.0)), max_size=3),
)  # fmt: skip
def test_no_interval_becomes_narrower_and_each_form_is_nearly_inside(
    value: float, half: float, others: list[tuple[float, float]]
) -> None:
    own = estimate(value, half)
    forms = [form("other", size=estimate(*other)) for other in others]
    (effect,) = with_sizes_over_forms(found(size=own), {AIR: forms}).effects
    size = effect.parameters["size"]
    assert size.low <= own.low
    assert size.high >= own.high
    # a tenth of the width is not worth another interval
    for middle, width in others:
        assert size.low - 0.2 * half <= middle - width
        assert middle + width <= size.high + 0.2 * half


def test_a_form_brings_its_own_size_with_an_interval() -> None:
    size = "asymmetric_friction.asymmetry"
    search = search_of(LinearProblem({size: 20.0 * shape(1.0)}, {size: 0.5}))
    add(search, "asymmetric_friction")
    item = search.accepted[0]
    forms = other_forms(search, item, item.start, search.fit)
    assert forms
    for one in forms:
        asymmetry = one.sizes["asymmetry"]
        assert asymmetry.low < 0.5 < asymmetry.high
        assert asymmetry.high - asymmetry.low < 0.05
