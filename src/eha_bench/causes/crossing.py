"""Where a cause takes a metric to its limit first, over what is not known of the metrics.

Every draw has the measured metric of each limit along the cause: the simulated curve, and what a
measured one is off it (`correction`). The first place at which any of them is beyond its limit is
that draw's. So two limits that lie close count together, and a metric that only grazes its limit
and comes back has met it in as many draws as it may.

Simulated metrics need not be smooth along a cause (a delay moves what is sampled by whole samples):
a rough one follows parabolas through neighbouring places, and is known no better than these leave.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from eha_bench.causes.correction import Metered, correction_of
from eha_bench.core.arrays import FloatArray
from eha_bench.core.limit import AcceptanceLimit
from eha_bench.trends.wear import LimitCrossing

DRAWS: Final = 4000
_WINDOW: Final = 6
"""Neighbouring places that a rough metric is smoothed over."""
_ROUGH: Final = 0.1
"""Of the largest change between two neighbouring places: roughness from which on it is smoothed."""
_SURE: Final = 0.99
"""Part of the draws that have met a limit, from which on no further place is looked at."""


@dataclass(frozen=True)
class LimitedMetric:
    """A limit, its metric's column, and the metric as measured."""

    trial: str
    limit: AcceptanceLimit
    key: str
    metered: Metered

    def along(self, curves: Sequence[Mapping[str, float]]) -> FloatArray:
        """Return the simulated metric at every place, (places,) SI, NaN where it is not scored."""
        return np.array([metrics.get(self.key, math.nan) for metrics in curves])

    def inside(self, values: FloatArray) -> FloatArray:
        """Return how far metrics are inside of the limit, SI; negative outside, also unscored."""
        bounds = self.limit.bounds
        return np.where(
            np.isfinite(values), np.minimum(values - bounds.low, bounds.high - values), -math.inf
        )


@dataclass(frozen=True)
class DrawnCrossings:
    """The first place that misses a limit, draw by draw.

    Attributes:
        places: (draws,) SI, infinite where none was met. limits: (draws,) which of the limits.
        side: positive where the cause grows, negative where it falls.
    """

    places: FloatArray
    limits: NDArray[np.intp]
    side: float

    def settled(self, last: float) -> bool:
        """Return whether hardly a draw is left that meets no limit before a place."""
        return bool(np.mean(self.side * self.places <= self.side * last) >= _SURE)

    def crossing(self, items: Sequence[LimitedMetric]) -> LimitCrossing | None:
        """Return them as one crossing, at its median; None where most draws meet no limit."""
        value = self.side * float(np.quantile(self.side * self.places, 0.5, method="inverted_cdf"))
        if not math.isfinite(value):
            return None
        met = self.limits[np.isfinite(self.places)]
        item = items[int(np.bincount(met).argmax())]
        return LimitCrossing(value, self.places, item.trial, item.limit.metric, item.limit.text)


def drawn_crossings(
    items: Sequence[LimitedMetric],
    places: Sequence[float],
    curves: Sequence[Mapping[str, float]],
    values: FloatArray,
) -> DrawnCrossings:
    """Return where each draw of the measured metrics misses a limit first; the same every time.

    Args:
        items: limits. places: (n,) of the cause, SI, from the healthy machine on.
        curves: (n,) simulated metrics there. values: (nights,) of the cause, SI.
    """
    generator = np.random.default_rng(20250102)
    at = np.array(places)
    side = math.copysign(1.0, at[-1] - at[0])
    first, which = np.full(DRAWS, side * math.inf), np.zeros(DRAWS, dtype=np.intp)
    for number, item in enumerate(items):
        along = item.along(curves)
        curve, rough = smoothed_metric(at, along)
        known = np.isfinite(curve)
        order = np.argsort(at[known])
        nights = np.interp(values, at[known][order], curve[known][order])
        correction = correction_of(item.metered, nights, float(along[0]))
        measured = correction.metric_draws(curve, rough, generator, DRAWS)
        met = _first_missed(at, item.inside(measured), generator)
        sooner = side * met < side * first
        first[sooner], which[sooner] = met[sooner], number
    return DrawnCrossings(first, which, side)


def smoothed_metric(places: FloatArray, metric: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a metric along a cause without its roughness, and the standard deviation of that.

    Args:
        places: (n,) of the cause, SI. metric: (n,) SI, NaN where it is not scored.
    """
    curve, rough = metric.copy(), np.zeros(metric.size)
    known = np.flatnonzero(np.isfinite(metric))
    for number, place in enumerate(known):
        start = max(0, min(number - _WINDOW // 2, known.size - _WINDOW))
        near = known[start : start + _WINDOW]
        if near.size <= 3:
            continue
        x, y = places[near], metric[near]
        parabola = Polynomial.fit(x, y, 2)
        rest = y - parabola(x)
        left = math.sqrt(float(rest @ rest) / (near.size - 3))
        if left > _ROUGH * float(np.max(np.abs(np.diff(y)))):
            curve[place], rough[place] = float(parabola(places[place])), left
    return curve, rough


def _first_missed(
    places: FloatArray, inside: FloatArray, generator: np.random.Generator
) -> FloatArray:
    """Return the first place at which each row of (draws, places) is negative; infinite if none.

    Between two places a metric follows a straight line; where it can no longer be scored at the
    second, it may be lost anywhere between them.
    """
    outside = inside < 0.0
    at = np.argmax(outside, axis=1)
    rows = np.arange(at.size)
    far, near = inside[rows, at], inside[rows, np.maximum(at - 1, 0)]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(np.isfinite(far), near / (near - far), generator.random(at.size))
    start = places[np.maximum(at - 1, 0)]
    found = start + np.where(at > 0, share, 0.0) * (places[at] - start)
    return np.where(outside.any(axis=1), found, math.copysign(math.inf, places[-1] - places[0]))
