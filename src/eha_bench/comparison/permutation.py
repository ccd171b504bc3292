"""Permutation tests of a difference of means: exact where all arrangements can be listed.

The statistic is Welch's t, so that unequal scatter does not mislead (Janssen 1997,
doi:10.1016/S0167-7152(97)00043-6). Under exchangeability the error rate is exact whatever the
distribution is.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import combinations

import numpy as np

from eha_bench.core.arrays import FloatArray

MOST_LISTED = 20_000
_DRAWN = 9_999
_TIE = 1e-9  # of the statistic: equal values must count as equal after rounding


def smallest_p(first: int, second: int) -> float:
    """Return the smallest one-sided p-value that samples of these sizes can reach."""
    return 1.0 / min(math.comb(first + second, first), _DRAWN + 1)


def smallest_paired_p(pairs: int) -> float:
    """Return the smallest one-sided p-value that this many pairs can reach."""
    return 0.5**pairs if pairs < 14 else 1.0 / (_DRAWN + 1)


@lru_cache(maxsize=8)  # few sizes occur, and of large ones the rows take much memory
def _arrangements(first: int, second: int) -> FloatArray:
    """Return 0/1 rows that choose the second sample; the first row is the one that was seen."""
    total = first + second
    if math.comb(total, second) <= MOST_LISTED:
        chosen = list(combinations(range(total - 1, -1, -1), second))
        rows = np.zeros((len(chosen), total))
        rows[np.arange(len(chosen))[:, None], np.array(chosen)] = 1.0
        return rows
    rng = np.random.default_rng(1)  # the same data have the same verdict
    order = np.argsort(rng.random((_DRAWN, total)), axis=1)[:, :second]
    rows = np.zeros((_DRAWN + 1, total))
    rows[0, first:] = 1.0
    rows[np.arange(1, _DRAWN + 1)[:, None], order] = 1.0
    return rows


@lru_cache(maxsize=8)  # few sizes occur, and of large ones the rows take much memory
def _signs(pairs: int) -> FloatArray:
    """Return rows of signs; the first row is the one that was seen."""
    if 2**pairs <= MOST_LISTED:
        grid = np.indices((2,) * pairs).reshape(pairs, -1).T
        return 1.0 - 2.0 * grid.astype(np.float64)
    rows = np.random.default_rng(1).choice([-1.0, 1.0], (_DRAWN + 1, pairs))
    rows[0] = 1.0
    return rows


def _statistics(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return Welch's t of every arrangement, that of the data first."""
    pooled = np.concatenate((first, second))
    pooled = pooled - pooled.mean()
    chosen = _arrangements(first.size, second.size)
    n, m = first.size, second.size
    of_second, squares_second = chosen @ pooled, chosen @ pooled**2
    mean_second, mean_first = of_second / m, (pooled.sum() - of_second) / n
    var_second = (squares_second - m * mean_second**2) / (m - 1)
    var_first = (np.sum(pooled**2) - squares_second - n * mean_first**2) / (n - 1)
    error = np.sqrt(np.maximum(var_first, 0.0) / n + np.maximum(var_second, 0.0) / m)
    return _ratio(mean_second - mean_first, error, float(np.abs(pooled).max()))


def _paired_statistics(differences: FloatArray) -> FloatArray:
    signs = _signs(differences.size)
    mean = signs @ differences / differences.size
    spread = np.maximum(np.mean(differences**2) - mean**2, 0.0)
    error = np.sqrt(spread / max(1, differences.size - 1))
    return _ratio(mean, error, float(np.abs(differences).max()))


def _ratio(difference: FloatArray, error: FloatArray, scale: float) -> FloatArray:
    # arrangements without any scatter: as if there were a last digit of it
    floor = 1e-9 * scale or 1.0
    ratio: FloatArray = difference / np.maximum(error, floor)
    return ratio


def p_greater(first: FloatArray, second: FloatArray) -> float:
    """Return the one-sided p-value of 'the second mean is not greater', shapes (n,), (m,)."""
    return _upper(_statistics(first, second))


def p_greater_paired(differences: FloatArray) -> float:
    """Return the one-sided p-value of 'the mean difference is not positive', shape (n,)."""
    return _upper(_paired_statistics(differences))


def _upper(statistics: FloatArray) -> float:
    seen = statistics[0] - _TIE * abs(statistics[0])
    return float(np.mean(statistics >= seen))
