"""The resolution of a sensor, and what it costs.

A level that is read in steps of q is known to q / sqrt(12) at best (JCGM 100, F.2.2.1), however
many samples are averaged, unless noise carries them over the steps: the mean of what is rounded is
off by less and less, with a mean square of

    u^2 = q^2 / (2 pi^2) sum_k exp(-4 pi^2 k^2 sd^2 / q^2) / k^2,

which is q^2 / 12 without noise and nothing from half a step of noise on (B. Widrow, I. Kollar,
Quantization Noise, 2008, doi:10.1017/CBO9780511754661, section 19.2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from eha_bench.core.arrays import FloatArray

_FEWEST = 4  # distinct values below which a resolution is a guess
_SEEN = 4096  # samples that are looked at
_WHOLE = 0.01  # what a difference may be away from a multiple of the resolution
_TERMS = 12
_NOTHING = 1e-12  # of the variance of rounding
_DITHERED = 3  # distinct readings of a level


def resolution_of(values: FloatArray) -> float:
    """Return the step between neighbouring values of (n,) samples; 0 where there is none.

    Steps are only believed where every difference of two values is a multiple of the least one.
    """
    finite = values[np.isfinite(values)]
    if finite.size > _SEEN:  # the middle of every stretch, so that levels and transients are seen
        parts = np.array_split(finite, 32)
        finite = np.concatenate([part[: _SEEN // 32] for part in parts])
    distinct = np.unique(finite)
    if not _FEWEST <= distinct.size <= 0.9 * finite.size:
        return 0.0
    gaps = np.diff(distinct)
    largest = float(max(abs(distinct[0]), abs(distinct[-1])))
    gaps = gaps[gaps > 1e-12 * largest]  # the last bits of the same value
    if gaps.size < _FEWEST - 1:
        return 0.0
    least = float(np.median(gaps[gaps < 1.5 * float(gaps.min())]))
    away = gaps / least
    if float(np.max(np.abs(away - np.round(away)) / np.maximum(away, 1.0))) > _WHOLE:
        return 0.0
    return least


def rounding_sd(resolution: float, sd: float) -> float:
    """Return the standard uncertainty that rounding leaves of a mean, by the noise's own sd."""
    if not resolution > 0.0:
        return 0.0
    orders = np.arange(1, _TERMS + 1)
    ratio = 2.0 * math.pi * sd / resolution
    left = float(np.sum(np.exp(-((orders * ratio) ** 2)) / orders**2))
    whole = float(np.sum(1.0 / orders**2))
    if left < _NOTHING * whole:
        return 0.0
    return resolution / math.sqrt(12.0) * math.sqrt(left / whole)


def dithering(levels: Sequence[FloatArray], resolution: float) -> float:
    """Return the standard deviation of the noise that carries readings over a sensor's steps.

    From what is read at levels: their variance less that of rounding. Two values alone tell
    nothing of it, as a level close to a step is read as either with next to no noise; the quietest
    level counts.
    """
    if not resolution > 0.0:
        return 0.0
    found = []
    for values in levels:
        if np.unique(np.round(values / resolution)).size < _DITHERED:
            return 0.0
        found.append(max(float(np.var(values)) - resolution**2 / 12.0, 0.0))
    return math.sqrt(min(found))
