"""Correction for how many hypotheses are looked at (Holm 1979, Scand. J. Statist. 6, 65-70)."""

from __future__ import annotations

import math
from collections.abc import Sequence


def holm(p_values: Sequence[float]) -> list[float]:
    """Return Holm's adjusted p-values: those below alpha are rejected family-wise at alpha.

    Valid whatever the dependence between the tests. NaN (not tested) stays NaN and does not count.
    """
    tested = [place for place, p in enumerate(p_values) if not math.isnan(p)]
    adjusted = [math.nan] * len(p_values)
    highest = 0.0
    for rank, place in enumerate(sorted(tested, key=lambda at: p_values[at])):
        highest = max(highest, min(1.0, (len(tested) - rank) * p_values[place]))
        adjusted[place] = highest
    return adjusted
