"""The order of a polynomial that samples bear out, and no higher."""

from __future__ import annotations

import math

import numpy as np

from eha_bench.core.arrays import FloatArray

HIGHEST_ORDER = 12
_PENALTY = 4.0  # times log(samples) per order: noise that is correlated must not look like a bend


def powers(place: FloatArray) -> FloatArray:
    """Return Chebyshev's polynomials up to `HIGHEST_ORDER` at (n,) places in -1 .. 1, (n, 13)."""
    return np.asarray(np.polynomial.chebyshev.chebvander(place, HIGHEST_ORDER), np.float64)


def order(values: FloatArray, candidates: FloatArray, beside: FloatArray | None = None) -> int:
    """Return how many of the candidates' columns after the first the values bear out, at least 1.

    By a criterion like Schwarz's, with four times its penalty.

    Args:
        values: (n,).
        candidates: (n, m), the lowest order first.
        beside: (n, k) columns that are fitted in any case.
    """
    fixed = np.zeros((values.size, 0)) if beside is None else beside
    basis, _ = np.linalg.qr(np.column_stack([fixed, candidates]))
    energy = float(values @ values)
    rests = energy - np.cumsum((basis.T @ values) ** 2)
    orders = np.arange(1, candidates.shape[1])
    rest = np.maximum(rests[fixed.shape[1] + 1 :], 1e-24 * energy + 1e-300)
    cost = values.size * np.log(rest) + _PENALTY * math.log(values.size) * orders
    return int(orders[int(np.argmin(cost))])
