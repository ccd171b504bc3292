"""The search as a whole: what a second pass over a search with effects leaves as it was."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from known_search import LinearProblem, add, search_of, shape, strength

from eha_bench.diagnosis.fit.evidence import is_unexplained
from eha_bench.diagnosis.search import stepwise
from eha_bench.diagnosis.search.refit import is_bent

FRICTION, EFFECT = "viscous_friction", "coulomb_friction"
STRENGTH = "coulomb_friction.friction_force"


def test_a_second_pass_keeps_the_fit_without_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    """Noise told anew begins a second pass: the share of what was found must not become nothing."""
    slopes = {FRICTION: 0.2 * shape(0.0), STRENGTH: 5.0 * shape(1.0)}
    search = search_of(LinearProblem(slopes, {STRENGTH: 0.13}), FRICTION)
    assert is_unexplained(search.excess_base)
    assert not is_bent(search.excess_base)
    add(search, EFFECT)
    before = search.excess_base.total
    for name in ("_grow", "release"):
        monkeypatch.setattr(stepwise, name, lambda *_: None)
    stepwise.run(search, lambda *_: None)
    assert search.excess_base.total == before
    assert strength(search, search.base, EFFECT) == 0.0
