"""The weight of all that moves with a rod, against extension.

    F = -m g

`gravity` is its component along the rod's axis: g sin(slope), 0 where the rod lies level.
"""

from __future__ import annotations

from eha_bench.plants.network.element import Anatomy, Effort, ElementKind, NodeKind, Port
from eha_bench.plants.parameter import Parameter

_GRAVITY = Parameter("gravity", "m/s^2", 9.80665, -30.0, 30.0, "g", "upright, on earth")


def pull(inertia: float, gravity: float) -> float:
    """Return the weight of the moving mass along the axis, N."""
    return -(inertia * gravity)


def _anatomy(declared: frozenset[str]) -> Anatomy:
    return Anatomy((_GRAVITY,), (Effort("on", pull),))


KIND = ElementKind(
    id="weight",
    summary="The weight of the parts that move with a rod, along its axis.",
    ports=(Port("on", (NodeKind.TRANSLATION,)),),
    parameters=(_GRAVITY,),
    anatomy=_anatomy,
)
