"""Stamps beside a regular clock: late by what the log's computer did, or true?

A log is often stamped when a message arrives. Where stamps stay beside a regular clock by a part of
a period, however long the run, something regular drove the sampling; that the readings
themselves were taken regularly shows in them: where a channel moves, a sample that was really taken
late has gone on by its slope times the delay. The third differences of the readings are held
against those of slope times delay: a slope of regression of 0 says regular, of 1 that stamps are
true.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_BESIDE = 0.3
"""Root mean square of what stamps of a regular clock lie beside it at most, in periods."""
_NOTICED = 1e-3
"""And at least, in periods, to be worth it."""
_FEWEST = 50
_TELLING = 20.0
"""Least sum of squares that tells 0 from 1: noise is 0.4 of its unit, so the slope's error 0.1."""


def regular_clock(time: FloatArray, channels: Sequence[FloatArray]) -> FloatArray | None:
    """Return the regular clock by which samples were taken, (n,) s, or None where stamps are true.

    Args:
        time: (n,) stamps, s from the first one. channels: (n,) readings, NaN where there are none.
    """
    if time.size < _FEWEST:
        return None
    steps = np.diff(time)
    usual = float(np.median(steps))
    if usual <= 0.0 or not _NOTICED * usual < float(np.std(steps[steps < 1.5 * usual])):
        return None
    # samples that are missing leave their ticks out
    tick = np.concatenate([[0.0], np.cumsum(np.rint(steps / usual))])
    for _ in range(2):
        slope, first = np.polyfit(tick, time, 1)
        tick = np.rint((time - first) / slope)
        tick -= tick[0]
    if np.diff(tick).min() < 1.0:
        return None
    slope, first = np.polyfit(tick, time, 1)
    late = time - (first + slope * tick)
    if not _NOTICED * slope < float(np.sqrt(np.mean(late**2))) < _BESIDE * slope:
        return None
    return None if _stamps_are_true(late, tick, slope, channels) else tick * slope


def _stamps_are_true(
    late: FloatArray, tick: FloatArray, period: float, channels: Sequence[FloatArray]
) -> bool:
    """Whether readings have gone on by what their stamps are late, or do not tell."""
    product, square = 0.0, 0.0
    whole = tick[3:] - tick[:-3] == 3.0
    for values in channels:
        third = np.diff(values, 3)
        expected = np.diff(late * np.gradient(values, tick * period), 3)
        good = np.isfinite(third) & np.isfinite(expected) & whole
        if not good.any():
            continue
        # jumps of a signal are no noise: what is far off has no say
        far = 4.0 * float(np.median(np.abs(third[good])))
        if far <= 0.0:
            continue
        good &= np.abs(third) < far
        product += float(third[good] @ expected[good]) / far**2
        square += float(expected[good] @ expected[good]) / far**2
    return square < _TELLING or product > 0.5 * square
