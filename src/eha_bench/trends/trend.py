"""A metric over the nights: its course, its control limits, and what the newest run is in it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Final

import numpy as np
from scipy import stats

from eha_bench.core.arrays import FloatArray
from eha_bench.trends.changes import FEWEST, Change, PiecewiseLine, course_of
from eha_bench.trends.index import Night
from eha_bench.trends.influence import Influence
from eha_bench.trends.newest import newest_of, spread_of
from eha_bench.trends.swing import Swing, swing_of
from eha_bench.trends.tails import reach
from eha_bench.trends.terms import Kind, Term, design

ALPHA: Final = 0.005
"""Of a false change in any metric of a history, and of a false alarm in any metric of a night."""

ALONE_ALPHA: Final = 2e-4
"""Of a false alarm by the newest night alone, in any metric: blunders happen, of any size, and no
scatter of nights before tells of them, so that all but the wildest wait for a second night."""

NEWEST_ALPHA: Final = 0.0045
"""Of a false alarm by the newest nights together, in any metric; see `_newest_alpha`."""

SUSPECT_ALPHA: Final = 0.05
"""Of a step that is suspected and is none, in any metric: a mark, and no alarm."""

LIMITS_ALPHA: Final = 0.005
"""Of a night outside the control limits of one metric, by chance."""

RECENT: Final = 7
"""Nights for which a step is news."""

_MANY: Final = 30
"""Nights that tell how much neighbouring ones are alike."""


class TrendState(StrEnum):
    """What the newest run is in a metric.

    `one night out` is a newest night outside its control limits that the next night has to bear
    out; `step suspected` newest nights away from the level more than chance explains easily, and
    too few for an alarm; `out of limits` one so far out that it needs no second; `cut off by the
    sensor` a newest value that is only known to be at least (at most) what it says, and that shows
    no change.
    """

    LOST = "not scored any more"
    OUT_OF_LIMITS = "out of limits"
    STEPPED = "stepped"
    DRIFTING = "drifting"
    SUSPECTED = "step suspected"
    ONE_NIGHT_OUT = "one night out"
    NOT_SCORED = "not scored"
    CUT_OFF = "cut off by the sensor"
    STEADY = "steady"
    TOO_FEW = "too few nights"

    @property
    def drifted(self) -> bool:
        """Whether the newest run is not what the metric was."""
        return self in (
            TrendState.LOST,
            TrendState.OUT_OF_LIMITS,
            TrendState.STEPPED,
            TrendState.DRIFTING,
        )


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
        judged: what was found of them.
        margin: smallest change that matters.
        missed: nights after the first at which it was not scored, the newest included.
        lost: the first night from which on it was not scored any more; None where it is.
        bounds: acceptance limits of the newest night that had any, SI; infinite without.
        open: (n,) the side on which a sensor's end cut each value off, "" where it is whole; empty
            where all are.
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
    judged: Judged
    margin: float
    missed: int
    lost: Night | None = None
    bounds: tuple[float, float] = (-math.inf, math.inf)
    open: tuple[str, ...] = ()

    @property
    def state(self) -> TrendState:
        """What the newest run is."""
        return self.judged.state

    @property
    def course(self) -> PiecewiseLine:
        """Changes and level."""
        return self.judged.course

    @property
    def limits(self) -> tuple[float, float]:
        """What the newest value has to lie between, SI; NaN with too few nights."""
        return self.judged.limits

    @property
    def since(self) -> Night | None:
        """The first night of what is wrong now; None where nothing is."""
        if self.state is TrendState.LOST:
            return self.lost
        return self.nights[self.judged.since] if self.state.drifted else None

    @property
    def level(self) -> float:
        """Where the metric is now, without its noise."""
        return float(self.course.line[-1]) if self.course.line.size else math.nan

    @property
    def shift(self) -> float:
        """By how much the newest run is away from what was, whatever the state; NaN if unknown."""
        return self.judged.shift

    @property
    def worse(self) -> bool | None:
        """Whether the shift is for the worse; None where no direction is declared."""
        if self.state is TrendState.LOST:
            return True
        now = float(self.values[-1]) if self.values.size else math.nan
        if not math.isnan(self.aim):
            return abs(now - self.aim) > abs(now - self.shift - self.aim)
        return None if self.better == 0 else self.shift * self.better < 0.0


@dataclass(frozen=True)
class Judged:
    """What was found of a series.

    Attributes:
        course: changes and level.
        limits: what the newest value has to lie between; NaN with too few nights.
        state: what the newest run is.
        since: index of the first night of it, where it drifted.
        shift: by how much the newest run is away from what was; NaN if unknown.
        drift: by how much the level moved since the last change (0 where it does not).
        swing: a slow swing that was taken out before anything was looked for; None for none.
        beside: (n,) what influences did, fitted with the changes and taken out; empty for none.
    """

    course: PiecewiseLine
    limits: tuple[float, float]
    state: TrendState
    since: int
    shift: float
    drift: float
    swing: Swing | None = None
    beside: FloatArray = field(default_factory=lambda: np.zeros(0))


def cut_off(judged: Judged, side: str) -> Judged:
    """Return what is still true of a series whose newest value a sensor's end cut off.

    Args:
        judged: by the values as they are. side: `above` where the newest is at least what it says,
            `below` where at most; "" where it is whole.
    """
    steady = judged.state in (TrendState.STEADY, TrendState.SUSPECTED, TrendState.ONE_NIGHT_OUT)
    wrong_way = judged.shift < 0.0 if side == "above" else judged.shift > 0.0
    if not side or not (steady or (judged.state.drifted and (wrong_way or side == "both"))):
        return judged
    return replace(judged, state=TrendState.CUT_OFF)


def judge(
    values: FloatArray,
    *,
    family: int,
    margin: float,
    own: float = math.nan,
    missing: tuple[int, int] = (0, 0),
    influence: Influence | None = None,
) -> Judged:
    """Return what a series did, and what its newest run is.

    Args:
        values: (n,) finite, one a night.
        family: how many metrics are watched.
        margin: smallest change that matters, SI.
        own: standard deviation of a night by its own interval, SI; NaN where unknown.
        missing: newest nights in a row without a value, and nights without one before them.
        influence: what else acts on the nights, fitted with the changes; nothing if None.
    """
    known = influence if influence is not None else Influence.none(values.size)
    course, swing = course_of(values, alpha=ALPHA / family, influence=known), None
    if course.changes:
        swing = _swing(values - known.columns @ course.strengths, course)
    if swing is not None:
        course = course_of(values - swing.course, alpha=ALPHA / family, influence=known)
    beside = known.columns @ course.strengths
    rest = values - beside if swing is None else values - beside - swing.course
    left = known.without(course.strengths)
    judged = replace(_judged_rest(rest, course, family, margin, own, missing, left), beside=beside)
    if swing is None:
        return judged
    newest = float(swing.course[-1])
    return replace(
        judged,
        course=replace(course, line=course.line + swing.course),
        limits=(judged.limits[0] + newest, judged.limits[1] + newest),
        swing=swing,
    )


def _swing(values: FloatArray, course: PiecewiseLine) -> Swing | None:
    """Return a slow swing that explains a series better than its changes do."""
    sigma = course.sigma or 1.0
    clipped = np.clip(values, course.line - 3.0 * sigma, course.line + 3.0 * sigma)
    swing = swing_of(clipped, course.widening)
    numbers = 1 + 2 * len(course.changes)
    misfit = float(np.mean((clipped - course.line) ** 2))
    return swing if swing is not None and swing.explains_better(misfit, numbers) else None


def _judged_rest(
    values: FloatArray,
    course: PiecewiseLine,
    family: int,
    margin: float,
    own: float,
    missing: tuple[int, int],
    influence: Influence,
) -> Judged:
    count = values.size
    last = course.changes[-1].start if course.changes else 0
    drift = float(course.line[-1] - course.line[last]) if course.slope else 0.0
    nothing = math.nan
    found = Judged(course, (nothing, nothing), TrendState.STEADY, count - 1, nothing, drift)
    if missing[0]:
        return replace(found, state=_lost_state(count, *missing))
    if count < FEWEST:
        return replace(found, state=TrendState.TOO_FEW)
    expected, leverage, residuals = _expectation(values, course, influence)
    start = _stretch(course, count)
    known = residuals[start:-1]
    half = _half_width(known, own, leverage)
    away = float(values[-1]) - expected
    found = replace(found, limits=(expected - half, expected + half), shift=away)
    below, above = (
        math.sqrt(1.0 + leverage) * distance
        for distance in reach(residuals[:-1], ALONE_ALPHA / family / 2.0)
    )
    out = abs(away) > half and abs(away) >= margin
    if out and not -below <= away <= above:
        return replace(found, state=TrendState.OUT_OF_LIMITS)
    if _has_stepped(course, count, margin):
        change = course.changes[-1]
        return replace(found, state=TrendState.STEPPED, since=change.start, shift=change.size)
    if abs(drift) >= margin and drift:
        return replace(found, state=TrendState.DRIFTING, since=last, shift=drift)
    newest = newest_of(_from_before(values, course, start), own, influence.since(start))
    if newest.p_value <= SUSPECT_ALPHA / family and abs(newest.shift) >= margin:
        sure = newest.p_value <= _newest_alpha(count - start, own) / family
        state = TrendState.STEPPED if sure else TrendState.SUSPECTED
        return replace(found, state=state, since=count - newest.span, shift=newest.shift)
    return replace(found, state=TrendState.ONE_NIGHT_OUT) if out else found


def _newest_alpha(count: int, own: float) -> float:
    """Return the error rate of the newest nights together that an alarm is held to.

    That chance is averaged over how much neighbouring nights may be alike. Where they are alike by
    0.8, and their scatter has to come from themselves, few nights look like a step more often than
    on average: of eight nights five times as often as the level says, of thirty hardly more often
    (`benchmarks.nights`). A level in proportion to the square of the nights keeps the worst of few
    about where it is of many.
    """
    few = count < _MANY and not math.isfinite(own)
    return NEWEST_ALPHA * (count / _MANY) ** 2 if few else NEWEST_ALPHA


def _lost_state(known: int, gone: int, before: int) -> TrendState:
    """Return whether the newest nights without a value are more than those before explain."""
    usual = (before + 0.5) / (known + before + 1.0)
    return TrendState.LOST if known >= 2 and usual**gone <= ALPHA else TrendState.NOT_SCORED


def _stretch(course: PiecewiseLine, count: int) -> int:
    """Return the index from which on nights are what the newest has to be like."""
    starts = [change.start for change in course.changes if change.start <= count - FEWEST]
    return starts[-1] if starts else 0


def _expectation(
    values: FloatArray, course: PiecewiseLine, influence: Influence
) -> tuple[float, float, FloatArray]:
    """Return the newest night as expected by those before, its leverage, and all residuals."""
    count = values.size
    terms = _terms(course.changes, count - 2)
    sigma = course.sigma or 1.0
    own = influence.scaled(sigma)
    matrix = own.beside(design(terms, count), course.widening)
    newest = matrix[count - 1]
    before = np.delete(matrix, count - 1, axis=0)
    # what is drawn is the line through clipped values: one wild night does not move the limits
    far = 3.0 * course.sigma
    clipped = np.clip(values, course.line - far, course.line + far)
    known = own.with_beliefs(clipped[:-1] / sigma, course.widening)
    sizes = sigma * np.linalg.lstsq(before, known, rcond=None)[0]
    leverage = float(newest @ np.linalg.pinv(before.T @ before) @ newest)
    return float(newest @ sizes), leverage, values - matrix[:count] @ sizes


def _half_width(residuals: FloatArray, own: float, leverage: float) -> float:
    """Return how far a night lies from its level, but once in 200 nights of one metric."""
    sigma = spread_of(residuals, own)
    quantile = float(stats.t.isf(LIMITS_ALPHA / 2.0, max(2, residuals.size - 1)))
    floor = 1e-9 * float(np.abs(residuals).max())
    return max(quantile * sigma * math.sqrt(1.0 + leverage), floor)


def _from_before(values: FloatArray, course: PiecewiseLine, start: int) -> FloatArray:
    """Return the nights of the last stretch about the line that those but the newest lie on."""
    nights = values[start:]
    if not course.slope:
        return nights - float(np.median(nights[:-2]))
    return nights - course.line[start:]


def _terms(changes: tuple[Change, ...], latest: int) -> list[Term]:
    return [Term(change.start, change.kind) for change in changes if change.start <= latest]


def _has_stepped(course: PiecewiseLine, count: int, margin: float) -> bool:
    if not course.changes:
        return False
    last = course.changes[-1]
    return last.kind is Kind.STEP and last.start >= count - RECENT and abs(last.size) >= margin
