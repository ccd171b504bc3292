"""Which of the refitted candidates is chosen, which are as good, and which are refitted further."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from known_search import LinearProblem, search_of, shape, start_of

from eha_bench.diagnosis.fit.evidence import SOFT_MEAN, Improvement
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.search import equivalent, stepwise
from eha_bench.diagnosis.search.state import Refit, Search, Thresholds

FRICTION = "viscous_friction"
RIGHT, RIVAL, THIRD = "coulomb_friction", "presliding_friction", "command_delay"
STRENGTHS = {
    RIGHT: "coulomb_friction.friction_force",
    RIVAL: "presliding_friction.distance",
    THIRD: "command_delay.delay",
}
GAINED = Improvement(1000.0, 900.0, 1.0, 0.9, 1e-9, 1.0, 0.9)


@pytest.fixture
def search() -> Search:
    slopes = {FRICTION: 0.2 * shape(0.0), STRENGTHS[RIGHT]: 5.0 * shape(1.0)}
    return search_of(LinearProblem(slopes, {STRENGTHS[RIGHT]: 0.2}), FRICTION)


def trial(search: Search, candidate: str, cost: float, gain_out: float = 900.0) -> Refit:
    """A candidate whose refit is known."""
    start = start_of(candidate)
    start = replace(start, keys=(STRENGTHS[candidate],))
    comparison = replace(GAINED, gain=search.fit.cost - cost, gain_out=gain_out)
    return Refit(start, replace(search.fit, cost=cost), comparison)


@pytest.mark.parametrize(("outs", "chosen"), [((900.0, 850.0), RIVAL), ((850.0, 900.0), RIGHT)])
def test_of_two_that_leave_as_little_the_one_that_carries_over_is_chosen(
    search: Search, outs: tuple[float, float], chosen: str
) -> None:
    """The rival's cost is lower by 2 of 1,000, which is a tie."""
    best = search.fit.cost - 1000.0
    trials = [trial(search, RIVAL, best, outs[0]), trial(search, RIGHT, best + 2.0, outs[1])]
    found = stepwise._choose(trials, Thresholds(), 0.25)
    assert found is not None
    assert found.candidate == chosen


def test_one_that_leaves_clearly_less_is_chosen_whatever_carries_over(search: Search) -> None:
    best = search.fit.cost - 1000.0
    trials = [trial(search, RIVAL, best, 850.0), trial(search, RIGHT, best + 40.0, 900.0)]
    found = stepwise._choose(trials, Thresholds(), 0.25)
    assert found is not None
    assert found.candidate == RIVAL


@pytest.mark.parametrize(
    ("promised", "ended"),
    [
        # what gained least so far promises most: it comes first, and wins
        ({THIRD: 1500.0}, {THIRD: 1900.0}),
        ({}, {RIGHT: 820.0, RIVAL: 700.0}),
        ({THIRD: 390.0}, {RIGHT: 820.0, RIVAL: 700.0}),
    ],
)
def test_a_refit_that_gains_less_than_was_predicted_goes_on(
    search: Search,
    monkeypatch: pytest.MonkeyPatch,
    promised: Mapping[str, float],
    ended: Mapping[str, float],
) -> None:
    ends = {THIRD: 1900.0, RIGHT: 820.0, RIVAL: 700.0}
    cost = search.fit.cost
    started = []

    def polish(_search: Search, fit: Fit, starts: list) -> Fit:
        started.append(starts[0].candidate)
        return replace(fit, cost=cost - ends[starts[0].candidate])

    monkeypatch.setattr(stepwise, "polish_afresh", polish)
    monkeypatch.setattr(stepwise, "polish_at_rest", polish)
    rough = [(RIGHT, 800.0), (RIVAL, 690.0), (THIRD, 200.0)]
    trials = [trial(search, name, cost - gain) for name, gain in rough]
    done = stepwise._finished(search, trials, promised, afresh=True)
    assert {item.candidate for item in done} == {RIGHT, RIVAL, THIRD}
    assert started == list(ended)
    gains = {item.candidate: cost - item.fit.cost for item in done if item.candidate in started}
    assert gains == pytest.approx(ended)


@pytest.mark.parametrize(
    ("behind", "gain_out", "left", "equal"),
    [
        (11.0, 9.0, 1.0, True),
        # at the noise a fall of 12 decides, unless runs left out do not bear it out
        (20.0, 9.0, 1.0, False),
        (20.0, -1.0, 1.0, True),
        # what the chosen one gained a twentieth of is another cause, whatever carries over
        (60.0, -1.0, 1.0, False),
        # above the noise only resampling decides, here a probability of 0.4
        (20.0, 9.0, 1.3, True),
    ],
)
def test_another_is_as_good_where_runs_left_out_do_not_prefer_the_chosen_one(
    search: Search,
    monkeypatch: pytest.MonkeyPatch,
    behind: float,
    gain_out: float,
    left: float,
    equal: bool,
) -> None:
    monkeypatch.setattr(
        equivalent,
        "compare",
        lambda *_: replace(GAINED, gain=behind, gain_out=gain_out, p_value=0.4),
    )
    noise = SOFT_MEAN * search.fit.residual.size
    chosen = replace(search.fit, cost=left * noise)
    other = replace(chosen, cost=chosen.cost + behind)
    assert equivalent.is_as_good(other, chosen, 1000.0, search.groups) is equal
