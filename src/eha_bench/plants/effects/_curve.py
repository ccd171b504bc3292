"""The broken line through evenly spaced knots that a learned effect is made of."""

from __future__ import annotations

import math

from eha_bench.plants.compiled import njit
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


@njit()
def knee_value(
    variable: float, current: float, omega: float, theta: float, p_a: float, p_b: float, x: float,
    v: float, t: float, measured_force: float, oil_temperature: float, demanded_current: float,
    period: float, low: float, high: float, scale: float, values: Vector,
) -> float:  # fmt: skip
    """Return the scaled curve at the variable that it depends on."""
    u = t
    if variable == 1.0:
        u = omega
    elif variable == 2.0:
        u = p_a - p_b
    elif variable == 3.0:
        u = p_a
    elif variable == 4.0:
        u = p_b
    elif variable == 5.0:
        u = p_a + p_b
    elif variable == 6.0:
        u = x
    elif variable == 7.0:
        u = v
    elif variable == 8.0:
        u = current
    elif variable == 9.0:
        u = demanded_current
    elif variable == 10.0:
        u = theta
    elif variable == 11.0:
        u = measured_force
    elif variable == 12.0:
        u = oil_temperature
    return scale * curve(u, period, low, high, values)
