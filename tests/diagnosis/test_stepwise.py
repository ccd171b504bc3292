"""The search as a whole: what a second pass over a search with effects leaves as it was."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from known_search import LinearProblem, add, search_of, shape, strength

from eha_bench.diagnosis.fit.thresholds import DEFAULT
from eha_bench.diagnosis.search import stepwise
from eha_bench.diagnosis.search.refit import is_bent

FRICTION, EFFECT = "viscous_friction", "coulomb_friction"
STRENGTH = "coulomb_friction.friction_force"


def test_a_second_pass_keeps_the_fit_without_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    """Noise told anew begins a second pass: the share of what was found must not become nothing."""
    slopes = {FRICTION: 0.2 * shape(0.0), STRENGTH: 5.0 * shape(1.0)}
    search = search_of(LinearProblem(slopes, {STRENGTH: 0.13}), FRICTION)
    assert DEFAULT.is_unexplained(search.excess_base)
    assert not is_bent(search.excess_base)
    add(search, EFFECT)
    before = search.excess_base.total
    for name in ("_grow", "release"):
        monkeypatch.setattr(stepwise, name, lambda *_: None)
    stepwise.run(search, lambda *_: None)
    assert search.excess_base.total == before
    assert strength(search, search.base, EFFECT) == 0.0


@pytest.mark.parametrize(
    ("errors", "unexplained"),
    [
        # thirty samples of 7 sigma: by themselves, or three at a time with alternating signs
        (lambda rng: rng.choice(1200, 30, replace=False), False),
        (lambda rng: np.ravel(np.arange(20, 1200, 120)[:, None] + np.arange(3)), True),
    ],
)
def test_what_comes_in_bursts_is_not_single_outliers(errors: Any, unexplained: bool) -> None:
    problem = LinearProblem({FRICTION: 0.2 * shape(0.0)}, {})
    rows = errors(np.random.default_rng(3))
    problem.readings[rows] += 9.0 * np.where(np.arange(rows.size) % 2, -1.0, 1.0)
    rest = search_of(problem, FRICTION).excess_base
    assert rest.relative > 0.2
    assert rest.significance < DEFAULT.structure
    assert DEFAULT.is_unexplained(rest) is unexplained


@pytest.mark.parametrize(("left", "asked"), [(10_000.0, False), (50_000.0, True)])
def test_no_other_two_are_looked_for_where_one_leaves_only_its_form(
    monkeypatch: pytest.MonkeyPatch, left: float, asked: bool
) -> None:
    search = search_of(LinearProblem({FRICTION: 0.2 * shape(0.0), STRENGTH: shape(1.0)}, {}))
    add(search, EFFECT)
    search.excess_base = replace(search.excess_base, total=1e6, significance=100.0)
    search.excess_left = replace(search.excess_base, total=left)
    seen: list[str] = []
    for name in ("_grow", "release", "take_better_equivalents", "compare_over_whole_runs"):
        monkeypatch.setattr(stepwise, name, lambda *_: None)
    monkeypatch.setattr(stepwise, "exchange", lambda *_: False)
    monkeypatch.setattr(stepwise, "joint", lambda *_: seen.append("joint"))
    stepwise.run(search, lambda *_: None)
    assert bool(seen) is asked


@pytest.mark.parametrize(("left", "other", "looks"), [
    # little moved: a look from there would find what the last one found
    (0.95, False, 1),
    (0.80, False, 2),
    (0.95, True, 2),
])  # fmt: skip
def test_another_look_is_taken_where_an_exchange_led_elsewhere(
    monkeypatch: pytest.MonkeyPatch, left: float, other: bool, looks: int
) -> None:
    search = search_of(LinearProblem({FRICTION: 0.2 * shape(0.0), STRENGTH: shape(1.0)}, {}))
    add(search, EFFECT)
    search.excess_base = replace(search.excess_base, total=1e6, significance=100.0)
    search.excess_left = replace(search.excess_base, total=1e5)
    seen: list[str] = []

    def exchanged(_: Any) -> bool:
        search.excess_left = replace(search.excess_left, total=left * 1e5)
        if other:
            start = replace(search.accepted[0].start, candidate="drag")
            search.accepted = [replace(search.accepted[0], start=start)]
        return True

    names = ("review", "release", "take_better_equivalents", "compare_over_whole_runs")
    for name in names:
        monkeypatch.setattr(stepwise, name, lambda *_: None)
    monkeypatch.setattr(stepwise, "_grow", lambda *_: seen.append("look"))
    monkeypatch.setattr(stepwise, "exchange", exchanged)
    monkeypatch.setattr(stepwise, "joint", lambda *_: False)
    stepwise.run(search, lambda *_: None)
    assert len(seen) == looks
