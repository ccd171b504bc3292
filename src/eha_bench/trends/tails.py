"""How likely a few nights in a row are by chance alone, whatever the noise's distribution is.

Counts that are mostly zero, or skewed noise, make clusters that a normal distribution would call
impossible. Chernoff's bound with the series' own residuals does not suppose one (Chernoff 1952,
doi:10.1214/aoms/1177729330).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_TILTS = np.geomspace(1e-3, 60.0, 80)


def chance(residuals: FloatArray, count: int, mean: float) -> float:
    """Return a bound on the probability that `count` nights have a mean as far out as `mean`.

    Args:
        residuals: (n,) of the series about its line, in units of their scatter.
        count: how many nights.
        mean: of their deviations, same units; its sign says which tail.
    """
    centred = residuals - residuals.mean()
    if mean < 0.0:
        centred, mean = -centred, -mean
    exponents = _TILTS[:, None] * centred[None, :]
    highest = exponents.max(axis=1)
    cumulants = highest + np.log(np.mean(np.exp(exponents - highest[:, None]), axis=1))
    best = float(np.max(_TILTS * mean - cumulants))
    return float(np.exp(-count * max(best, 0.0)))
