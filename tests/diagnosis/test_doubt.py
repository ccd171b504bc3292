"""Factors that any healthy machine may have are no doubt, of a number as of a scale."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.thresholds import DEFAULT
from eha_bench.diagnosis.outcome import doubtful_numbers as module
from eha_bench.diagnosis.outcome.doubt import ChannelScale, Doubt, DrawnNumber
from eha_bench.diagnosis.outcome.doubtful_numbers import DoubtfulNumbers, doubtful_numbers
from eha_bench.diagnosis.outcome.followed_doubt import Followed
from eha_bench.diagnosis.search.state import Search

SCALE = ChannelScale("pressure_a")
AREA = DrawnNumber(("rod.area",), (0,), 1e-3, "m^2")


def problem(noise: float, largest: float = 50e5) -> Problem:
    """Return one with two runs of a pressure, one of which reads it only as far as half of that."""
    runs = [
        SimpleNamespace(column=lambda _, ends=ends: np.array([1e5, np.nan, ends]))
        for ends in (-largest, 0.5 * largest)
    ]
    windows = [SimpleNamespace(measured=run) for run in (*runs, *runs)]
    return cast(Problem, SimpleNamespace(noise={"pressure_a": noise}, windows=windows))


@pytest.mark.parametrize(
    ("factor", "noise", "material"),
    [
        (1.0008, 6e3, False),  # 0.04 bar of 50, in a noise of 0.06
        (1.0008, 1e3, False),  # a reading shows it, and no maker promises as much
        (1.04, 6e3, True),
        (1.0 / 1.04, 6e3, True),
        (1.04, 1.9e5, True),  # 2 bar
        (1.04, 2.1e5, False),
    ],
)
def test_a_scale_is_doubted_where_a_reading_and_a_class_of_sensors_could_show_it(
    factor: float, noise: float, material: bool
) -> None:
    assert SCALE.is_material(problem(noise), factor, DEFAULT.declared) is material


@pytest.mark.parametrize(
    ("factor", "material"), [(1.004, False), (0.996, False), (1.006, True), (0.994, True)]
)
def test_a_number_is_doubted_for_more_than_a_drawing_may_be_off(
    factor: float, material: bool
) -> None:
    assert AREA.is_material(problem(1.0), factor, DEFAULT.declared) is material


def doubted(monkeypatch: pytest.MonkeyPatch, factors: dict[Doubt, float]) -> DoubtfulNumbers | None:
    """Return what is doubted where each of some doubts makes all as believed, by some factor."""
    vector, right = np.ones(1), np.zeros(1)
    fit = Fit(vector, (), np.zeros(1), np.zeros((1, 0)), 100.0)

    def contradicted(_: object, at: FloatArray, _far: float = 1.0) -> list[SimpleNamespace]:
        return [] if at is right else [SimpleNamespace(key=key) for key in ("rod.mass", "a.leak")]

    def follow(_: Problem, _fit: Fit, doubt: Doubt) -> Followed:
        return Followed(doubt, factors[doubt], 20.0, right)

    own = vars(problem(6e3))
    ready = SimpleNamespace(**own, prepare=lambda _: None, beliefs=())
    asked = SimpleNamespace(apart=lambda: ready, beliefs=())
    search = SimpleNamespace(problem=asked, fit=fit, thresholds=DEFAULT, keys=())
    monkeypatch.setattr(module, "contradicted", contradicted)
    monkeypatch.setattr(module, "lowest_fit", lambda _, found: found)
    monkeypatch.setattr(module, "cost_of", lambda *_: 100.0)
    monkeypatch.setattr(module, "_promising", lambda *_: list(factors))
    monkeypatch.setattr(module, "followed", follow)
    return doubtful_numbers(cast(Search, search))


def test_a_healthy_sensor_is_not_doubted_for_a_thousandth(monkeypatch: pytest.MonkeyPatch) -> None:
    assert doubted(monkeypatch, {SCALE: 1.0008}) is None


def test_where_a_thousandth_of_one_explains_all_nothing_else_is_doubted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert doubted(monkeypatch, {AREA: 1.2, SCALE: 1.0008}) is None


def test_a_wrong_area_or_scale_is_doubted(monkeypatch: pytest.MonkeyPatch) -> None:
    found = doubted(monkeypatch, {AREA: 1.2, SCALE: 1.05})
    assert found is not None
    assert found.words == (
        "rod.area of 0.0012 m^2, declared as 0.001 and not calibrated",
        "'pressure_a' that reads 0.9524 times what there is",
    )
