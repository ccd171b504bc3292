"""Which columns lie in one piece of memory, so that one of them is not written over another."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from eha_bench.recordings.track import Column


class SharedMemory:
    """Columns whose memory overlaps, in groups; made once, as comparing all pairs is quadratic."""

    def __init__(self, columns: Mapping[str, Column]) -> None:
        """Find the groups of columns, by name."""
        bounds = sorted(
            (*np.lib.array_utils.byte_bounds(column), name) for name, column in columns.items()
        )
        self._group: dict[str, int] = {}
        group, reach = -1, -1
        for low, high, name in bounds:
            if low >= reach:
                group += 1
            reach = max(reach, high)
            self._group[name] = group
        self._left = Counter(self._group.values())

    def leave(self, name: str) -> bool:
        """Take a column out of its group; return whether others are left in it."""
        group = self._group[name]
        self._left[group] -= 1
        return self._left[group] > 0
