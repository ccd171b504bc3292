"""Whether neighbouring repeats are correlated, learned from all metrics of a comparison together.

Warm oil and a slow drift make repeat i + 1 like repeat i: ten repeats then tell less than ten
independent ones. The repeats of a metric are taken as a first-order autoregression about each
side's mean (Zellner and Tiao 1964, doi:10.1080/01621459.1964.10480726); its coefficient has a
prior that starts at even odds for independence and is sharpened by what the other metrics say.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from eha_bench.core.arrays import FloatArray

COEFFICIENTS: Final = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95])
"""Correlations of neighbouring repeats that are thought of, (c,)."""

FEWEST: Final = 10
"""Degrees of freedom (repeats of both sides, less two) below which dependence cannot be seen."""

_INDEPENDENT: Final = 0.5  # prior probability that no metric of the comparison is dependent
_NOT_THIS_ONE: Final = 0.2  # and that one metric is not, where others may be
_STRENGTH: Final = 1.0  # of the prior over coefficients, in metrics
_ROUNDS: Final = 20
_MOST_LEFT_OUT: Final = 60


def _dependent_prior() -> FloatArray:
    weights: FloatArray = COEFFICIENTS**2  # more to strong dependence: missing it does most harm
    weights = (1.0 - _NOT_THIS_ONE) * weights / weights.sum()
    weights[0] = _NOT_THIS_ONE
    return weights


_DEPENDENT: Final = _dependent_prior()
_ALONE: Final = (1.0 - _INDEPENDENT) * _DEPENDENT + _INDEPENDENT * (COEFFICIENTS == 0.0)


def coefficient_priors(
    likelihoods: FloatArray, residuals: Sequence[FloatArray]
) -> tuple[FloatArray, ...]:
    """Return for each metric the prior of its coefficient, from what the other metrics say.

    Args:
        likelihoods: (k, c) of each metric's repeats under each coefficient, in any scale.
        residuals: of each metric, (n,) about the means of the sides; metrics that move together
            count as fewer.

    Returns:
        k arrays (c,) adding up to 1.
    """
    count = len(likelihoods)
    if count == 1:
        return (_ALONE,)
    weight = _effective(residuals) / count
    everyone = range(count)
    if count > _MOST_LEFT_OUT:  # one among many hardly tells itself anything
        return (_prior(likelihoods, weight),) * count
    return tuple(
        _prior(likelihoods[[other for other in everyone if other != own]], weight)
        for own in everyone
    )


def _prior(others: FloatArray, weight: float) -> FloatArray:
    """Return the prior of a coefficient given other metrics, each counting as `weight`."""
    shares = _DEPENDENT.copy()
    for _ in range(_ROUNDS):  # EM for the shares, with a Dirichlet prior
        belongs = others * shares
        belongs /= belongs.sum(axis=1, keepdims=True)
        shares = _STRENGTH * _DEPENDENT + weight * belongs.sum(axis=0)
        shares /= shares.sum()
    for_dependence = weight * float(np.sum(np.log((others @ _DEPENDENT) / others[:, 0])))
    odds = (1.0 - _INDEPENDENT) / _INDEPENDENT * math.exp(min(for_dependence, 500.0))
    dependent = odds / (1.0 + odds)
    prior: FloatArray = dependent * shares + (1.0 - dependent) * (COEFFICIENTS == 0.0)
    return prior


def _effective(residuals: Sequence[FloatArray]) -> float:
    """Return as how many independent metrics these count (participation ratio)."""
    longest = max(residual.size for residual in residuals)
    rows = np.zeros((len(residuals), longest))
    for row, residual in zip(rows, residuals, strict=True):
        scale = float(np.linalg.norm(residual))
        row[: residual.size] = residual / scale if scale > 0.0 else 0.0
    alike = rows @ rows.T
    return float(np.trace(alike) ** 2 / max(np.sum(alike**2), 1e-12)) or 1.0
