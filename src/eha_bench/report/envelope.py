"""Fewer points that look the same: the smallest and largest sample of every stretch of time."""

from __future__ import annotations

import numpy as np

from eha_bench.core.arrays import FloatArray, IndexArray


def envelope_indices(values: FloatArray, points: int) -> IndexArray:
    """Return the indices that keep a curve's min-max envelope, ascending.

    The samples are parted into `points // 2` stretches of equal count; of each, its smallest and
    its largest finite sample stay, and one that is not finite where a stretch has one, so that
    gaps stay gaps. The first and last sample always stay.

    Args:
        values: (n,) samples.
        points: how many to keep, about; n or fewer are kept as they are.
    """
    count = values.size
    stretches = max(1, points // 2)
    if count <= max(points, 4):
        return np.arange(count, dtype=np.intp)
    borders = np.linspace(0, count, stretches + 1).astype(np.intp)
    starts = borders[:-1]
    finite = np.isfinite(values)
    lowest = _first_match(values, np.where(finite, values, np.inf), starts, np.minimum)
    highest = _first_match(values, np.where(finite, values, -np.inf), starts, np.maximum)
    keep = np.zeros(count, dtype=np.bool_)
    keep[lowest] = keep[highest] = True
    keep[[0, count - 1]] = True
    if not finite.all():
        holes = np.flatnonzero(~finite)
        _, first = np.unique(np.searchsorted(borders, holes, side="right"), return_index=True)
        keep[holes[first]] = True
    return np.flatnonzero(keep)


def _first_match(
    values: FloatArray, filled: FloatArray, starts: IndexArray, extreme: np.ufunc
) -> IndexArray:
    """Index of the first sample of each stretch that equals the stretch's extreme."""
    extremes = extreme.reduceat(filled, starts)
    lengths = np.diff(np.append(starts, values.size))
    hits = np.flatnonzero(filled == np.repeat(extremes, lengths))
    stretch = np.searchsorted(starts, hits, side="right") - 1
    _, first = np.unique(stretch, return_index=True)
    found: IndexArray = hits[first]
    return found
