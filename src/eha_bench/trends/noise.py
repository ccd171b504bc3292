"""How a series scatters from night to night, whatever steps and drifts it has.

From quantiles of its differences, which a few steps do not move and a slow drift only shifts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

FloatArray = NDArray[np.float64]

_QUANTILE: Final = 0.8
_TO_SIGMA: Final = 1.0 / 1.2816  # of a normal distribution's 80 % of magnitudes
_LAST_DIGIT: Final = 1e-9
_WINDOW: Final = 9
_FURTHEST: Final = 2.5
_LONG: Final = 30
_VERY_LONG: Final = 80
# a step spoils as many differences as the lag is long: of few nights only short lags are taken
_LAGS: Final = (4, 5, 6, 7)
_SHORT_LAGS: Final = (2, 3)
_MOST_CORRELATED: Final = 0.9


@dataclass(frozen=True)
class Noise:
    """Standard deviation of a night, and by how much correlation widens that of a mean.

    Attributes:
        sigma: in the unit of the values; positive.
        widening: sqrt((1 + r) / (1 - r)) for nights correlated by r; 1 where they are not.
    """

    sigma: float
    widening: float = 1.0


def noise_of(values: FloatArray) -> Noise:
    """Return the noise of a series of at least two values, shape (n,)."""
    scale = float(np.abs(values).max()) or 1.0
    sigma = max(_spread(values, 1), _LAST_DIGIT * scale)
    if values.size < _LONG:
        return Noise(sigma)
    lags = _LAGS if values.size >= _VERY_LONG else _SHORT_LAGS
    # neighbours that are alike differ by less than nights further apart
    far = float(np.median([_spread(values, lag) for lag in lags]))
    alike = 1.0 - (sigma / far) ** 2 if far > sigma else 0.0
    alike -= 1.0 / math.sqrt(values.size)  # what chance alone makes of it
    if alike <= 0.0:
        return Noise(sigma)
    alike = min(alike, _MOST_CORRELATED)
    return Noise(far, math.sqrt((1.0 + alike) / (1.0 - alike)))


def _spread(values: FloatArray, lag: int) -> float:
    """Return the standard deviation of a night by the differences to the night `lag` before."""
    differences = values[lag:] - values[:-lag]
    centred = np.abs(differences - np.median(differences))
    spread = _TO_SIGMA * float(np.quantile(centred, _QUANTILE)) / math.sqrt(2.0)
    if spread > 0.0:
        return spread
    # most nights are exactly alike (counts, a simulator without noise)
    return math.sqrt(float(np.mean(centred**2)) / 2.0)


def without_outliers(values: FloatArray, sigma: float) -> FloatArray:
    """Return the series with single nights brought to within 2.5 sigma of their neighbours.

    A step stays one: more than half of the nights around each of its own lie on the same side.
    """
    if values.size < _WINDOW:
        return values
    middle = median_filter(values, size=_WINDOW, mode="nearest")
    clipped: FloatArray = np.clip(values, middle - _FURTHEST * sigma, middle + _FURTHEST * sigma)
    return clipped
