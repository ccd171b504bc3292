"""Noise of a recording, estimated where the response is settled, with its correlation.

Intervals are propagated through the autocovariance, not through a standard deviation alone:
filtered sensors and sampled-down drives have noise that is far from white, and an interval that
ignores it is too short by the root of its correlation time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

FloatArray = NDArray[np.float64]

_FEWEST = 8


@dataclass(frozen=True)
class Noise:
    """Stationary noise.

    Attributes:
        autocovariance: (m,) at lags 0..m-1 samples, in the unit of the data squared.
        freedom: degrees of freedom of the estimate (0: unknown, intervals are NaN).
    """

    autocovariance: FloatArray
    freedom: float

    @property
    def sd(self) -> float:
        """Standard deviation of one sample."""
        return math.sqrt(float(self.autocovariance[0]))

    @property
    def known(self) -> bool:
        """Whether there were enough settled samples to estimate it."""
        return self.freedom > 0

    def variance(self, weights: FloatArray) -> float:
        """Return the variance of sum(weights * data) over consecutive samples."""
        lags = min(self.autocovariance.size, weights.size)
        total = float(weights @ weights) * float(self.autocovariance[0])
        for lag in range(1, lags):
            pair = float(weights[lag:] @ weights[:-lag])
            total += 2.0 * pair * float(self.autocovariance[lag])
        # the tapered estimate is not positive definite for every weight vector
        white = float(weights @ weights) * float(self.autocovariance[0])
        return max(total, 1e-3 * white)

    def variance_of_mean(self, count: int) -> float:
        """Return the variance of the mean of `count` consecutive samples."""
        lags = np.arange(1, min(self.autocovariance.size, count))
        pairs = 2.0 * float(np.sum((count - lags) * self.autocovariance[1 : lags.size + 1]))
        white = count * float(self.autocovariance[0])
        return max(white + pairs, 1e-3 * white) / (count * count)

    def quantile(self) -> float:
        """Return Student's two-sided 95 % quantile for the degrees of freedom (NaN if unknown)."""
        return float(stdtrit(self.freedom, 0.975)) if self.known else math.nan


UNKNOWN = Noise(np.zeros(1), 0.0)


def detrended(segment: FloatArray) -> FloatArray:
    """Return the residual of a straight line fitted to (n,) samples."""
    position = np.linspace(-1.0, 1.0, segment.size)
    centred = segment - segment.mean()
    slope = float(position @ centred) / float(position @ position)
    result: FloatArray = centred - slope * position
    return result


def estimate(segments: Sequence[FloatArray]) -> Noise:
    """Return the noise of settled stretches, each freed of its straight line.

    The autocovariance is cut where it has sunk into its own sampling error and tapered with the
    flat-top window (Politis, Adaptive bandwidth choice, J. Nonparametric Statistics 15, 2003,
    doi:10.1080/10485250310001604659).
    """
    usable = [segment for segment in segments if segment.size >= _FEWEST]
    if not usable:
        return UNKNOWN
    residuals = [detrended(segment) for segment in usable]
    count = sum(residual.size for residual in residuals)
    freedom = count - 2 * len(residuals)
    variance = sum(float(residual @ residual) for residual in residuals) / freedom
    if not variance > 0.0:
        return Noise(np.zeros(1), float(freedom))
    covariance = _sample_autocovariance(residuals)
    covariance *= variance / covariance[0]
    correlation = covariance / variance
    reach = _significant_lags(correlation, count)
    if reach == 0:
        return Noise(np.array([variance]), float(freedom))
    width = min(2 * reach, covariance.size - 1)
    lags = np.arange(width + 1)
    taper = np.clip(2.0 * (1.0 - lags / (width + 1.0)), 0.0, 1.0)
    kept = covariance[: width + 1] * taper
    # what correlation costs: as many independent samples as have the same squared spread
    spread = 1.0 + 2.0 * float(np.sum((kept[1:] / variance) ** 2))
    return Noise(kept, max(freedom / spread, 2.0))


def _sample_autocovariance(residuals: Sequence[FloatArray]) -> FloatArray:
    shortest = min(residual.size for residual in residuals)
    lags = max(1, min(shortest // 2, 500))
    total = np.zeros(lags)
    for residual in residuals:
        length = 1 << int(2 * residual.size - 1).bit_length()
        spectrum = np.fft.rfft(residual, length)
        total += np.fft.irfft((spectrum * spectrum.conj()).real, length)[:lags]
    return total / sum(residual.size for residual in residuals)


def _significant_lags(correlation: FloatArray, count: int) -> int:
    """Return the last lag before five in a row that cannot be told from zero."""
    bound = 2.0 * math.sqrt(max(math.log10(count), 1.0) / count)
    run = 0
    for lag in range(1, correlation.size):
        run = run + 1 if abs(float(correlation[lag])) < bound else 0
        if run == 5:
            return lag - 5
    return correlation.size // 2 if correlation.size > 6 else 0
