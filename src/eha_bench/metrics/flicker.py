"""Noise whose power goes as 1 / f at low frequency, as that of amplifiers and many sensors.

No autoregression of a few coefficients follows it down, and the lower a frequency the more of it
there is: what a mean over a window has of it comes from below what the window shows. Its spectrum

    S(f) = s (1 + f_c / f)

has two parameters, which the periodogram tells by its likelihood (P. Whittle, Arkiv for Matematik
2, 1953, doi:10.1007/BF02590998); it is taken where it is likelier than the autoregression is, whose
parameters count (H. Akaike, IEEE Trans. AC 19, 1974, doi:10.1109/TAC.1974.1100705), and not the
corner: to overlook it costs more than to suspect it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray

_FEWEST = 24  # lines below which it is not told from other noise
_CORNERS = 24
_PENALTY = 1.0  # per parameter, of the logarithm of the likelihood
_LOWEST = 0.05  # over the length of a window: below, no more is counted
_LOW = 0.1  # cycles a sample, below which power has to rise: a filter's noise is flat there
_LONGEST = 8192  # lags
_FINER = 16  # lines of the model for one of the longest window


@dataclass(frozen=True)
class Flicker:
    """Noise of 1 / f.

    Attributes:
        autocovariance: (m,) at lags 0..m-1 samples.
        freedom: degrees of freedom of its part at low frequency.
    """

    autocovariance: FloatArray
    freedom: float


def flicker(residuals: Sequence[FloatArray], coefficients: FloatArray) -> Flicker | None:
    """Return flicker noise where residuals of straight lines show it rather than another.

    Args:
        residuals: (n,) each.
        coefficients: (p,) of the autoregression that it is compared with.
    """
    parts = [_periodogram(residual) for residual in residuals]
    frequency = np.concatenate([part[0] for part in parts])
    power = np.concatenate([part[1] for part in parts])
    if frequency.size < _FEWEST or not np.all(power > 0.0):
        return None
    turns = np.exp(-2j * math.pi * np.outer(frequency, np.arange(coefficients.size + 1)))
    gains = np.abs(turns @ np.concatenate([[1.0], -coefficients])) ** 2
    other = float(_likelihood(power, 1.0 / gains)) - _PENALTY * coefficients.size
    corners = np.geomspace(float(frequency.min()), 50.0, _CORNERS)
    found = _likelihood(power, 1.0 + corners[:, None] / frequency)
    best = int(np.argmax(found))
    corner = float(corners[best])
    low = frequency < _LOW
    rises = _likelihood(power[low], 1.0 + corner / frequency[low])
    flat = _likelihood(power[low], np.ones(np.count_nonzero(low)))
    if float(found[best]) <= other or float(rises) <= float(flat):
        return None
    level = float(np.mean(power / (1.0 + corner / frequency)))
    longest = max(residual.size for residual in residuals)
    lines = np.arange(_FINER * longest // 2 + 1) / (_FINER * longest)
    spectrum = level * (1.0 + corner / np.maximum(lines, _LOWEST / longest))
    covariance = np.fft.irfft(spectrum)[: min(longest, _LONGEST)]
    seen = float(np.count_nonzero(frequency < corner))
    return Flicker(covariance, max(2.0 * seen, 2.0))


def _periodogram(residual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return frequencies in cycles a sample and powers, what the line took away put back."""
    count = (residual.size - 1) // 2
    orders = np.arange(1, count + 1)
    power = np.abs(np.fft.rfft(residual)[1 : count + 1]) ** 2 / residual.size
    return orders / residual.size, power / (1.0 - 3.0 / (math.pi * orders) ** 2)


def _likelihood(power: FloatArray, shapes: FloatArray) -> FloatArray:
    """Return the logarithms of the likelihoods of a spectrum's shapes (..., n), levels the best."""
    levels = np.log(np.mean(power / shapes, axis=-1))
    return np.asarray(-power.size * levels - np.sum(np.log(shapes), axis=-1))
