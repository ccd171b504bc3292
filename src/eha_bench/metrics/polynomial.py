"""Polynomials: the order that samples bear out and no higher, and their real roots."""

from __future__ import annotations

import math

import numpy as np

from eha_bench.core.arrays import FloatArray

HIGHEST_ORDER = 12
_CUBIC = 1e-5  # of the largest coefficient: the one of a cubic
_REAL = 1e-9  # imaginary part of a root that is real
_POLISHED = 1e-3  # of a root, what Newton's method may move it by: at a double one it knows nothing
_PENALTY = 4.0  # times log(samples) per order: noise that is correlated must not look like a bend


def powers(place: FloatArray, highest: int = HIGHEST_ORDER) -> FloatArray:
    """Return Chebyshev's polynomials up to an order at (n,) places in -1 .. 1, (n, order + 1)."""
    return np.asarray(np.polynomial.chebyshev.chebvander(place, highest), np.float64)


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


def real_roots(coefficients: FloatArray) -> list[float]:
    """Return the real roots of a polynomial by its (n,) coefficients, ascending; n at least 2.

    Of a cubic in closed form (R. W. D. Nickalls, Mathematical Gazette 77, 1993,
    doi:10.2307/3619777), with two steps of Newton's, which is many times as quick as eigenvalues.
    """
    if not np.any(coefficients[1:] != 0.0):
        return []
    largest = float(np.max(np.abs(coefficients)))
    if coefficients.size != 4 or abs(float(coefficients[3])) < _CUBIC * largest:
        roots = np.roots(coefficients[::-1])
        return [float(root) for root in roots[np.abs(roots.imag) < _REAL].real]
    d, c, b, a = (float(part) for part in coefficients)
    middle = -b / (3.0 * a)
    p = (c - b * b / (3.0 * a)) / a
    q = ((a * middle + b) * middle + c) * middle / a + d / a
    apart = (0.5 * q) ** 2 + (p / 3.0) ** 3
    if apart > 0.0:
        larger = -math.copysign(math.cbrt(abs(0.5 * q) + math.sqrt(apart)), q)
        found = [middle + larger - (p / (3.0 * larger) if larger else 0.0)]
    else:
        reach = 2.0 * math.sqrt(max(-p / 3.0, 0.0))
        turn = 3.0 * q / (p * reach) if reach else 0.0
        angle = math.acos(min(max(turn, -1.0), 1.0)) / 3.0
        found = [middle + reach * math.cos(angle - k * 2.0 * math.pi / 3.0) for k in range(3)]
    for _ in range(2):
        for place, x in enumerate(found):
            slope = (3.0 * a * x + 2.0 * b) * x + c
            step = (((a * x + b) * x + c) * x + d) / slope if slope else 0.0
            found[place] = x - step if abs(step) < _POLISHED * max(abs(x), 1.0) else x
    return found
