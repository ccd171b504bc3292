"""A spring with a damper in parallel, from a fixed point.

    F = -(k (x - x_0) + c v)

It is relaxed at x_0.
"""

from __future__ import annotations

import math

from eha_bench.plants.network.element import MECHANICAL, Anatomy, Effort, ElementKind, Port
from eha_bench.plants.parameter import Parameter

_STIFFNESS = Parameter("stiffness", "{effort}/{position}", 1e3, 0.0, math.inf, "k")
_REST = Parameter("rest", "{position}", 0.0, -math.inf, math.inf, "x_0", "where it is relaxed")
_DAMPING = Parameter("damping", "{damping}", 0.0, 0.0, math.inf, "c")


def pull(position: float, speed: float, stiffness: float, rest: float, damping: float) -> float:
    """Return the force of the spring, N (or N*m)."""
    return -(stiffness * (position - rest) + damping * speed)


def stiffness_of(stiffness: float) -> float:
    """Return the stiffness, N/m (or N*m/rad)."""
    return stiffness


def _anatomy(declared: frozenset[str]) -> Anatomy:
    return Anatomy((_STIFFNESS, _REST, _DAMPING), (Effort("on", pull, stiffness=stiffness_of),))


KIND = ElementKind(
    id="spring",
    summary="A spring with a damper, from a fixed point.",
    ports=(Port("on", MECHANICAL),),
    parameters=(_STIFFNESS, _REST, _DAMPING),
    anatomy=_anatomy,
    required=("stiffness",),
)
