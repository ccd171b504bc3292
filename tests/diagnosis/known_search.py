"""A search over residuals that are linear in the parameters: every fit has a known end."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.baseline import STEP
from eha_bench.diagnosis.fit.candidates import Start, all_starts
from eha_bench.diagnosis.fit.evidence import NOT_COMPARED, compare, excess, groups_of
from eha_bench.diagnosis.fit.least_squares import Fit, levenberg_marquardt
from eha_bench.diagnosis.fit.own_parameters import Places
from eha_bench.diagnosis.fit.problem import Piece
from eha_bench.diagnosis.search.refit import free_of
from eha_bench.diagnosis.search.state import Accepted, Refit, Search
from eha_bench.plants.model import Model

CHANNEL = "piston_velocity"
RUNS = ("first", "second")
TICKS = 600


@cache
def model() -> Model:
    """A drive with Coulomb friction that may hold more than the model says."""
    return Model("linear_drive")


def shape(number: float) -> FloatArray:
    """What a parameter does to the readings of both runs, (n,); other numbers, other waves."""
    time = 1e-3 * np.arange(TICKS)
    return np.tile(np.sin(2.0 * np.pi * (3.0 + 2.0 * number) * time + number), len(RUNS))


class LinearProblem:
    """Residuals that grow linearly with what the parameters are off; rows in s at 1 kHz.

    Args:
        slopes: key -> (n,) change of the readings by a change of the parameter by one.
        truth: key -> value from which on nothing is missing; the model's where it is left out.
        level: standard deviation of the readings' noise. stepping: error of integration at `STEP`.
    """

    def __init__(
        self, slopes: Mapping[str, FloatArray], truth: Mapping[str, float], *,
        level: float = 1.0, stepping: float = 0.0, seed: int = 0,
    ) -> None:  # fmt: skip
        layout = model().plant.layout
        self.plant = SimpleNamespace(layout=layout, outputs=(CHANNEL,), id="linear_drive")
        self.places = Places(layout)
        self.truth = model().vector()
        for key, value in truth.items():
            self.truth[layout.index[key]] = value
        self.matrix = np.zeros((TICKS * len(RUNS), self.truth.size))
        for key, slope in slopes.items():
            self.matrix[:, layout.index[key]] = slope
        self.readings = level * np.random.default_rng(seed).normal(size=len(self.matrix))
        self.drift = stepping * shape(9.0)
        self.noise = {CHANNEL: 1.0}
        self.step, self.soft, self.beliefs = STEP, 5.0, ()
        self.has_moved_starts = False
        self.windows: Any = tuple(self._window(name) for name in RUNS)
        self.pieces = tuple(
            Piece(k, slice(k * TICKS, (k + 1) * TICKS), np.arange(TICKS), np.zeros(TICKS, int))
            for k in range(len(RUNS))
        )

    @staticmethod
    def _window(name: str) -> SimpleNamespace:
        measured = SimpleNamespace(
            inputs={},
            tick=0.0,  # any lag is longer than stamps are off
            run=SimpleNamespace(name=name, locked=True), time=1e-3 * np.arange(TICKS), steps={},
            outputs=(),
            input_noise={}, colours={}, start=SimpleNamespace(is_estimated=False, value=0.0),
        )  # fmt: skip
        return SimpleNamespace(measured=measured, first=0, last=TICKS)

    @property
    def size(self) -> int:
        return len(self.matrix)

    def residual(self, vector: FloatArray) -> FloatArray:
        left = self.matrix @ (vector - self.truth) + self.readings
        left = left + self.drift * (self.step / STEP) ** 2
        return np.asarray(left / self.noise[CHANNEL], dtype=np.float64)

    def at_step(self, step: float) -> LinearProblem:
        other = copy(self)
        other.step = step
        return other

    def halved(self) -> LinearProblem:
        return self.at_step(0.5 * self.step)

    @property
    def longest_step(self) -> float:
        return self.step

    def with_noise(self, noise: Mapping[str, float]) -> LinearProblem:
        other = copy(self)
        other.noise = dict(noise)
        return other

    def coarser(self, step: float, vector: FloatArray, residual: FloatArray) -> LinearProblem:
        return self

    def prepare(self, vector: FloatArray) -> None:
        """Nothing is filtered from these residuals."""

    def scale_to(self, residual: FloatArray) -> None:
        """The loss of these residuals stays as it is."""


def start_of(candidate: str, number: int = 0) -> Start:
    """One of the points from which a candidate's search begins."""
    starts = all_starts(model().plant.layout, model().vector(), [], ())
    return [item for item in starts if item.candidate == candidate][number]


def search_of(problem: Any, *keys: str) -> Search:
    """A search at its beginning: `keys` are calibrated, no effect is added."""
    vector = model().vector()
    none: Any = None
    search = Search(problem, keys, (), none, none, groups_of(problem), vector, none, none)
    search.base = levenberg_marquardt(problem, vector, free_of(search, vector, []))
    search.fit = search.base
    search.excess_base = search.excess_left = excess(problem, search.base)
    return search


def refitted(search: Search, start: Start) -> Refit:
    """A candidate fitted to the end from where the search is."""
    vector = start.apply(search.fit.vector)
    fit = levenberg_marquardt(search.problem, vector, free_of(search, vector, [start]))
    return Refit(start, fit, compare(search.fit, fit, search.groups, search.excess_base.total))


def add(search: Search, *candidates: str) -> None:
    """Look at some candidates, and add the first of them."""
    look = [refitted(search, start_of(name)) for name in candidates]
    search.looks.append(sorted(look, key=lambda item: -item.comparison.gain))
    first = look[0]
    search.accepted.append(Accepted(first.start, first.comparison, ()))
    search.fit = first.fit
    search.excess_left = excess(search.problem, search.fit)


def assumed(name: str) -> Accepted:
    """A parameter that was only assumed, added as the cause."""
    layout = model().plant.layout
    value = float(model().vector()[layout.index[name]])
    start = Start(f"parameter:{name}", (), layout.index[name], value, 1.1 * value, 0.0, np.inf,
                  (name,), "")  # fmt: skip
    return Accepted(start, NOT_COMPARED, ())


def strength(search: Search, fit: Fit, candidate: str) -> float:
    """Strength of an effect in a fit, SI."""
    return float(fit.vector[start_of(candidate).strength_at])
