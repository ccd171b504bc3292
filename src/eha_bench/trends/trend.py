"""A metric over the nights: its course, its control limits, and what the newest run is in it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from eha_bench.trends.changes import FEWEST, Change, Course, course_of
from eha_bench.trends.index import Night
from eha_bench.trends.tails import reach
from eha_bench.trends.terms import Kind, Term, design

FloatArray = NDArray[np.float64]

ALPHA: Final = 0.005
"""Of a false change in any metric of a history, and of a false alarm in any metric of a night."""

RECENT: Final = 7
"""Nights for which a step is news."""


class State(StrEnum):
    """What the newest run is in a metric."""

    OUT_OF_LIMITS = "out of limits"
    STEPPED = "stepped"
    DRIFTING = "drifting"
    NOT_SCORED = "not scored"
    STEADY = "steady"
    TOO_FEW = "too few nights"

    @property
    def drifted(self) -> bool:
        """Whether the newest run is not what the metric was."""
        return self in (State.OUT_OF_LIMITS, State.STEPPED, State.DRIFTING)


@dataclass(frozen=True)
class Trend:
    """One metric of one trial on one target over the nights that scored it; SI.

    Attributes:
        suite, target, trial, metric, channel, unit: what it is of.
        better: which value is better: -1 lower, 1 higher, 0 unknown; about `aim` if that is finite.
        aim: the best value, where it lies in between; NaN otherwise.
        nights: those that scored it, in order.
        values: (n,) one a night.
        course: changes and level.
        limits: what the newest value has to lie between, SI; NaN with too few nights.
        drift: by how much the level moved since the last change (0 where it does not).
        margin: smallest change that matters.
        state: what the newest run is.
        missed: nights after the first at which it was not scored, the newest included.
    """

    suite: str
    target: str
    trial: str
    metric: str
    channel: str
    unit: str
    better: int
    aim: float
    nights: tuple[Night, ...]
    values: FloatArray
    course: Course
    limits: tuple[float, float]
    drift: float
    margin: float
    state: State
    missed: int

    @property
    def level(self) -> float:
        """Where the metric is now, without its noise."""
        return float(self.course.line[-1]) if self.course.line.size else math.nan

    @property
    def shift(self) -> float:
        """By how much the newest run is away from what was, whatever the state."""
        if self.state is State.DRIFTING:
            return self.drift
        if self.state is State.STEPPED:
            return self.course.changes[-1].size
        if self.values.size < FEWEST:
            return math.nan
        return float(self.values[-1] - self.course.line[-2])

    @property
    def worse(self) -> bool | None:
        """Whether the shift is for the worse; None where nobody knows which value is better."""
        now = float(self.values[-1]) if self.values.size else math.nan
        if not math.isnan(self.aim):
            return abs(now - self.aim) > abs(now - self.shift - self.aim)
        return None if self.better == 0 else self.shift * self.better < 0.0


def judge(
    values: FloatArray, *, family: int, margin: float, scored: bool
) -> tuple[Course, tuple[float, float], float, State]:
    """Return course, control limits, drift since the last change and state of the newest run.

    Args:
        values: (n,) finite, one a night.
        family: how many metrics are watched.
        margin: smallest change that matters, SI.
        scored: whether the newest run has a value here.
    """
    course = course_of(values, alpha=ALPHA / family)
    limits = _limits(values, course, ALPHA / family)
    last = course.changes[-1].start if course.changes else 0
    drift = float(course.line[-1] - course.line[last]) if course.slope else 0.0
    if not scored:
        state = State.NOT_SCORED
    elif values.size < FEWEST:
        state = State.TOO_FEW
    elif _is_out(values, course, limits, margin):
        state = State.OUT_OF_LIMITS
    elif _has_stepped(course, values.size, margin):
        state = State.STEPPED
    else:
        state = State.DRIFTING if abs(drift) >= margin and drift else State.STEADY
    return course, limits, drift, state


def _limits(values: FloatArray, course: Course, alpha: float) -> tuple[float, float]:
    """Return the prediction interval of the newest night by all nights before it."""
    count = values.size
    if count < FEWEST:
        return math.nan, math.nan
    terms = _terms(course.changes, count - 2)
    matrix = design(terms, count)
    before, newest = matrix[:-1], matrix[-1]
    # what is drawn is the line through clipped values: one wild night does not move the limits
    far = 3.0 * course.sigma
    known = np.clip(values, course.line - far, course.line + far)[:-1]
    sizes = np.linalg.lstsq(before, known, rcond=None)[0]
    leverage = float(newest @ np.linalg.pinv(before.T @ before) @ newest)
    expected = float(newest @ sizes)
    floor = 1e-9 * max(abs(expected), float(np.abs(values).max()))
    below, above = (
        max(math.sqrt(1.0 + leverage) * distance, floor)
        for distance in reach(values[:-1] - before @ sizes, alpha / 2.0)
    )
    return expected - below, expected + above


def _terms(changes: tuple[Change, ...], latest: int) -> list[Term]:
    return [Term(change.start, change.kind) for change in changes if change.start <= latest]


def _is_out(values: FloatArray, course: Course, limits: tuple[float, float], margin: float) -> bool:
    newest = float(values[-1])
    away = abs(newest - float(course.line[-2]))
    return not limits[0] <= newest <= limits[1] and away >= margin


def _has_stepped(course: Course, count: int, margin: float) -> bool:
    if not course.changes:
        return False
    last = course.changes[-1]
    return last.kind is Kind.STEP and last.start >= count - RECENT and abs(last.size) >= margin
