"""How fast a cause goes on, and how many nights are left to a limit.

A straight line over the nights since the cause began to move, by least squares; its level and slope
are drawn from Student's distribution with the scatter about it, and the place of the limit from its
own (`crossing`). What is extrapolated goes on as it did: a wear that speeds up comes earlier.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats

from eha_bench.core.arrays import FloatArray
from eha_bench.trends.wear import LimitCrossing, Number

FEWEST: Final = 4
"""Nights of a course that a line is drawn through."""
_AHEAD: Final = (1, 2, 5, 10, 20, 50, 100)
_MOST: Final = 10_000.0


@dataclass(frozen=True)
class Pace:
    """A line through a cause since it began to move.

    Attributes:
        level: at the newest night, slope: a night; SI. covariance: (2, 2) of both.
        degrees: of freedom.
    """

    level: float
    slope: float
    covariance: FloatArray
    degrees: int

    @property
    def rate(self) -> Number:
        """The slope with its interval."""
        half = float(stats.t.isf(0.025, self.degrees)) * math.sqrt(float(self.covariance[1, 1]))
        return Number(self.slope, self.slope - half, self.slope + half)

    @property
    def goes_on(self) -> bool:
        """Whether the slope is surely not none."""
        rate = self.rate
        return rate.low > 0.0 or rate.high < 0.0


def pace_of(times: FloatArray, values: FloatArray, deviations: FloatArray) -> Pace | None:
    """Return the line through a cause; None through too few nights.

    Args:
        times: (n,) nights. values: (n,) SI. deviations: (n,) of each by its own night, SI.
    """
    if times.size < FEWEST:
        return None
    away = times - times[-1]
    design = np.column_stack([np.ones(away.size), away])
    weights = np.ones(away.size)
    for _ in range(5):  # a wild night counts less (Huber)
        root = np.sqrt(weights)
        sizes = np.linalg.lstsq(design * root[:, None], values * root, rcond=None)[0]
        rest = values - design @ sizes
        spread = 1.4826 * float(np.median(np.abs(rest))) or float(np.std(rest)) or 1e-300
        weights = np.minimum(1.0, 2.0 * spread / np.maximum(np.abs(rest), 1e-300))
    degrees = away.size - 2
    own = float(np.median(deviations))
    variance = max(float(weights @ rest**2) / degrees, (0.5 * own) ** 2)
    covariance = variance * np.linalg.inv(design.T @ (weights[:, None] * design))
    return Pace(float(sizes[0]), float(sizes[1]), covariance, degrees)


@dataclass(frozen=True)
class WearForecast:
    """What lies ahead of a cause that goes on.

    Attributes:
        left: nights to the limit. chances: nights ahead -> probability that it is still kept.
    """

    left: Number
    chances: tuple[tuple[int, float], ...]


def ahead_of(pace: Pace, crossing: LimitCrossing) -> WearForecast:
    """Return how many nights are left until a cause reaches its limit; the same every time."""
    generator = np.random.default_rng(20250101)
    root = np.linalg.cholesky(pace.covariance + 1e-300 * np.eye(2))
    draws = crossing.drawn.size
    wide = np.sqrt(pace.degrees / generator.chisquare(pace.degrees, draws))
    drawn = (generator.standard_normal((draws, 2)) @ root.T) * wide[:, None]
    level, slope = pace.level + drawn[:, 0], pace.slope + drawn[:, 1]
    side = math.copysign(1.0, pace.slope)
    way = side * (crossing.drawn - level)
    left = np.where(side * slope > 0.0, way / np.maximum(side * slope, 1e-300), math.inf)
    left = np.where(way <= 0.0, np.minimum(left, 0.0), left)
    low, high = (float(np.quantile(left, share, method="inverted_cdf")) for share in (0.025, 0.975))
    best = side * (crossing.value - pace.level) / abs(pace.slope)
    chances = tuple((ahead, float(np.mean(left > ahead))) for ahead in _AHEAD)
    ends = (value if value < _MOST else math.inf for value in (low, high))
    return WearForecast(Number(best, *ends), chances)
