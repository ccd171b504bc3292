"""Slow swings, distinguished from drifts: a season that comes back, not a wear that goes on.

A harmonic of a period that was seen to come round is compared with steps and kinks: it takes four
numbers, they take two each, and the better of the two by Schwarz' criterion (1978,
doi:10.1214/aos/1176344136) is what the series is taken for. What is left without it is judged
for changes as any other series.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats

from eha_bench.core.arrays import FloatArray

FEWEST: Final = 40
"""Nights below which no swing is looked for."""

_SHORTEST: Final = 20.0  # nights of a period: what is faster is correlated scatter
_ROUNDS_SEEN: Final = 1.25  # how often the period has to have come round
_PERIODS: Final = 60
_NUMBERS: Final = 4  # level, sine, cosine, period
_CHANCE: Final = 1e-4  # of such a swing in a flat series


@dataclass(frozen=True)
class Swing:
    """A slow swing of a series.

    Attributes:
        period: in nights.
        amplitude: in the unit of the values.
        course: (n,) the swing about its middle.
        misfit: mean square that it leaves, in the square of that unit.
    """

    period: float
    amplitude: float
    course: FloatArray
    misfit: float

    def explains_better(self, misfit: float, numbers: int) -> bool:
        """Return whether it explains the series better than something else that was fitted.

        Args:
            misfit: mean square that the other leaves.
            numbers: parameters that the other has, its level included.
        """
        count = self.course.size
        floor = 1e-12 * self.amplitude**2
        gain = count * math.log(max(misfit, floor) / max(self.misfit, floor))
        return gain > (_NUMBERS - numbers) * math.log(count)


def swing_of(values: FloatArray, widening: float) -> Swing | None:
    """Return the swing of a series, or None where there is none that is significant.

    Args:
        values: (n,) one a night, without wild ones.
        widening: by how much correlation between nights widens the deviation of a mean.
    """
    count = values.size
    if count < FEWEST:
        return None
    night = np.arange(count, dtype=np.float64)
    middle = values - values.mean()
    best: tuple[float, float, FloatArray] | None = None
    for period in np.geomspace(_SHORTEST, count / _ROUNDS_SEEN, _PERIODS):
        turn = 2.0 * math.pi * night / period
        matrix = np.column_stack([np.ones(count), np.sin(turn), np.cos(turn)])
        sizes = np.linalg.lstsq(matrix, middle, rcond=None)[0]
        course = matrix[:, 1:] @ sizes[1:]
        square = float(np.mean((middle - matrix @ sizes) ** 2))
        if best is None or square < best[0]:
            best = square, float(period), course
    assert best is not None
    square, period, course = best
    whole = float(np.mean(middle**2))
    degrees = count - _NUMBERS
    if whole <= 0.0:
        return None
    ratio = (whole - square) / 3.0 / max(square / degrees, 1e-300) / widening**2
    if _PERIODS * float(stats.f.sf(ratio, 3, degrees)) > _CHANCE:
        return None
    return Swing(period, float(np.abs(course).max()), course, square)
