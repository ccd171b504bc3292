"""Where a series turned, as far as something with play remembers it."""

from __future__ import annotations

import numpy as np

from eha_bench.core.arrays import FloatArray, IndexArray

_MOST = 40
"""Turns that are kept at most; each is smaller than the one before."""


def remembered_turns(values: FloatArray) -> IndexArray:
    """Return the places of the turns that larger ones have not wiped out, in their order, (k,).

    A play of any width, and any sum of plays, depends on these alone: first the later of the two
    extremes, then the extreme of the other side since, and so on; the first value is kept as well.

    Args:
        values: (n,), may be empty.

    Source: Mayergoyz, Mathematical Models of Hysteresis, Springer 1991, section 1.3 (wiping-out).
    """
    if not values.size:
        return np.zeros(0, dtype=np.intp)
    last = values.size - 1
    high, low = (last - int(np.argmax(side[::-1])) for side in (values, -values))
    found = [0, min(high, low), max(high, low)]
    is_high = high > low
    while found[-1] < last and len(found) < _MOST:
        rest = values[found[-1] + 1 :]
        extreme = -rest if is_high else rest
        found.append(last - int(np.argmax(extreme[::-1])))
        is_high = not is_high
    return np.unique(found)
