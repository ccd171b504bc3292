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
_EFFICIENCY: Final = 0.37
"""Of a median of deviations: as many normal values say as much of a spread (Huber 1981, 5.1)."""


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
        spread: of nights about that, standard deviation, SI. degrees: of freedom of that.
    """

    healthy: float
    offset: float
    spread: float
    degrees: float

    def measured_metric(self, simulated: FloatArray) -> FloatArray:
        """Return the metric as it would be measured at best, SI."""
        return simulated + self.offset

    def metric_draws(
        self, simulated: FloatArray, rough: FloatArray, generator: np.random.Generator, draws: int
    ) -> FloatArray:
        """Return metrics as they may be measured along a cause, (draws, places) SI.

        measured = simulated + offset + spread t + offset/3 z_1 + 0.08 (simulated - healthy) z_2
        + rough z_3, with t of Student's distribution: what is not known is the same all along.
        A season does not average out, so nights count for no more than one of them.

        Args:
            simulated: (places,) SI, NaN where it is not scored. rough: (places,) its own standard
                deviation, SI. generator: of random numbers. draws: how many.
        """
        night = self.spread * generator.standard_t(self.degrees, (draws, 1))
        model, gain, jag = generator.standard_normal((3, draws, 1))
        law = _DISCREPANCY * self.offset * model + _GAIN * (simulated - self.healthy) * gain
        found: FloatArray = self.measured_metric(simulated) + night + law + rough * jag
        return found


def correction_of(metered: Metered, simulated: FloatArray, healthy: float) -> Correction:
    """Return what makes the measured metric of a simulated one.

    Args:
        metered: the metric. simulated: (nights,) metric at the cause's value of every night, SI,
            NaN where a night is blind to it. healthy: of the healthy machine, SI.
    """
    if metered.values.size != simulated.size:
        return Correction(healthy, metered.level - healthy, 0.0, 1.0)
    off = metered.values - simulated
    off = off[np.isfinite(off)]
    if not off.size:
        return Correction(healthy, metered.level - healthy, 0.0, 1.0)
    offset = float(np.median(off))
    spread = _TO_SIGMA * float(np.median(np.abs(off - offset)))
    return Correction(healthy, offset, spread, max(1.0, _EFFICIENCY * (off.size - 1)))
