"""Elastic ends of a stroke: a stiff, damped contact beyond each.

    F = -k (x - x_high) - c v  above the upper end, and the like below; it only pushes back

A hard end is `stroke` of the node itself.

Source: Hunt, Crossley, J. Appl. Mech. 42 (1975) 440, doi:10.1115/1.3423596 (contacts).
"""

from __future__ import annotations

import math

from eha_bench.plants.network.element import MECHANICAL, Anatomy, Effort, ElementKind, Port
from eha_bench.plants.parameter import Parameter

_LOW = Parameter("low", "{position}", -1.0, -math.inf, math.inf, "x_low")
_HIGH = Parameter("high", "{position}", 1.0, -math.inf, math.inf, "x_high")
_STIFFNESS = Parameter("stiffness", "{effort}/{position}", 1e6, 0.0, math.inf, "k")
_DAMPING = Parameter("damping", "{damping}", 0.0, 0.0, math.inf, "c")
_AHEAD = 0.02
"""Time ahead for which a stop is looked for, s: as long as a tick of a slow log."""


def push(
    position: float, speed: float, low: float, high: float, stiffness: float, damping: float
) -> float:
    """Return the force of the stop, N (or N*m)."""
    if position > high:
        return -max(0.0, stiffness * (position - high) + damping * speed)
    if position < low:
        return max(0.0, stiffness * (low - position) - damping * speed)
    return 0.0


def stiffness_near(
    position: float, speed: float, low: float, high: float, stiffness: float
) -> float:
    """Return the stiffness of a stop that is touched now or within the next tick, N/m."""
    reach = _AHEAD * abs(speed)
    return stiffness if position > high - reach or position < low + reach else 0.0


def _anatomy(declared: frozenset[str]) -> Anatomy:
    return Anatomy(
        (_LOW, _HIGH, _STIFFNESS, _DAMPING), (Effort("on", push, stiffness=stiffness_near),)
    )


KIND = ElementKind(
    id="elastic_stop",
    summary="Elastic ends of a stroke.",
    ports=(Port("on", MECHANICAL),),
    parameters=(_LOW, _HIGH, _STIFFNESS, _DAMPING),
    anatomy=_anatomy,
    required=("low", "high", "stiffness"),
)
