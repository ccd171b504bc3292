"""The broken line through evenly spaced knots that a learned effect is made of, and its words."""

from __future__ import annotations

import math
from typing import NamedTuple

from eha_bench.plants.compiled import njit
from eha_bench.plants.effects._types import Vector

KNOTS = 24
"""Knots of a learned curve."""

# places of the words among the effect's choices
TORQUE, FLOW, FORCE, ACTUATION, MEASUREMENT = range(5)
ADDITIVE, GAIN, FRICTION = range(3)
MOTOR, DRIVE, A_TO_B, CHAMBER_A, CHAMBER_B = range(5)
CURRENT, SPEED, PRESSURE_A, PRESSURE_B, POSITION, VELOCITY, PRESSURES = range(5, 12)


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


class Curve(NamedTuple):
    """The effect's own parameters; words are given by their places."""

    equation: float
    form: float
    variable: float
    place: float
    period: float
    low: float
    high: float
    scale: float


@njit()
def scaled(u: float, own: Curve, values: Vector) -> float:
    """Return the curve times its scale at u."""
    return own.scale * curve(u, own.period, own.low, own.high, values)


@njit()
def changed(quantity: float, f: float, form: float) -> float:
    """Return a quantity with the curve's value as a gain, or added."""
    return quantity * (1.0 + f) if form == GAIN else quantity + f
