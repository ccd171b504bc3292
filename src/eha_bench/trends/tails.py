"""How likely a deviation is by chance alone, by the series' own scatter instead of a normal one.

Heavy-tailed, skewed and counted noise makes clusters and wild nights that a normal distribution
would call impossible. Sums over nights are judged by the saddlepoint approximation with the
series' own residuals (Lugannani and Rice 1980, doi:10.2307/1426607), one night by Student's
distributions of all tail weights, each as much as the nights before speak for it.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy import stats
from scipy.special import gammaln, stdtr

from eha_bench.core.arrays import FloatArray

FURTHEST: Final = 2.5
"""Standard deviations to which a single night counts in a sum."""

_STEPS: Final = 200
_HALVINGS: Final = 40
_MOST: Final = 120
_FREEDOMS: Final = np.array([1.5, 2.0, 3.0, 4.0, 6.0, 10.0, 30.0, 300.0])
# most metrics scatter nearly normally, but none is trusted to
_BELIEFS: Final = np.log([0.02, 0.04, 0.08, 0.10, 0.14, 0.16, 0.20, 0.26])[:, None]
_SCALES: Final = 25
_NARROWEST: Final = 0.25
_TO_SCALE: Final = 1.33  # of the median of distances: 1.48 if normal, 1.17 with the wildest tails


def chance_of_sum(
    weights: FloatArray, total: float, noise: FloatArray, *, inflation: float = 1.0
) -> float:
    """Return how probable it is that the weighted sum of noise reaches `total`, or is beyond it.

    Args:
        weights: (n,) of the nights.
        total: the sum that was seen; its sign says which tail.
        noise: (m,) what a night scatters by, in standard deviations; at most `FURTHEST`.
        inflation: by how much correlation between nights raises the variance of the sum.
    """
    scale = float(np.abs(weights).max())
    sign = math.copysign(1.0, total)
    # one more night on either end: the furthest there can be need not have been seen yet
    values = np.concatenate((_summary(np.sort(sign * noise)), (-FURTHEST, FURTHEST)))
    counts = np.ones(values.size)
    counts[:-2] = noise.size / (values.size - 2)
    values = values - float(counts @ values) / float(counts.sum())
    shares, total = weights / scale, abs(total) / scale
    steepest = 40.0 / FURTHEST
    even = np.linspace(-1.0, 1.0, 2 * _STEPS + 1)
    tilts = steepest * even * np.abs(even) ** 1.5  # dense where sums of many nights need them
    raised = counts * np.exp(tilts[:, None] * values[None, :])
    mass = raised.sum(axis=1)
    first = raised @ values / mass
    cumulant = np.log(mass / counts.sum())
    curvature = np.maximum(raised @ values**2 / mass - first**2, 0.0)

    def mean_at(tilt: float) -> float:
        return float(shares @ np.interp(tilt * shares, tilts, first))

    low, high = 0.0, steepest
    if mean_at(high) <= total:
        low = high
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if mean_at(middle) < total else (low, middle)
    # correlated nights count as fewer
    exponent = low * total - float(np.interp(low * shares, tilts, cumulant).sum())
    rise = low * low * float(shares**2 @ np.interp(low * shares, tilts, curvature))
    return _upper(max(exponent, 0.0) / inflation, math.sqrt(rise / inflation))


def _upper(exponent: float, rise: float) -> float:
    """Return the tail probability of Lugannani and Rice, at most Chernoff's bound."""
    bound, root = math.exp(-exponent), math.sqrt(2.0 * exponent)
    if root < 0.1 or rise <= 0.0:  # next to the mean, or nothing can be further out
        return bound
    found = float(stats.norm.sf(root) + stats.norm.pdf(root) * (1.0 / rise - 1.0 / root))
    return min(bound, max(found, 0.0))


def reach(deviations: FloatArray, chance: float) -> tuple[float, float]:
    """Return how far below and above its level a further night may lie, but for a given chance.

    From the predictive distribution of each side: Student's distributions of all tail weights and
    scales, weighted by how well they explain the nights so far. Few nights do not tell how wild a
    night may be, so that their reach is long.

    Args:
        deviations: (n,) of the nights so far, n >= 1.
        chance: of a night below, and of one above.
    """
    below, above = (
        _reach(np.sort(side[side > 0.0]), chance * deviations.size)
        for side in (-deviations, deviations)
    )
    return below, above


def _reach(side: FloatArray, beyond: float) -> float:
    """Return what a distance exceeds in a share of `beyond` / n of n nights, n of them known."""
    if not side.size:
        return 0.0
    known = _summary(side)
    weight = side.size / known.size
    width = max(_NARROWEST, 4.0 / math.sqrt(side.size))
    middle = _TO_SCALE * float(np.median(side))
    # rounded values have a small median: the scale may be as large as the root mean square
    largest = max(middle, math.sqrt(float(np.mean(known**2))))
    ends = middle * math.exp(-width), largest * math.exp(width)
    scales = np.geomspace(*ends, _SCALES)[:, None]
    freedoms = _FREEDOMS[:, None, None]
    shape = gammaln((_FREEDOMS + 1.0) / 2.0) - gammaln(_FREEDOMS / 2.0) - np.log(_FREEDOMS) / 2.0
    densities = (
        shape[:, None, None]
        - np.log(scales)
        - (freedoms + 1.0) / 2.0 * np.log1p((known / scales) ** 2 / freedoms)
    )
    logarithms = weight * densities.sum(axis=2) + _BELIEFS
    likely = np.exp(logarithms - logarithms.max())
    likely /= likely.sum()
    distances = float(side[-1]) * np.geomspace(0.2, 1e3, 40)
    tails = 2.0 * stdtr(_FREEDOMS[:, None], -distances[:, None, None] / scales[:, 0])
    predicted = np.sum(likely * tails, axis=(1, 2))
    return float(np.exp(np.interp(
        -math.log(beyond / side.size), -np.log(predicted), np.log(distances)
    )))  # fmt: skip


def _summary(values: FloatArray) -> FloatArray:
    """Return at most `_MOST` values that are distributed as many sorted ones are."""
    if values.size <= _MOST:
        return values
    return np.array([part.mean() for part in np.array_split(values, _MOST)])
