"""How noisy a channel is, from its readings alone.

The mean square of third differences (a signal that is smooth over four samples vanishes in them) in
blocks of a hundred samples, of which the median is taken, so that fast events do not count; never
below what the channel's own quantisation makes, sqrt(1/12) of its step.

Source of the difference estimator: Von Neumann, Kent, Bellinson, Hart, The mean square successive
difference, Ann. Math. Stat. 12 (1941) 153, doi:10.1214/aoms/1177731746.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# sum of the squares of (1, -3, 3, -1)
_THIRD = 20.0
_BLOCK = 100
# median over mean of a block's mean square: chi2 with 100 / 2.31 degrees of freedom, the 2.31 from
# the correlation of third differences of white noise (-0.75, 0.3, -0.05)
_MEDIAN = 0.9846


def noise_of(values: FloatArray) -> float:
    """Return the standard deviation of a channel's noise, in its unit (NaN if it has no samples).

    Args:
        values: (n,), NaN where nothing was measured.
    """
    good = np.isfinite(values)
    third = np.diff(values, 3)
    third = third[np.isfinite(third)]
    if third.size < 8:
        return float("nan")
    if third.size < 5 * _BLOCK:
        spread = _usual(third)
    else:
        whole = third[: third.size // _BLOCK * _BLOCK].reshape(-1, _BLOCK)
        middle = float(np.median(np.mean(whole**2, axis=1)))
        spread = float(np.sqrt(middle / _MEDIAN / _THIRD))
    step = quantum_of(values[good])
    return max(spread, step / float(np.sqrt(12.0)))


def noise_of_input(values: FloatArray) -> float:
    """Return the standard deviation of a measured input's noise, in its unit (NaN: no samples).

    An input may jump in every block of a hundred samples, but hardly at every fourth of them.

    Args:
        values: (n,), NaN where nothing was measured.
    """
    third = np.diff(values, 3)
    third = third[np.isfinite(third)]
    if third.size < 8:
        return float("nan")
    step = quantum_of(values[np.isfinite(values)])
    return max(_usual(third), step / float(np.sqrt(12.0)))


def _usual(third: FloatArray) -> float:
    """Return the noise's standard deviation that most third differences speak for."""
    return float(1.4826 * np.median(np.abs(third - np.median(third))) / np.sqrt(_THIRD))


def quantum_of(values: FloatArray) -> float:
    """Return the step in which a channel is quantised (0 where no step shows)."""
    levels = np.unique(values)
    if levels.size < 3 or levels.size > values.size / 2:
        return 0.0
    steps = np.diff(levels)
    least = 1e-12 * max(1e-300, float(np.abs(levels).max()))
    return float(np.median(steps[steps > least]))
