"""How many more repeats an undecided metric would need."""

from __future__ import annotations

import math

import numpy as np
from scipy import stats

MOST = 1000
_POWER = 0.8


def more_repeats(
    difference: float,
    margin: float,
    scatter: float,
    have: int,
    *,
    alpha: float,
    paired: bool = False,
) -> int | None:
    """Return how many more repeats on each side decide with a probability of 80 %.

    Supposes that the difference seen is the true one. None where that cannot be told: nothing is
    known of the scatter, the difference is at its margin, or more than `MOST` would be needed.

    Args:
        difference, margin: what was seen and what matters, SI.
        scatter: standard deviation that one repeat (one pair of them) adds, SI.
        have: repeats on the side that has fewer.
        alpha: error rate left for this metric.
    """
    if not math.isfinite(difference + margin + scatter):
        return None
    sizes = np.arange(max(2, have + 1), MOST + have + 1)
    degrees = sizes - 1.0 if paired else 2.0 * (sizes - 1.0)
    error = scatter * np.sqrt((1.0 if paired else 2.0) / sizes)
    gain = stats.norm.ppf(_POWER)
    beyond = abs(difference) >= margin
    level, distance = (
        (alpha / 2.0, abs(difference)) if beyond else (alpha, margin - abs(difference))
    )
    enough = (stats.t.isf(level, degrees) + gain) * error < distance
    return int(sizes[int(np.argmax(enough))]) - have if enough.any() else None
