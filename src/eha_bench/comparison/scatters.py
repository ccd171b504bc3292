"""How differently the two sides scatter, learned from all metrics of a comparison together.

Three repeats a side hardly tell the ratio of two scatters, twenty metrics of them do: a warm rig
scatters more in most of what it does. The logarithms of the metrics' ratios are taken as normal
about a common one; its place and width are averaged out, given what the other metrics say (a
hierarchical model: A. Gelman et al., Bayesian Data Analysis, 3rd ed., 2013, chapter 5). A share of
the prior stays flat, as one metric may be unlike all others. Only of equally many repeats, where a
wrong ratio does least harm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from eha_bench.core.arrays import FloatArray

RATIOS: Final = np.linspace(-math.log(20.0), math.log(20.0), 49)
"""Logarithms of the scatter of the first side over that of the second, (r,)."""

_WIDTHS: Final = (0.15, 0.4, 0.8, 1.6)  # of the normal about the common ratio
_NOT_THIS_ONE: Final = 0.1  # share of the prior that stays flat, whatever the others say


def _common() -> FloatArray:
    """Return priors of a metric's ratio, (p, r), one for each common ratio and width."""
    rows = [
        np.exp(-0.5 * ((RATIOS - middle) / width) ** 2) for width in _WIDTHS for middle in RATIOS
    ]
    priors: FloatArray = np.array([row / row.sum() for row in rows])
    return priors


_COMMON: Final = _common()


def ratio_priors(
    likelihoods: FloatArray, sides: Sequence[tuple[FloatArray, FloatArray]]
) -> tuple[FloatArray, ...]:
    """Return for each metric the prior of its ratio of scatters, from what the others say.

    Args:
        likelihoods: (k, r) of each metric's repeats under each of `RATIOS`, in any scale.
        sides: the values of each metric on the two sides, (n,) and (m,), none of them constant;
            metrics that move together count as fewer.

    Returns:
        k arrays (r,), 1 on average: densities relative to the flat one.
    """
    count = len(likelihoods)
    flat = np.ones(RATIOS.size)
    if count == 1:
        return (flat,)
    scaled = likelihoods / likelihoods.max(axis=1, keepdims=True)
    logs = np.log(np.maximum(scaled @ _COMMON.T, 1e-300))
    weight = _independent(sides) / count
    whole = weight * logs.sum(axis=0)
    priors = []
    for own in logs:
        others = whole - weight * own
        chances = np.exp(others - others.max())
        prior = (chances / chances.sum()) @ _COMMON * RATIOS.size
        priors.append(_NOT_THIS_ONE * flat + (1.0 - _NOT_THIS_ONE) * prior)
    return tuple(priors)


def _independent(sides: Sequence[tuple[FloatArray, FloatArray]]) -> float:
    """Return as how many independent metrics these count, by their squared correlations.

    Independent ones have 1 / degrees of freedom of it by chance, which is taken off.
    """
    count = len(sides)
    longest = max(first.size + second.size for first, second in sides)
    rows = np.zeros((count, longest))
    chances = []
    for row, (first, second) in zip(rows, sides, strict=True):
        row[: first.size] = _normed(first)
        row[first.size : first.size + second.size] = _normed(second)
        chances.append(1.0 / (first.size + second.size - 2.0))
    squares = (rows @ rows.T) ** 2
    found = (float(squares.sum()) - float(np.trace(squares))) / (count * (count - 1))
    chance = float(np.mean(chances))
    alike = min(max((found - chance) / max(1.0 - chance, 1e-9), 0.0), 1.0)
    return count / (1.0 + (count - 1) * alike)


def _normed(values: FloatArray) -> FloatArray:
    """Return the values about their mean; the sum of squares is that of half a metric."""
    residual = values - values.mean()
    return np.asarray(residual / (math.sqrt(2.0) * np.linalg.norm(residual)))
