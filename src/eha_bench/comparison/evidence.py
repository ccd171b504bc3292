"""How far two samples differ, with an interval and what speaks against 'no difference'.

With enough repeats the tests are permutation tests; with fewer, whose permutations could not reach
the level that many metrics ask for, Student's t (Welch 1947, doi:10.1093/biomet/34.1-2.28). Which
of them depends on the numbers of repeats and metrics alone, never on the values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from eha_bench.comparison import permutation
from eha_bench.comparison.sample import Sample

FloatArray = NDArray[np.float64]

ALPHA = 0.05
"""Family-wise error rate, and the complement of the intervals' confidence."""

WIDER = 2.0
"""What a single run's own interval is multiplied by: it knows nothing of the scatter of runs."""

_NORMAL = 1.959963984540054
_LAST_DIGIT = 1e-9


@dataclass(frozen=True)
class Evidence:
    """What two samples say; candidate minus baseline, SI.

    Attributes:
        difference: of the means.
        low, high: 95 % interval of the difference; NaN where nothing is known of the scatter.
        p_difference: two-sided p-value of 'there is no difference'; NaN if not testable.
        p_same: p-value of 'it differs by the margin or more' (two one-sided tests).
        scatter: standard deviation that one repeat (one pair of them) adds; NaN if unknown.
        method: how, in words.
    """

    difference: float
    low: float
    high: float
    p_difference: float
    p_same: float
    scatter: float
    method: str


def evidence(
    baseline: Sample,
    candidate: Sample,
    margin: float,
    *,
    family: int = 1,
    paired: bool = False,
    counted: bool = False,
) -> Evidence:
    """Compare two samples of at least one value each.

    Args:
        baseline, candidate: the values; of equal length if paired.
        margin: the difference from which on it matters, SI.
        family: how many metrics are looked at.
        paired: whether repeat i of both sides was run next to each other.
        counted: whether the values are counts, which scatter even where they happen to be equal.
    """
    n, m = len(baseline), len(candidate)
    scale = float(np.abs(np.concatenate((baseline.values, candidate.values))).max())
    floor = _LAST_DIGIT * scale
    if counted:
        floor = max(floor, math.sqrt(max(0.0, baseline.mean) / n + max(0.0, candidate.mean) / m))
    if paired and n == m and n > 1:
        return _paired(candidate.values - baseline.values, margin, family, floor)
    if n > 1 and m > 1:
        return _repeated(baseline, candidate, margin, family, floor)
    if n > 1 or m > 1:
        return _one_single(baseline, candidate, margin, floor)
    return _singles(baseline, candidate, margin)


def _paired(differences: FloatArray, margin: float, family: int, floor: float) -> Evidence:
    n = differences.size
    mean, spread = float(differences.mean()), float(differences.std(ddof=1))
    error = max(spread / math.sqrt(n), floor)
    if 2.0 * permutation.smallest_paired_p(n) > ALPHA / family or spread == 0.0:
        return _student(mean, error, n - 1.0, margin, spread, "Student's t of the pairs")
    up, down = (permutation.p_greater_paired(sign * differences) for sign in (1.0, -1.0))
    p_same = max(
        permutation.p_greater_paired(margin + differences),
        permutation.p_greater_paired(margin - differences),
    )
    low, high = _t_interval(mean, error, n - 1.0)
    return Evidence(
        mean, low, high, min(1.0, 2.0 * min(up, down)), p_same, spread, "permutation of the pairs"
    )


def _repeated(
    baseline: Sample, candidate: Sample, margin: float, family: int, floor: float
) -> Evidence:
    n, m = len(baseline), len(candidate)
    parts = baseline.variance / n, candidate.variance / m
    difference, square = candidate.mean - baseline.mean, sum(parts)
    error = max(math.sqrt(square), floor)
    degrees = _welch(parts, (n, m))
    scatter = error / math.sqrt(1.0 / n + 1.0 / m)
    listed = 2.0 * permutation.smallest_p(n, m) <= ALPHA / family
    if not listed or math.sqrt(square) <= floor:
        return _student(difference, error, degrees, margin, scatter, "Welch's t")
    first, second = baseline.values, candidate.values
    up, down = permutation.p_greater(first, second), permutation.p_greater(second, first)
    p_same = max(
        permutation.p_greater(first, second + margin),
        permutation.p_greater(second - margin, first),
    )
    least, most = permutation.null_quantiles(first, second, ALPHA)
    return Evidence(
        difference,
        difference - most * error,
        difference - least * error,
        min(1.0, 2.0 * min(up, down)),
        p_same,
        scatter,
        "permutation",
    )


def _welch(parts: tuple[float, float], sizes: tuple[int, int]) -> float:
    """Return the degrees of freedom of Welch and Satterthwaite."""
    below = sum(part**2 / (size - 1) for part, size in zip(parts, sizes, strict=True))
    return sum(parts) ** 2 / below if below > 0.0 else float(sum(sizes) - 2)


def _one_single(baseline: Sample, candidate: Sample, margin: float, floor: float) -> Evidence:
    """One run on one side: it scatters as the repeats of the other side do."""
    repeated = baseline if len(baseline) > 1 else candidate
    spread = math.sqrt(repeated.variance)
    n = len(repeated)
    error = max(spread * math.sqrt(1.0 + 1.0 / n), floor)
    difference = candidate.mean - baseline.mean
    method = "one run against repeats, Student's t with the repeats' scatter"
    return _student(difference, error, n - 1.0, margin, spread, method)


def _singles(baseline: Sample, candidate: Sample, margin: float) -> Evidence:
    """One run on each side: the scores' own intervals, widened (Newcombe's square-and-add)."""
    difference = candidate.mean - baseline.mean
    below = math.hypot(
        candidate.values[0] - candidate.low[0], baseline.high[0] - baseline.values[0]
    )
    above = math.hypot(
        candidate.high[0] - candidate.values[0], baseline.values[0] - baseline.low[0]
    )
    below, above = WIDER * below, WIDER * above
    method = "one run on each side, their own intervals doubled"
    if not math.isfinite(below + above) or below + above <= 0.0:
        method = "one run on each side, and no interval"
        nothing = math.nan
        return Evidence(difference, nothing, nothing, nothing, nothing, nothing, method)

    def upper(value: float, width: float) -> float:
        """Return the p-value of 'not above 0' of a value whose lower half-width is `width`."""
        return float(stats.norm.sf(_NORMAL * value / width)) if width > 0 else float(value <= 0)

    p_same = max(upper(difference + margin, below), upper(margin - difference, above))
    p_up, p_down = upper(difference, below), upper(-difference, above)
    return Evidence(
        difference,
        difference - below,
        difference + above,
        min(1.0, 2.0 * min(p_up, p_down)),
        p_same,
        (below + above) / 2.0 / _NORMAL / math.sqrt(2.0),
        method,
    )


def _student(
    difference: float, error: float, degrees: float, margin: float, scatter: float, method: str
) -> Evidence:
    if error <= 0.0:  # all values are 0
        return Evidence(difference, difference, difference, 1.0, 0.0, 0.0, method)
    p_difference = 2.0 * float(stats.t.sf(abs(difference) / error, degrees))
    p_same = float(stats.t.sf((margin - abs(difference)) / error, degrees))
    low, high = _t_interval(difference, error, degrees)
    return Evidence(difference, low, high, p_difference, p_same, scatter, method)


def _t_interval(difference: float, error: float, degrees: float) -> tuple[float, float]:
    half = float(stats.t.isf(ALPHA / 2.0, degrees)) * error
    return difference - half, difference + half
