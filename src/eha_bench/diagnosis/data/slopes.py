"""The rate of a position that was read: its slope over some readings at a time.

Over 2 k + 1 readings at even steps the slope of a line through them is that of a parabola as well.
Of white noise sigma it has sigma / sqrt(sum (t - mean t)^2), which falls with k^1.5, and what it
cuts off the motion grows with k^2: k is the least from which the noise is little of the motion,
within 20 ms either way. Source: Savitzky, Golay, Anal. Chem. 36 (1964) 1627,
doi:10.1021/ac60214a047.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from eha_bench.core.arrays import FloatArray

_FEWEST, _REACH = 2, 0.02
"""Least number of readings on either side, and about how far they reach at most, s."""
_LITTLE = 0.02
"""Noise of a slope, in the motion's standard deviation, that is little."""
_GAP = 1.5
"""Length of some readings, in their usual one, that says that some are missing."""
_SHARED = 8
"""Lines that begin within the length of one."""


class Slope(NamedTuple):
    """The rate of a position.

    Attributes:
        values: (n,) SI, NaN where readings are too far apart.
        noise: standard deviation of its noise, SI.
        of: channel of the position.
    """

    values: FloatArray
    noise: float
    of: str


def in_words(variable: str, position: str) -> str:
    """Return a variable's name with the position whose slope it is, if there is one."""
    return f"{variable} (derivative of {position})" if position else variable


def slope_of(
    time: FloatArray, taken: FloatArray, values: FloatArray, noise: float, of: str
) -> Slope | None:
    """Return the slope of a channel; None where it was hardly read.

    Args:
        time: (n,) s, where it is wanted. taken: (n,) s, when the channel was read.
        values: (n,) SI, NaN where not read. noise: standard deviation of a reading, SI.
        of: name of the channel.
    """
    good = np.isfinite(values)
    t, x = taken[good], values[good]
    if t.size < 2 * _FEWEST + 1:
        return None
    tick = float(np.median(np.diff(t)))
    if not tick > 0.0:
        return None
    most = max(_FEWEST, round(_REACH / tick))
    half = _FEWEST
    while True:
        at, slopes, spread = _lines(t, x, 2 * half + 1)
        own = noise / spread
        if own <= _LITTLE * float(np.std(slopes)) or half >= most or 4 * half + 1 > t.size:
            break
        half = min(2 * half, most)
    found = np.interp(time, at, slopes)
    nearest = np.abs(at[np.clip(np.searchsorted(at, time), 0, at.size - 1)] - time)
    before = np.abs(at[np.clip(np.searchsorted(at, time) - 1, 0, at.size - 1)] - time)
    length = (2 * half + 1) * tick
    return Slope(np.where(np.minimum(nearest, before) < length, found, np.nan), own, of)


def _lines(t: FloatArray, x: FloatArray, count: int) -> tuple[FloatArray, FloatArray, float]:
    """Return means of time and slopes of lines through so many readings, and their usual spread.

    The spread is the root of the sum of (t - mean t)^2.
    """
    # lines that share nearly all readings tell the same
    every = max(1, count // _SHARED)
    times = sliding_window_view(t, count)[::every]
    values = sliding_window_view(x, count)[::every]
    length = times[:, -1] - times[:, 0]
    whole = length < _GAP * float(np.median(length))
    times, values = times[whole], values[whole]
    at = times.mean(axis=1)
    apart = times - at[:, None]
    squares = np.sum(apart**2, axis=1)
    slopes = np.sum(apart * values, axis=1) / squares
    return at, slopes, float(np.sqrt(np.median(squares)))
