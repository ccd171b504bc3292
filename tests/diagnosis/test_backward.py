"""What was added and does no more than runs disagree by is taken out again."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from known_search import RUNS, TICKS, LinearProblem, add, search_of, shape, strength

from eha_bench.diagnosis.fit.least_squares import Fit, levenberg_marquardt
from eha_bench.diagnosis.fit.thresholds import Thresholds
from eha_bench.diagnosis.fit.uncertainty import Spread, spreads
from eha_bench.diagnosis.outcome import honest
from eha_bench.diagnosis.outcome.honest import prune
from eha_bench.diagnosis.search import backward
from eha_bench.diagnosis.search.backward import (
    is_loose,
    is_within_disagreement,
    without,
    without_idle,
)
from eha_bench.diagnosis.search.state import Accepted, Search

FIRST, SECOND = "coulomb_friction", "current_lag"
KEYS = {FIRST: "coulomb_friction.friction_force", SECOND: "current_lag.time_constant"}
UNIT = 0.002
AGREED, DISAGREED = (1.0,) * 6, (1.7, -1.1, 1.5, -0.9, 1.3, -0.7)


@pytest.fixture(autouse=True)
def refits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Refit where a fit stands: linear residuals have no other end over short windows."""

    def refit(search: Search, rough: Fit, extra: object) -> Fit:
        return levenberg_marquardt(search.problem, rough.vector, rough.free)

    monkeypatch.setattr(backward, "polish_afresh", refit)


def found(parts: Sequence[float]) -> Search:
    """Friction is missing, and parts of the runs ask for another lag each, in `UNIT`."""
    problem = LinearProblem(
        {"viscous_friction": 0.1 * shape(0.0), KEYS[FIRST]: 20.0 * shape(1.0) / 7.0,
         KEYS[SECOND]: 5.0 * shape(3.0) / UNIT},
        {KEYS[FIRST]: 7.0},
    )  # fmt: skip
    wanted = np.repeat(parts, TICKS * len(RUNS) // len(parts))
    problem.readings -= 5.0 * shape(3.0) * wanted
    search = search_of(problem, "viscous_friction")
    add(search, FIRST)
    add(search, SECOND)
    return search


def test_what_runs_agree_on_stays() -> None:
    search = found(AGREED)
    assert not is_loose(search, search.accepted[-1])
    assert without_idle(search) is None
    assert prune(search) == []
    assert [item.start.candidate for item in search.effects] == [FIRST, SECOND]
    assert strength(search, search.fit, SECOND) == pytest.approx(UNIT, rel=0.1)


def test_little_that_runs_disagree_on_is_not_accepted() -> None:
    search = found(DISAGREED)
    item = search.accepted[-1]
    # far more than the noise, and less than what runs disagree by
    fall = without(search, item).cost - search.fit.cost
    assert fall > Thresholds().gain
    assert is_loose(search, item)
    assert is_within_disagreement(search, item, fall)
    # the look that it was added in had credited it with what the first did only afterwards
    search.accepted[-1] = replace(item, comparison=search.accepted[0].comparison)
    (refused,) = prune(search)
    assert refused.note.startswith(
        "current_lag is not accepted: without it the others explain as much"
    )
    assert [item.start.candidate for item in search.effects] == [FIRST]


def test_what_another_one_leaves_at_its_bound_is_not_accepted_either(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Without the second, the fit takes the first to the end of its range."""
    search = found(DISAGREED)
    first, second = search.accepted
    search.accepted[1] = replace(second, comparison=first.comparison)
    assert first.start.bound_met(search.fit.vector) is None

    def taken_to_the_bound(search: Search, item: Accepted) -> Fit:
        fit = without(search, item)
        if item.start.candidate == SECOND:
            fit.vector[first.start.strength_at] = first.start.high
        return fit

    monkeypatch.setattr(honest, "without", taken_to_the_bound)
    notes = [item.note for item in prune(search)]
    assert [note.partition(" is not accepted: ")[0] for note in notes] == [SECOND, FIRST]
    assert "its strength is at its bound" in notes[1]
    assert not search.effects


def test_much_that_runs_disagree_on_stays_as_more_may_be_missing() -> None:
    search = found((18.0, 1.0, 15.0, 0.0, 12.0, 2.0))
    item = search.accepted[-1]
    fall = without(search, item).cost - search.fit.cost
    assert is_loose(search, item)
    assert not is_within_disagreement(search, item, fall)


def test_of_a_parabola_the_least_fall_is_the_interval() -> None:
    """h^2 = t^2 inflation / curvature: moved by half a width, the cost rises by the least fall."""
    search = found(AGREED)
    key = KEYS[SECOND]
    spread = spreads(search.fit, search.groups)[key]
    item = next(free for free in search.fit.free if free.key == key)
    normal = search.fit.jacobian.T @ search.fit.jacobian
    at = search.fit.free.index(item)
    curvature = 1.0 / np.linalg.inv(normal)[at, at]
    rise = curvature * (spread.half_width / item.scale) ** 2
    assert rise == pytest.approx(spread.least_fall, rel=0.02)
    assert Spread(1.0).least_fall == pytest.approx(1.96**2, rel=1e-3)


@pytest.mark.parametrize(("size", "stays"), [(0.025, False), (0.3, True)])
def test_what_is_not_distinct_beside_others_and_leaves_nothing_is_not_accepted(
    size: float, stays: bool
) -> None:
    """The first explains all but the noise; to that, too, a lag is fitted."""
    search = found((size,) * 6)
    item = search.accepted[-1]
    search.accepted[-1] = replace(item, comparison=search.accepted[0].comparison)
    notes = [item.note for item in prune(search)]
    assert (SECOND in [one.start.candidate for one in search.effects]) is stays
    assert len(notes) == int(not stays)
    assert all("its size is not distinct from zero" in note for note in notes)
