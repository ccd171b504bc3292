"""How a series scatters from night to night, whatever steps and drifts it has.

From its differences, which a slow drift only shifts, by Huber's proposal 2 (1964,
doi:10.1214/aoms/1177703732), which a few steps hardly move.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import median_filter

from eha_bench.core.arrays import FloatArray
from eha_bench.trends.tails import FURTHEST

_BEND: Final = 1.5  # standard deviations beyond which a difference counts no more
_OF_NORMAL: Final = 0.77846  # mean of min(z^2, 1.5^2) of a normal distribution
_FEWEST_THAT_DIFFER: Final = 0.5
_ROUNDS: Final = 12
_LAST_DIGIT: Final = 1e-9
_WINDOW: Final = 9
_LONG: Final = 30
_VERY_LONG: Final = 80
# a step spoils as many differences as the lag is long: of few nights only short lags are taken
_LAGS: Final = (4, 5, 6, 7)
_SHORT_LAGS: Final = (2, 3)
_MOST_CORRELATED: Final = 0.9
_TRIED: Final = np.linspace(0.0, 0.99, 100)
_UNSEEN: Final = 0.7  # correlation that few nights are supposed to have
_DOUBT: Final = 1.0  # standard errors by which the correlation may be larger than it seems
_DOUBT_OF_FEW: Final = 1.5


@dataclass(frozen=True)
class NightlyNoise:
    """Standard deviation of a night, and by how much correlation widens that of a mean.

    Attributes:
        sigma: in the unit of the values; positive.
        widening: sqrt((1 + r) / (1 - r)) for nights correlated by r; 1 where they are not.
    """

    sigma: float
    widening: float = 1.0


def noise_of(values: FloatArray) -> NightlyNoise:
    """Return the noise of a series of at least two values, shape (n,)."""
    scale = float(np.abs(values).max()) or 1.0
    sigma = max(_night_spread(values, 1), _LAST_DIGIT * scale)
    if values.size < _LONG:  # too few to see it: `newest` looks at steps that are news
        return NightlyNoise(sigma, math.sqrt((1.0 + _UNSEEN) / (1.0 - _UNSEEN)))
    lags = _LAGS if values.size >= _VERY_LONG else _SHORT_LAGS
    spreads = [_night_spread(values, lag) for lag in lags]
    alike = float(np.median([
        _alike(sigma / max(spread, sigma), lag) for lag, spread in zip(lags, spreads, strict=True)
    ]))  # fmt: skip
    doubt = _DOUBT if values.size >= _VERY_LONG else _DOUBT_OF_FEW
    alike = min(alike + doubt / math.sqrt(values.size), _MOST_CORRELATED)
    # thirty nights hardly tell: what is supposed of fewer is given up as nights come in
    alike = max(alike, _UNSEEN * (_LONG / values.size) ** 4)
    sigma = max(sigma, float(np.median(spreads)))
    return NightlyNoise(sigma, math.sqrt((1.0 + alike) / (1.0 - alike)))


def _alike(ratio: float, lag: int) -> float:
    """Return the correlation of neighbours whose differences are smaller than those at a lag.

    Of a first-order autoregression the variances of the differences are to each other as
    1 - r to 1 - r^lag.
    """
    found = np.interp(-(ratio**2), -(1.0 - _TRIED) / (1.0 - _TRIED**lag), _TRIED)
    return float(found)


def _night_spread(values: FloatArray, lag: int) -> float:
    """Return the standard deviation of a night by the differences to the night `lag` before."""
    differences = values[lag:] - values[:-lag]
    squares = (differences - np.median(differences)) ** 2
    square = float(np.mean(squares))
    if np.count_nonzero(squares) > _FEWEST_THAT_DIFFER * squares.size:
        for _ in range(_ROUNDS):
            square *= float(np.mean(np.minimum(squares / square, _BEND**2))) / _OF_NORMAL
    # else most nights are exactly equal (counts, a simulator without noise)
    return math.sqrt(square / 2.0)


def without_outliers(values: FloatArray, sigma: float) -> FloatArray:
    """Return the series with single nights brought to within 2.5 sigma of their neighbours.

    A step stays one: more than half of the nights around each of its own lie on the same side.
    """
    if values.size < _WINDOW:
        return values
    middle = median_filter(values, size=_WINDOW, mode="nearest")
    clipped: FloatArray = np.clip(values, middle - FURTHEST * sigma, middle + FURTHEST * sigma)
    return clipped
