"""The median of a trial's repeats, with an interval that is honest for few of them.

What repeats scatter by is more than the noise within one: a warm motor, another stick. A bootstrap
that draws the same few values again never goes beyond them, and holds the truth less often than it
says (55, 68 and 89 % instead of 95 % of two, three and four normal repeats); so

- six repeats or more: the interval of the sign test, between order statistics (T. Hettmansperger,
  S. Sheather, Statistics and Probability Letters 4, 1986, doi:10.1016/0167-7152(86)90021-0), which
  assumes nothing of the distribution;
- two to five: no interval without an assumption reaches 95 %, not even from the least to the
  largest. A studentised parametric bootstrap takes them as normal: the median's error over the
  standard deviation of as many normal values (for two that is Student's).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
from scipy.special import bdtr, stdtrit

from eha_bench.core.arrays import FloatArray
from eha_bench.core.score import Measure

CONFIDENCE = 0.95
_SIGN_TEST = 6  # repeats from which on the least and the largest hold the median in 95 %
_DRAWN = 200_000


def median(measures: Sequence[Measure]) -> Measure:
    """Return the median of the repeats' values, at least one, with its 95 % interval.

    Repeats that are all the same (a simulator without noise) keep their own interval.
    """
    values = np.array([measure.value for measure in measures])
    middle = float(np.median(values))
    if float(np.ptp(values)) == 0.0:
        own = measures[0]
        return Measure(middle, own.low, own.high).censored_like(measures)
    low, high = median_interval(values)
    return Measure(middle, low, high).censored_like(measures)


def median_interval(values: FloatArray) -> tuple[float, float]:
    """Return the 95 % interval of the median behind (n,) independent values, n > 1."""
    if values.size < _SIGN_TEST:
        reach = _studentised_quantile(values.size) * float(np.std(values, ddof=1))
        middle = float(np.median(values))
        return middle - reach, middle + reach
    ordered = np.sort(values)
    return _order_statistic(ordered), -_order_statistic(-ordered[::-1])


@cache
def _studentised_quantile(count: int) -> float:
    """Return the 95 % quantile of |median| / sd over samples of `count` normal values."""
    if count == 2:  # the median is the mean
        return float(stdtrit(1.0, 0.975)) / math.sqrt(2.0)
    rng = np.random.default_rng(count)
    drawn = rng.normal(size=(_DRAWN, count))
    ratio = np.abs(np.median(drawn, axis=1)) / np.std(drawn, axis=1, ddof=1)
    return float(np.quantile(ratio, CONFIDENCE))


def _order_statistic(ordered: FloatArray) -> float:
    """Return the lower end, interpolated between two order statistics to a level of 95 %."""
    count = ordered.size
    levels = 1.0 - 2.0 * bdtr(np.arange(count // 2), count, 0.5)  # from the d-th on, d = 1, 2, ...
    d = int(np.count_nonzero(levels >= CONFIDENCE))
    inner = float(levels[d]) if d < levels.size else 0.0
    share = (float(levels[d - 1]) - CONFIDENCE) / (float(levels[d - 1]) - inner)
    weight = (count - d) * share / (d + (count - 2 * d) * share)
    return float((1.0 - weight) * ordered[d - 1] + weight * ordered[d])
