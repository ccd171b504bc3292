"""Units of one kind side by side, each normalised to its own first nights.

Rigs and specimens differ when they are new; what tells wear is how each moves from where it began,
and whether the others move as well.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import stats

from eha_bench.core.arrays import FloatArray
from eha_bench.trends.changes import FEWEST
from eha_bench.trends.terms import Kind
from eha_bench.trends.trend import RECENT, Trend

FIRST: Final = FEWEST
"""Nights that say where a unit began."""

JUDGED: Final = 3
"""Units of which one can be called different; of two, either may be."""

_OF_MEDIAN: Final = 1.2533  # its standard deviation over that of a mean
_NORMAL: Final = 1.959963984540054
_NEAR_ZERO: Final = 5.0  # standard deviations from 0 below which a share means nothing
_ODD: Final = 0.02  # chance of calling any unit odd where none is


@dataclass(frozen=True)
class Specimen:
    """One unit: a metric of it as it moved from its own first nights.

    Attributes:
        trend: of the metric on this unit.
        first: median of its first nights, SI.
        moved: (n,) the level of each night less `first`; a share of it where `Kin.relative`.
        change: of the median of the newest nights, since the last step, from `first`, likewise;
            NaN with too few nights.
        low, high: its 95 % interval.
        odd: whether it changed differently from the others, by more than chance and what matters.
    """

    trend: Trend
    first: float
    moved: FloatArray
    change: float
    low: float
    high: float
    odd: bool = False


@dataclass(frozen=True)
class Kin:
    """One metric on several units of a kind: the same suite, trial and channel.

    Attributes:
        suite, trial, metric, channel, unit: what is compared.
        relative: whether changes are shares of where each unit began, and not SI.
        specimens: at least two, by the name of their target.
    """

    suite: str
    trial: str
    metric: str
    channel: str
    unit: str
    relative: bool
    specimens: tuple[Specimen, ...]

    @property
    def judged(self) -> bool:
        """Whether there are units enough to call one different from the others."""
        return sum(math.isfinite(one.change) for one in self.specimens) >= JUDGED


def kin_of(trends: Sequence[Trend]) -> tuple[Kin, ...]:
    """Return every metric that several targets have in one suite, in the order of the trends."""
    grouped: dict[tuple[str, str, str, str, str], list[Trend]] = {}
    for trend in trends:
        key = (trend.suite, trend.trial, trend.metric, trend.channel, trend.unit)
        grouped.setdefault(key, []).append(trend)
    several = {key: found for key, found in grouped.items() if len(found) > 1}
    family = sum(len(found) for found in several.values())
    kin = []
    for key, found in several.items():
        relative = all(_far_from_zero(trend) for trend in found)
        ordered = sorted(found, key=lambda trend: trend.target)
        specimens = [_specimen(trend, relative=relative) for trend in ordered]
        kin.append(Kin(*key, relative, tuple(_marked(specimens, family, relative=relative))))
    return tuple(kin)


def _first(trend: Trend) -> float:
    return float(np.median(trend.values[:FIRST]))


def _far_from_zero(trend: Trend) -> bool:
    sigma = trend.course.sigma
    sigma = sigma if math.isfinite(sigma) else 0.0
    return abs(_first(trend)) > _NEAR_ZERO * sigma and _first(trend) != 0.0


def _specimen(trend: Trend, *, relative: bool) -> Specimen:
    first = _first(trend)
    scale = abs(first) if relative else 1.0
    moved = (trend.course.line - first) / scale
    nothing = math.nan
    if trend.values.size < FIRST + 1:
        return Specimen(trend, first, moved, nothing, nothing, nothing)
    newest = trend.values[max(FIRST, trend.values.size - RECENT, _level_since(trend)) :]
    change = (float(np.median(newest)) - first) / scale
    error = trend.course.sigma * trend.course.widening / scale * _OF_MEDIAN
    half = _NORMAL * error * math.sqrt(1.0 / newest.size + 1.0 / FIRST)
    return Specimen(trend, first, moved, change, change - half, change + half)


def _level_since(trend: Trend) -> int:
    """Return the night from which on the newest level holds: older nights say nothing of it."""
    steps = [change.start for change in trend.course.changes if change.kind is Kind.STEP]
    return max(steps, default=0)


def _marked(specimens: list[Specimen], family: int, *, relative: bool) -> list[Specimen]:
    """Return the units, those marked that changed differently from the others."""
    changed = [one for one in specimens if math.isfinite(one.change)]
    if len(changed) < JUDGED:
        return specimens
    marked = []
    for one in specimens:
        others = [other for other in changed if other is not one]
        changes = np.array([other.change for other in others])
        middle = float(changes.mean())
        # how much units of this kind differ: seen of few, and at least what is known of each
        known = float(np.median([other.high - other.low for other in others])) / 2.0 / _NORMAL
        count = changes.size
        limit = float(stats.t.isf(_ODD / 2.0 / family, count - 1.0))
        half = limit * max(float(changes.std(ddof=1)), known) * math.sqrt(1.0 + 1.0 / count)
        margin = one.trend.margin / (abs(one.first) if relative else 1.0)
        away = abs(one.change - middle)
        odd = math.isfinite(one.change) and away > half and away >= margin
        marked.append(replace(one, odd=odd))
    return marked
