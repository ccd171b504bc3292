"""State levels of a step: from windows, and from a histogram (IEEE 181)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.budget import Budget
from eha_bench.metrics.coverage import between, type_a
from eha_bench.metrics.noise import Noise
from eha_bench.metrics.resolution import rounding_sd


@dataclass(frozen=True)
class Level:
    """The mean of a settled window.

    Attributes:
        value: unit of the data.
        variance: of the value, by the noise and its correlation.
        freedom: degrees of freedom of the variance.
        drift: change along the window by a line through its halves' means.
        drift_variance: of the drift.
        samples: in the window.
    """

    value: float
    variance: float
    freedom: float
    drift: float
    drift_variance: float
    samples: int

    @property
    def drifts(self) -> bool:
        """Whether the drift cannot be noise."""
        return abs(self.drift) > 3.0 * math.sqrt(self.drift_variance)

    def budget(self, resolution: float, sd: float) -> Budget:
        """Return what moves the value: noise, the sensor's resolution, a drift along the window.

        `resolution` in the unit of the data, `sd` of the noise that dithers it.
        """
        rounding = math.sqrt(3.0) * rounding_sd(resolution, sd)
        drift = 0.5 * abs(self.drift) if self.drifts else 0.0
        return (
            type_a("noise", self.variance, self.freedom)
            + between("resolution", rounding)
            + between("settling drift", drift)
        )


def level(values: FloatArray, noise: Noise) -> Level:
    """Return the mean of (n,) samples with the variances of mean and drift."""
    half = max(values.size // 2, 1)
    variance, freedom = noise.of_mean(values.size)
    drift = 2.0 * (float(values[-half:].mean()) - float(values[:half].mean()))
    return Level(
        value=float(values.mean()),
        variance=variance,
        freedom=freedom,
        drift=drift,
        drift_variance=8.0 * noise.variance_of_mean(half),
        samples=int(values.size),
    )


def histogram_levels(values: FloatArray, bins: int = 100) -> tuple[float, float]:
    """Return the low and high state level of a two-level waveform, (n,) -> unit of the data.

    The mode of the lower and of the upper half of the amplitude histogram, refined by the mean of
    the samples in the modal bin (IEEE Std 181-2011, 5.2.1: the histogram is split in the middle
    of its range). A constant has both levels equal; an empty input gives NaN.
    """
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return float("nan"), float("nan")
    low, high = float(finite.min()), float(finite.max())
    if not high - low > 1e-12 * max(abs(low), abs(high)):
        return low, high
    scaled = (finite / 2.0 - low / 2.0) / (high / 2.0 - low / 2.0)  # halves: no overflow
    index = np.minimum((scaled * bins).astype(np.intp), bins - 1)
    counts = np.bincount(index, minlength=bins)
    half = bins // 2
    modes = (int(np.argmax(counts[:half])), half + int(np.argmax(counts[half:])))
    levels = []
    for mode in modes:
        inside = scaled[index == mode]
        centre = float(inside.mean()) if inside.size else (mode + 0.5) / bins
        levels.append(low * (1.0 - centre) + high * centre)
    return levels[0], levels[1]
