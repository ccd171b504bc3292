"""The broken line through evenly spaced knots that a learned effect is made of."""

from __future__ import annotations

import math

from numba import njit

from eha_bench.plants.effects._types import Vector

KNOTS = 24
"""Knots of a learned curve."""


@njit()
def curve(u: float, period: float, low: float, high: float, values: Vector) -> float:
    """Return the curve at u: evenly spaced knots, once round a period where there is one."""
    n = values.size
    if math.isnan(u):
        return 0.0
    if period > 0.0:
        at = (u / period - math.floor(u / period)) * n
        left = int(at) % n
        right = (left + 1) % n
        share = at - math.floor(at)
    else:
        at = min(1.0, max(0.0, (u - low) / (high - low))) * (n - 1) if high > low else 0.0
        left = min(int(at), n - 2)
        right = left + 1
        share = at - left
    return float(values[left] + share * (values[right] - values[left]))
