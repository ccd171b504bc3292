"""Which candidates of a look are refitted to the end."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from known_search import LinearProblem, add, search_of, shape, start_of

from eha_bench.diagnosis.fit.evidence import NOT_COMPARED
from eha_bench.diagnosis.search import look as module
from eha_bench.diagnosis.search.state import Refit, Search

FRICTION, EFFECT = "viscous_friction", "coulomb_friction"
STRENGTH = "coulomb_friction.friction_force"


def search_with(missing: float, significance: float) -> Search:
    """A search of which `missing` of the cost is left, with structure in time or without."""
    search = search_of(LinearProblem({FRICTION: 0.2 * shape(0.0), STRENGTH: shape(1.0)}, {}))
    left = replace(search.excess_base, total=missing, significance=significance)
    search.excess_base = search.excess_left = left
    search.fit = replace(search.fit, cost=missing + 1000.0)
    return search


@pytest.mark.parametrize(("gain", "significance", "polished"), [
    # 15 % of 10,000 are enough to be added: a rough refit that gains 3 % will not come to that
    (300.0, 100.0, False),
    (600.0, 100.0, True),
    # without structure, what is clear is enough
    (300.0, 0.0, True),
])  # fmt: skip
def test_what_cannot_be_added_is_not_refitted_to_the_end(
    monkeypatch: pytest.MonkeyPatch, gain: float, significance: float, polished: bool
) -> None:
    search = search_with(10_000.0, significance)
    trial = Refit(start_of(EFFECT), replace(search.fit, cost=search.fit.cost - gain), NOT_COMPARED)
    done: list[str] = []

    def polish(_: Search, rough: Any, extra: Any) -> Any:
        done.append(extra[0].candidate)
        return rough

    monkeypatch.setattr(module, "polish_at_rest", polish)
    assert module._refit_promising(search, [trial], {}, afresh=False) == [trial]
    assert bool(done) is polished
    # what a prediction promises may come to it
    module._refit_promising(search, [trial], {EFFECT: 5000.0}, afresh=False)
    assert done


def test_close_rivals_that_cannot_be_added_are_left_as_they_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    search = search_with(10_000.0, 100.0)
    finals = [
        Refit(start_of(name), replace(search.fit, cost=search.fit.cost - gain), NOT_COMPARED)
        for name, gain in ((EFFECT, 300.0), ("gravity_load", 290.0))
    ]
    for name in ("at_the_bottom", "polish_to_the_bottom", "refine"):
        monkeypatch.setattr(module, name, lambda *_: pytest.fail("fitted on"))
    assert module._fit_rivals_further(search, finals) == finals


def test_beside_an_effect_a_part_of_what_it_leaves_is_needed() -> None:
    search = search_with(10_000.0, 0.0)
    assert module._least_of_hopeful(search) == 0.0
    add(search, EFFECT)
    search.excess_left = replace(search.excess_left, total=10_000.0)
    assert module._least_of_hopeful(search) == pytest.approx(450.0)


@pytest.mark.parametrize(("gain", "to_go", "fitted_on"), [
    (9_300.0, 10.0, False),  # 7 % behind one that is down at the noise
    (9_300.0, 100.0, True),  # five times as much would bring it near
    (9_700.0, 10.0, True),  # may be as good in the end
])  # fmt: skip
def test_what_can_no_longer_be_as_good_as_one_at_the_noise_is_not_fitted_on(
    monkeypatch: pytest.MonkeyPatch, gain: float, to_go: float, fitted_on: bool
) -> None:
    search = search_with(10_000.0, 100.0)
    search.excess_left = replace(search.excess_left, size=3000)
    best, rival = (
        Refit(start_of(name), replace(search.fit, cost=search.fit.cost - gained), NOT_COMPARED)
        for name, gained in ((EFFECT, 9_990.0), ("gravity_load", gain))
    )
    done: list[str] = []

    def polish(_: Search, fit: Any, extra: Any) -> Any:
        done.append(extra[0].candidate)
        return fit

    monkeypatch.setattr(module, "polish_to_the_bottom", polish)
    monkeypatch.setattr(module, "at_the_bottom", lambda _, fit: fit)
    monkeypatch.setattr(module, "is_far_above_noise", lambda _: False)
    monkeypatch.setattr(module, "refine", lambda *_: None)
    left = {id(best.fit): 0.0, id(rival.fit): to_go}
    monkeypatch.setattr(module, "left_to_gain", lambda fit: left[id(fit)])
    module._fit_rivals_further(search, [best, rival])
    assert done == ([EFFECT, "gravity_load"] if fitted_on else [])
