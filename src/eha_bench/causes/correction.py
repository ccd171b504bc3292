"""What a measured metric is off the simulated one, and how far that holds where nothing was seen.

The offset is that of all nights: the newest alone would carry a season into the forecast. And the
law of a cause has another form in a machine than in a model, so a change that the model says is
known to some percent only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from eha_bench.core.arrays import FloatArray

_DISCREPANCY: Final = 1.0 / 3.0
"""Of what the model is off by on the healthy machine: standard deviation of what more it may be."""
_GAIN: Final = 0.08
"""Of a change that a model says: standard deviation of what a machine changes by instead."""
_TO_SIGMA: Final = 1.4826


@dataclass(frozen=True)
class Metered:
    """A measured metric over the nights.

    Attributes:
        values: (nights,) SI, NaN where it was not scored. healthy: how many of them, from the
            first on, are of the healthy machine.
    """

    values: FloatArray
    healthy: int

    @property
    def level(self) -> float:
        """On the healthy machine: the median; NaN where it was never scored."""
        known = self.values[: self.healthy]
        known = known[np.isfinite(known)]
        return float(np.median(known)) if known.size else math.nan


@dataclass(frozen=True)
class Correction:
    """What makes the measured metric of a simulated one.

    Attributes:
        healthy: simulated metric of the healthy machine, SI. offset: measured less simulated, SI.
        spread: of nights about that, standard deviation, SI.
    """

    healthy: float
    offset: float
    spread: float

    def measured(self, simulated: float) -> float:
        """Return the metric as it would be measured, SI."""
        return simulated + self.offset

    def deviation(self, simulated: float) -> float:
        """Return the standard deviation of that, SI.

        A season does not average out, so nights count for no more than one of them.
        """
        changed = simulated - self.healthy
        return math.hypot(self.spread, _DISCREPANCY * self.offset, _GAIN * changed)


def correction_of(metered: Metered, simulated: FloatArray, healthy: float) -> Correction:
    """Return what makes the measured metric of a simulated one.

    Args:
        metered: the metric. simulated: (nights,) metric at the cause's value of every night, SI,
            NaN where a night is blind to it. healthy: of the healthy machine, SI.
    """
    if metered.values.size != simulated.size:
        return Correction(healthy, metered.level - healthy, 0.0)
    off = metered.values - simulated
    off = off[np.isfinite(off)]
    if not off.size:
        return Correction(healthy, metered.level - healthy, 0.0)
    offset = float(np.median(off))
    return Correction(healthy, offset, _TO_SIGMA * float(np.median(np.abs(off - offset))))
