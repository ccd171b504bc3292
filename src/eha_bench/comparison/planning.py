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

    Supposes that the difference seen is the true one. None where that is unknown: nothing is
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
    if abs(difference) >= margin:  # decided where all of its interval matters
        least = margin + stats.t.isf(alpha / 2.0, degrees) * error
        enough = abs(difference) - least >= stats.norm.ppf(_POWER) * error
    else:  # decided where it is shown to be below the margin and above its opposite
        steps = np.array([[margin - difference], [margin + difference]])
        error = np.maximum(error, np.finfo(float).tiny)
        beyond = stats.norm.cdf(steps / error - stats.t.isf(alpha, degrees))
        enough = beyond.sum(axis=0) - 1.0 >= _POWER
    return int(sizes[int(np.argmax(enough))]) - have if enough.any() else None
