"""Where to try gains next, by what was tried: radial basis functions through every margin.

The stochastic radial basis function method of Regis and Shoemaker, INFORMS J. Computing 19 (2007)
497, doi:10.1287/ijoc.1060.0182, with a function for each limit in place of one of the worth: what
is left of a limit is smoother than the least of all. Places are judged by what they are predicted
to reach and by how far they lie from all that was tried, with weights in turn, so that the search
neither stays in the first basin that it finds nor leaves the best one unfinished.
"""

from __future__ import annotations

import numpy as np

from eha_bench.core.arrays import FloatArray

_WEIGHTS = (0.4, 0.7, 0.95, 1.0)
"""Of the prediction, against the distance, in turn."""
_SPREADS = (0.2, 0.05, 0.015, 0.004)
"""Standard deviations of places around the best ones, in shares of the ranges."""
_BEYOND = 0.15
"""How far beyond the ends places are drawn, in shares of the ranges; these then lie at the ends."""
_BEST = 3
_POOL = 400
"""Places that are looked at, all over the ranges and around the best ones each."""
_MOST = 600
"""Places that functions go through, the best of all: the effort is that of their cube."""
_LOW, _HIGH = -1.0, 0.5
"""Margins beyond which more or less says nothing; what is not scored counts as the low one."""
_CLOSE = 1e-3
"""Distance below which a place says nothing new, in shares of the ranges."""


def next_places(
    shares: FloatArray, margins: FloatArray, count: int, generator: np.random.Generator
) -> FloatArray:
    """Return places to try next, (count, gains) of shares.

    Args:
        shares: (n, gains) that were tried, n more than the gains. margins: (n, limits) there, NaN
            where not scored. count: how many. generator: of what is drawn.
    """
    from scipy.interpolate import RBFInterpolator
    from scipy.spatial.distance import cdist

    known = np.clip(np.where(np.isfinite(margins), margins, _LOW), _LOW, _HIGH)
    order = np.argsort(-known.min(axis=1), kind="stable")
    places, first = np.unique(shares[order[:_MOST]], axis=0, return_index=True)
    values = known[order[:_MOST]][first]
    through = RBFInterpolator(places, values, kernel="cubic", degree=1, smoothing=1e-9)
    pool = _pool(shares[order[:_BEST]], shares.shape[1], generator)
    predicted = through(pool).min(axis=1)
    taken = shares
    found: list[FloatArray] = []
    for number in range(count):
        distance = cdist(pool, taken).min(axis=1)
        weight = _WEIGHTS[number % len(_WEIGHTS)]
        worth = weight * _unit(predicted) + (1.0 - weight) * _unit(distance)
        place = pool[int(np.argmax(np.where(distance > _CLOSE, worth, -1.0)))]
        found.append(place)
        taken = np.vstack([taken, place])
    return np.array(found)


def _pool(best: FloatArray, gains: int, generator: np.random.Generator) -> FloatArray:
    """Return places all over the ranges, and around the best ones, some gains of which change."""
    # the best gains often lie at ends of their ranges, which a place drawn between them never does
    stretched = (1.0 + 2.0 * _BEYOND) * generator.random((_POOL, gains)) - _BEYOND
    parts = [np.clip(stretched, 0.0, 1.0)]
    for spread in _SPREADS:
        centre = best[generator.integers(len(best), size=_POOL)]
        moved = spread * generator.standard_normal(centre.shape)
        parts.append(np.clip(centre + moved, 0.0, 1.0))
    return np.concatenate(parts)


def _unit(values: FloatArray) -> FloatArray:
    """Return values from 0 at the lowest to 1 at the highest."""
    span = float(np.ptp(values))
    return (values - values.min()) / span if span > 0.0 else np.ones_like(values)
