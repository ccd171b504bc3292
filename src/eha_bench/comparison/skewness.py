"""How much wider a mean's error is where the two sides scatter differently, and skewed.

Where both sides have the same distribution, skewness cancels in the difference. Where one scatters
far more it does not, and few skewed values lie close together far from their mean: Student's t then
is too large, far out by max f(y) (m - y) of the noise over that of a normal one (Hotelling 1961;
2.2 for the log-normal with sigma 0.7), nearer by the skewness over sqrt(n) (Johnson 1978,
doi:10.1080/01621459.1978.10480051). Few values do not show whether they are skewed: how different
the scatters are says by how much the error has to be wider.
"""

from __future__ import annotations

import math

from scipy import stats

from eha_bench.core.arrays import FloatArray

_FURTHEST = 1.25
_BY_NUMBER = 4.0
_UNSEEN = 0.9
SEEN = 0.85
"""How probable it has to be that scatters are apart by so much as is reckoned with."""

_ALIKE, _APART = 2.0, 4.0


def wider_of_pairs(baseline: FloatArray, candidate: FloatArray) -> float:
    """Return what the error of a mean difference of pairs is multiplied by, (n,) each, n > 1."""
    degrees = baseline.size - 1
    # early looks see few pairs: the ratio may be larger than it seems
    unseen = math.sqrt(float(stats.f.ppf(_UNSEEN, degrees, degrees)))
    return _wider(unseen * _ratio(baseline, candidate), baseline.size)


def wider_of_samples(baseline: FloatArray, candidate: FloatArray, shown: float) -> float:
    """Return what the error of a difference of means is multiplied by, (n,), (m,), n, m > 1.

    `shown` is how far apart the scatters are shown to be, at least 1: any ratio is thought of in
    the comparison itself.
    """
    spread, other = (float(side.std(ddof=1)) for side in (baseline, candidate))
    return _wider(shown, baseline.size if spread > other else candidate.size)


def _ratio(first: FloatArray, second: FloatArray) -> float:
    spreads = sorted(float(side.std(ddof=1)) for side in (first, second))
    return spreads[1] / spreads[0] if spreads[0] > 0.0 else math.inf


def _wider(ratio: float, count: int) -> float:
    if ratio <= _ALIKE:
        return 1.0
    share = min(1.0, math.log(ratio / _ALIKE) / math.log(_APART / _ALIKE))
    return 1.0 + share * min(_FURTHEST, _BY_NUMBER / math.sqrt(count))
