"""Where a series turned, as far as something with play remembers it."""

from __future__ import annotations

import numpy as np

from eha_bench.core.arrays import FloatArray, IndexArray


def remembered_turns(values: FloatArray) -> IndexArray:
    """Return the places of the turns that larger ones have not wiped out, in their order, (k,).

    A play of any width, and any sum of plays, depends on these and on the first value alone: on the
    later of the two extremes, then the extreme of the other side since, and so on.

    Args:
        values: (n,), may be empty.

    Source: Mayergoyz, Mathematical Models of Hysteresis, Springer 1991, section 1.3 (wiping-out).
    """
    if not values.size:
        return np.zeros(0, dtype=np.intp)
    back = values[::-1]
    # seen from the end, a turn is remembered where it goes beyond everything since
    highest = np.concatenate([[True], back[1:] > np.maximum.accumulate(back)[:-1]])
    lowest = np.concatenate([[False], back[1:] < np.minimum.accumulate(back)[:-1]])
    places = np.flatnonzero(highest | lowest)
    # of several on the same side the furthest counts
    last = np.append(highest[places][1:] != highest[places][:-1], True)
    last[0] = True
    return np.unique(np.append(values.size - 1 - places[last], 0))
