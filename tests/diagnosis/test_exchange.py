"""Exchange: what was added first gives way to what fits better in its place."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from known_search import LinearProblem, add, assumed, refitted, search_of, shape, strength

from eha_bench.core.workers import IN_PROCESS
from eha_bench.diagnosis import conclusion
from eha_bench.diagnosis.conclusion import Conclusion
from eha_bench.diagnosis.fit.candidates import Start
from eha_bench.diagnosis.fit.thresholds import Thresholds
from eha_bench.diagnosis.outcome.diagnosis import Verdict
from eha_bench.diagnosis.outcome.refusal import Refusal
from eha_bench.diagnosis.search import exchange as module
from eha_bench.diagnosis.search.exchange import (
    exchange,
    take_better_equivalents,
    take_equivalent,
)
from eha_bench.diagnosis.search.state import Refit, Search

TRUE, ALIKE, OTHER = "coulomb_friction", "current_deadband", "current_lag"
STRENGTH = {
    TRUE: "coulomb_friction.friction_force",
    ALIKE: "current_deadband.deadband",
    OTHER: "current_lag.time_constant",
}


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> list[tuple[set[str], set[str]]]:
    """Every attempt: the candidates that were tried, and the effects that were kept meanwhile."""
    attempts: list[tuple[set[str], set[str]]] = []

    class Near:
        """Fits every candidate over all rows; the real one begins with short windows."""

        def __init__(self, search: Search, coarse: object) -> None:
            self.search = search

        def promising(self, starts: Sequence[Start], most: int) -> None:
            self.starts = starts
            kept = {item.start.candidate for item in self.search.accepted}
            attempts.append(({item.candidate for item in starts}, kept))

        def trials(self, most: int) -> list[Refit]:
            found = [refitted(self.search, start) for start in self.starts]
            return sorted(found, key=lambda item: item.fit.cost)[:most]

    monkeypatch.setattr(module, "Near", Near)
    return attempts


def problem(size: float = 20.0, likeness: float = 0.95, **truth: float) -> Any:
    """Friction is missing, and a deadband does nearly the same to the readings."""
    true = size * shape(1.0)
    alike = likeness * true + np.sqrt(1.0 - likeness**2) * size * shape(2.0)
    slopes = {"viscous_friction": 0.1 * shape(0.0), STRENGTH[TRUE]: true / 7.0,
              STRENGTH[ALIKE]: alike / 0.1, STRENGTH[OTHER]: shape(3.0) / 0.002}  # fmt: skip
    return LinearProblem(slopes, {STRENGTH[TRUE]: 7.0} | truth)


def names(search: Search) -> list[str]:
    return [item.start.candidate for item in search.accepted]


def taken_for_equal(search: Search) -> Search:
    """Return the search with the true cause as an equivalent of the look-alike that was found."""
    add(search, ALIKE, TRUE)
    search.accepted = [replace(search.accepted[0], equivalent=(TRUE,))]
    return search


def test_an_equivalent_that_fits_clearly_better_in_the_end_takes_the_place() -> None:
    search = taken_for_equal(search_of(problem(), "viscous_friction"))
    before = search.fit.cost
    take_better_equivalents(search)
    (item,) = search.accepted
    assert (item.start.candidate, item.equivalent) == (TRUE, ())
    assert strength(search, search.fit, ALIKE) == 0.0
    assert search.fit.cost < before - Thresholds().gain


def test_an_equivalent_that_fits_as_well_stays_beside() -> None:
    search = taken_for_equal(search_of(problem(likeness=1.0 - 1e-7), "viscous_friction"))
    take_better_equivalents(search)
    (item,) = search.accepted
    assert (item.start.candidate, item.equivalent) == (ALIKE, (TRUE,))


@pytest.mark.parametrize(("likeness", "equivalent"), [(0.9, ()), (1.0 - 1e-7, (ALIKE,))])
def test_an_equivalent_that_is_behind_in_the_end_is_none(
    likeness: float, equivalent: tuple[str, ...]
) -> None:
    search = search_of(problem(likeness=likeness), "viscous_friction")
    add(search, TRUE, ALIKE)
    search.accepted = [replace(search.accepted[0], equivalent=(ALIKE,))]
    fit = search.fit
    take_better_equivalents(search)
    (item,) = search.accepted
    assert (item.start.candidate, item.equivalent) == (TRUE, equivalent)
    assert search.fit is fit


def test_of_two_equivalents_with_as_many_parameters_the_likelier_comes_first() -> None:
    search = taken_for_equal(search_of(problem(likeness=1.0 - 1e-5), "viscous_friction"))
    before = search.fit.cost
    take_better_equivalents(search)
    (item,) = search.accepted
    assert (item.start.candidate, item.equivalent) == (TRUE, (ALIKE,))
    assert 1.0 < before - search.fit.cost < Thresholds().gain


def test_an_equivalent_takes_the_place_of_what_does_not_stand() -> None:
    search = taken_for_equal(search_of(problem(likeness=1.0 - 1e-7), "viscous_friction"))
    assert take_equivalent(search, search.accepted[0])
    (item,) = search.accepted
    # what does not stand is no equivalent of it any more
    assert (item.start.candidate, item.equivalent) == (TRUE, ())
    assert item.comparison.share > 0.9
    assert strength(search, search.fit, ALIKE) == 0.0
    assert strength(search, search.fit, TRUE) == pytest.approx(7.0, rel=0.05)


@pytest.mark.parametrize(("likeness", "equivalent"), [(0.9, (ALIKE,)), (0.9, ())])
def test_what_is_behind_or_no_equivalent_takes_no_place(
    likeness: float, equivalent: tuple[str, ...]
) -> None:
    search = search_of(problem(likeness=likeness), "viscous_friction")
    add(search, TRUE, ALIKE)
    search.accepted = [replace(search.accepted[0], equivalent=equivalent)]
    fit = search.fit
    assert not take_equivalent(search, search.accepted[0])
    assert (names(search), search.fit) == ([TRUE], fit)


def test_the_end_decides_again_with_an_equivalent(monkeypatch: pytest.MonkeyPatch) -> None:
    search = taken_for_equal(search_of(problem(likeness=1.0 - 1e-7), "viscous_friction"))
    end = Conclusion.__new__(Conclusion)
    end.search, end.refused = search, []
    monkeypatch.setattr(conclusion, "prune", lambda _search: [])
    monkeypatch.setattr(end, "_verdict", lambda: names(search))
    monkeypatch.setattr(end, "_assemble", lambda *, complete: (end.decision, complete))
    against = Refusal(search.accepted[0], "held-out runs are worse with it")
    assert end._without_effect(against, lambda: False, IN_PROCESS, (TRUE,)) == ([TRUE], True)
    assert end.refused == [against]


def test_what_is_there_already_takes_no_place() -> None:
    search = taken_for_equal(search_of(problem(likeness=1.0 - 1e-7), "viscous_friction"))
    alike = search.accepted[0]
    add(search, TRUE)
    assert names(search) == [ALIKE, TRUE]
    assert not take_equivalent(search, alike)
    assert names(search) == [ALIKE, TRUE]


@pytest.mark.parametrize("second_is_worse", [True, False])
def test_held_out_runs_choose_between_two_causes_only(
    monkeypatch: pytest.MonkeyPatch, second_is_worse: bool
) -> None:
    """The first is refused; the second stands where no error grows with it, or nothing does."""
    search = taken_for_equal(search_of(problem(likeness=1.0 - 1e-7), "viscous_friction"))
    monkeypatch.setattr(search.__class__, "is_unexplained", property(lambda _: False))
    end = Conclusion.__new__(Conclusion)
    end.search, end.refused = search, []
    growth = {ALIKE: 1.5, TRUE: 1.02 if second_is_worse else 0.5}

    def assembled(*, complete: bool) -> Any:
        effects = [SimpleNamespace(id=name) for name in names(search)]
        verdict = Verdict.EFFECT if effects else Verdict.UNKNOWN
        return SimpleNamespace(
            complete=complete, verdict=verdict, effects=effects, notes=[], remainder=None,
            with_note=lambda note: SimpleNamespace(effects=effects, note=note),
        )  # fmt: skip

    def too_much(search: Search, found: Any, limit: float) -> Refusal | None:
        (item,) = search.accepted
        grown = growth[item.start.candidate]
        return Refusal(item, f"grows {grown} times") if grown > limit else None

    monkeypatch.setattr(conclusion, "prune", lambda _search: [])
    monkeypatch.setattr(conclusion, "against_the_end", lambda s, found: too_much(s, found, 1.05))
    monkeypatch.setattr(
        conclusion,
        "against_second",
        lambda s, second, found: too_much(s, found, 1.0) if second else None,
    )
    monkeypatch.setattr(conclusion, "drop", lambda s, item, _fit: setattr(s, "accepted", []))
    monkeypatch.setattr(conclusion, "without", lambda _search, _item: None)
    monkeypatch.setattr(end, "_verdict", lambda: None)
    monkeypatch.setattr(end, "_assemble", assembled)
    found = end._what_stands(assembled(complete=True), lambda: False, IN_PROCESS)
    assert names(search) == ([] if second_is_worse else [TRUE])
    assert [item.item.start.candidate for item in end.refused] == [ALIKE, TRUE][
        : 1 + second_is_worse
    ]
    if not second_is_worse:
        assert found.note.startswith(f"held-out runs decided for {TRUE}")


def test_an_interruption_while_deciding_again_names_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    search = taken_for_equal(search_of(problem(), "viscous_friction"))
    end = Conclusion.__new__(Conclusion)
    end.search, end.refused = search, []
    monkeypatch.setattr(conclusion, "without", _interrupted)
    monkeypatch.setattr(end, "_assemble", lambda *, complete: (end.decision.verdict, complete))
    against = Refusal(search.accepted[0], "it is the mean of what follows position")
    assert end._without_effect(against, lambda: False, IN_PROCESS) == (Verdict.UNKNOWN, False)
    assert names(search) == []
    assert f"interrupted where {ALIKE} is not accepted" in end.decision.notes[0]


def _interrupted(*_: object) -> None:
    raise KeyboardInterrupt


def test_the_wrong_look_alike_is_replaced(tried: list[Any]) -> None:
    search = search_of(problem(), "viscous_friction")
    add(search, ALIKE, TRUE, OTHER)
    before = search.fit.cost
    assert exchange(search)
    assert names(search) == [TRUE]
    assert strength(search, search.fit, TRUE) == pytest.approx(7.0, rel=0.05)
    assert strength(search, search.fit, ALIKE) == 0.0
    assert search.fit.cost < before - Thresholds().gain
    assert search.excess_left.relative < 0.1 < search.excess_base.relative
    # measured against the fit with nothing in its place, not against the look-alike
    assert search.accepted[0].comparison.share > 0.9
    # beside nothing else, the same would be found again
    attempts = len(tried)
    assert not exchange(search)
    assert len(tried) == attempts


def test_the_right_one_stays_and_is_not_tried_twice(tried: list[Any]) -> None:
    search = search_of(problem(), "viscous_friction")
    add(search, TRUE, ALIKE, OTHER)
    fit, left = search.fit, search.excess_left
    assert not exchange(search)
    assert names(search) == [TRUE]
    assert (search.fit, search.excess_left, search.exchanged_from) == (fit, left, fit)
    attempts = len(tried)
    assert attempts == 1
    assert not exchange(search)
    assert len(tried) == attempts


@pytest.mark.parametrize(("gain", "changed"), [(10.0, True), (1e9, False)])
def test_less_than_the_least_gain_changes_nothing(
    gain: float, changed: bool, tried: list[Any]
) -> None:
    search = search_of(problem(), "viscous_friction")
    search.thresholds = Thresholds(gain=gain)
    add(search, ALIKE, TRUE)
    assert exchange(search) is changed
    assert names(search) == ([TRUE] if changed else [ALIKE])


def test_only_close_rivals_of_its_own_look_are_tried(tried: list[Any]) -> None:
    search = search_of(problem(), "viscous_friction")
    add(search, ALIKE, TRUE, OTHER)
    exchange(search)
    # the lag gained next to nothing in that look
    assert tried == [({ALIKE, TRUE}, set())]


def test_what_else_was_added_is_kept_meanwhile_and_no_rival(tried: list[Any]) -> None:
    both = problem(**{STRENGTH[OTHER]: 0.004 * 10.0})
    search = search_of(both, "viscous_friction")
    add(search, OTHER)
    add(search, ALIKE, TRUE, OTHER)
    exchange(search)
    assert tried == [({OTHER}, {ALIKE}), ({ALIKE, TRUE}, {OTHER})]
    assert names(search) == [OTHER, TRUE]
    assert strength(search, search.fit, OTHER) == pytest.approx(0.04, rel=0.1)


def test_an_assumed_parameter_is_never_exchanged(tried: list[Any]) -> None:
    search = search_of(problem(), "viscous_friction")
    search.accepted.append(assumed("voltage_limit"))
    assert not exchange(search)
    assert tried == []


def test_the_winner_is_not_its_own_equal(tried: list[Any]) -> None:
    search = search_of(problem(), "viscous_friction")
    add(search, ALIKE, TRUE)
    search.accepted[0] = search.accepted[0].__class__(
        search.accepted[0].start, search.accepted[0].comparison, (TRUE, OTHER)
    )
    exchange(search)
    assert search.accepted[0].equivalent == (OTHER,)


def test_an_interruption_leaves_the_search_as_it_was(
    monkeypatch: pytest.MonkeyPatch, tried: list[Any]
) -> None:
    search = search_of(problem(), "viscous_friction")
    add(search, ALIKE, TRUE)
    kept = (search.fit, search.excess_left, list(search.accepted), search.problem)

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    stopped: Callable[..., None] = stop
    monkeypatch.setattr(module, "polish_to_the_bottom", stopped)
    with pytest.raises(KeyboardInterrupt):
        exchange(search)
    assert (search.fit, search.excess_left, search.accepted, search.problem) == kept
