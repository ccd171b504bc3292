"""Gains chosen on few draws are no better than the declared ones unless all draws say so."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from eha_bench.core.errors import Place
from eha_bench.core.result import Status
from eha_bench.posterior.posterior import Draw, Posterior
from eha_bench.sweeps.conditions import ANY
from eha_bench.sweeps.evaluation import PointResult
from eha_bench.sweeps.factor import Gain
from eha_bench.sweeps.probability import Probability
from eha_bench.sweeps.space import Point, Space
from eha_bench.sweeps.span import Range
from eha_bench.tuning import tune as room
from eha_bench.tuning.aim import PassProbability
from eha_bench.tuning.search import GainSearch, TriedGains
from eha_bench.tuning.tune import SearchEffort

DECLARED, FOUND = (1.0, 2.0), (1.5, 2.5)


def tried(point: tuple[float, float]) -> TriedGains:
    return TriedGains((0.5, 0.5), point, 0.9, np.zeros((1, 1)))


def proven(
    monkeypatch: pytest.MonkeyPatch, passing: dict[Point, int], as_declared: TriedGains | None
) -> tuple[TriedGains, Probability, Probability]:
    """Prove one finalist where so many of ten draws pass at each point."""

    def results(points: Sequence[Point], *_: object) -> list[list[PointResult]]:
        rows = []
        for point in points:
            margins = [0.1] * passing[point] + [-0.1] * (10 - passing[point])
            rows.append([PointResult(Status.PASSED if m > 0 else Status.FAILED, (m,))
                         for m in margins])  # fmt: skip
        return rows

    monkeypatch.setattr(room, "limits_of", lambda _: ())
    trying: Any = SimpleNamespace(
        space=SimpleNamespace(case=SimpleNamespace(suite=None)), results=results
    )
    posterior = cast("Posterior", SimpleNamespace(remainder=None, notes=()))
    tuning = room._Tuning(
        trying, posterior, SearchEffort(), PassProbability(), ANY, lambda: False, lambda *_: None
    )
    monkeypatch.setattr(tuning, "_with_beyond", lambda found, *_: found)
    second = cast("GainSearch", SimpleNamespace(whole=[tried(FOUND)]))
    draws = [cast("Draw", SimpleNamespace(number=k, model=None, values={})) for k in range(10)]
    return tuning._proven(second, DECLARED, as_declared, draws, posterior)


@pytest.mark.parametrize(("of_found", "best"), [(6, DECLARED), (7, FOUND), (8, FOUND)])
def test_declared_gains_stand_where_more_of_all_draws_pass(
    monkeypatch: pytest.MonkeyPatch, of_found: int, best: Point
) -> None:
    passing: dict[Point, int] = {FOUND: of_found, DECLARED: 7}
    chosen, after, declared = proven(monkeypatch, passing, tried(DECLARED))
    assert chosen.point == best
    assert (after.suite.kept, declared.suite.kept) == (passing[best], 7)


def test_declared_gains_outside_their_ranges_are_only_shown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    chosen, after, declared = proven(monkeypatch, {FOUND: 2, DECLARED: 7}, None)
    assert chosen.point == FOUND
    assert (after.suite.kept, declared.suite.kept) == (2, 7)


def test_what_was_tried_is_found_by_its_gains() -> None:
    search = cast("GainSearch", SimpleNamespace(tried=[tried(FOUND), tried(DECLARED)]))
    found = room._tried_at(search, (1.0 + 1e-13, 2.0))
    assert found is search.tried[1]
    assert room._tried_at(search, (1.0, 2.1)) is None


def test_declared_gains_outside_their_ranges_are_said() -> None:
    """A bare number is SI: a range of 3 to 12 A/Pa does not hold 6 A/MPa."""
    place = Place(file="vary.yaml")
    gains = (
        Gain("pressure.k_p", Range(3.0, 12.0, 5, False), "A/Pa", place),
        Gain("pressure.k_2", Range(0.5, 4.0, 5, False), "A*s/rad", place),
    )
    space = Space(cast("Any", None), gains)
    (said,) = room._outside_ranges(space, (6.06e-6, 2.2))
    assert said == "the declared pressure.k_p, 6.06e-06 A/Pa, is outside its range"
