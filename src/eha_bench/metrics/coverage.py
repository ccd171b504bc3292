"""From a budget of uncertainty to a 95 % interval."""

from __future__ import annotations

import math
from bisect import bisect_right

from scipy.special import stdtrit

from eha_bench.core.budget import Budget, Contribution, Evaluation

NORMAL = 1.959963984540054
"""Two-sided 95 % quantile of the normal distribution."""

# Factors of a normal plus a rectangular distribution, by minus their excess kurtosis in tenths.
_FACTORS = (
    1.9600, 1.9490, 1.9344, 1.9174, 1.8984, 1.8774, 1.8543,
    1.8290, 1.8009, 1.7693, 1.7331, 1.6900, 1.6454,
)  # fmt: skip


def coverage_factor(budget: Budget) -> float:
    """Return what the combined standard uncertainty is multiplied by for 95 %; NaN if unknown.

    Student's quantile at the effective degrees of freedom (JCGM 100, G.4), times what rectangular
    contributions make it smaller: they have no tails, and one alone needs 1.65 instead of 1.96
    (JCGM 100, G.6.6). Between the two it goes by the kurtosis, which adds up over contributions
    (R. Willink, Metrologia 42, 2005, doi:10.1088/0026-1394/42/5/001).
    """
    if not budget.known:
        return math.nan
    factor = _by_kurtosis(-10.0 * budget.excess) / NORMAL
    freedom = budget.freedom
    student = float(stdtrit(freedom, 0.975)) if math.isfinite(freedom) else NORMAL
    return factor * student


def _by_kurtosis(tenths: float) -> float:
    place = min(max(tenths, 0.0), 12.0)
    index = min(bisect_right(range(13), place) - 1, 11)
    share = place - index
    return (1.0 - share) * _FACTORS[index] + share * _FACTORS[index + 1]


def reach(budget: Budget) -> float:
    """Return half the width of the 95 % interval that a budget gives; NaN if unknown."""
    return coverage_factor(budget) * budget.standard


def type_a(source: str, variance: float, freedom: float = math.inf) -> Budget:
    """Return the budget of one source that the scatter of the data tells."""
    standard = math.sqrt(variance) if variance >= 0.0 else math.nan
    return Budget((Contribution(source, Evaluation.A, standard, freedom),))


def type_b(source: str, standard: float) -> Budget:
    """Return the budget of one source with a standard uncertainty from elsewhere."""
    return Budget((Contribution(source, Evaluation.B, standard),))


def between(source: str, half_width: float) -> Budget:
    """Return the budget of one source that lies anywhere within two bounds."""
    standard = half_width / math.sqrt(3.0)
    return Budget((Contribution(source, Evaluation.B, standard, rectangular=True),))
