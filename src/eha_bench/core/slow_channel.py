"""Columns that are logged more slowly than their table: empty cells that are no gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray

_REGULAR = 0.9
"""Least share of the steps between readings that are the usual one, of a channel that is slow."""
_FEWEST = 10
"""Fewest readings from which a rule is seen."""


@dataclass(frozen=True)
class Readings:
    """What a column of a table holds.

    Attributes:
        every: rows from one reading to the next: 1 where every row has one, or no rule is seen.
        missing: readings that are not there by that rule, or not finite.
    """

    every: int
    missing: int


def readings_of(values: FloatArray) -> Readings:
    """Return how often a column is read, (n,) with NaN where a row has no reading."""
    read = np.flatnonzero(~np.isnan(values))
    infinite = int(np.count_nonzero(np.isinf(values)))
    steps = np.diff(read)
    usual = int(np.median(steps)) if read.size >= _FEWEST else 1
    if usual == 1 or np.mean(steps == usual) < _REGULAR:
        return Readings(1, values.size - read.size + infinite)
    # a row that was lost shifts the pattern, and is no reading that is missing
    between = int(np.sum(np.maximum(steps // usual - 1, 0)))
    at_ends = int(read[0]) // usual + (values.size - 1 - int(read[-1])) // usual
    return Readings(usual, between + at_ends + infinite)
