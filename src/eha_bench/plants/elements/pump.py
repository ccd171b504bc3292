"""A pump of fixed displacement: a shaft that turns moves oil from one volume to another.

    q = D w,    T = -D (p_to - p_from)

so that it gives to the oil what it takes from the shaft.

Source: Merritt, Hydraulic Control Systems, Wiley 1967.
"""

from __future__ import annotations

import math

from eha_bench.plants.network.element import (
    HYDRAULIC,
    Anatomy,
    Effort,
    ElementKind,
    Flow,
    NodeKind,
    Port,
)
from eha_bench.plants.parameter import Parameter

_DISPLACEMENT = Parameter("displacement", "m^3/rad", 1e-7, 1e-12, math.inf, "D", drawn=True)


def torque(p_from: float, p_to: float, displacement: float) -> float:
    """Return the torque of the oil on the shaft, N*m."""
    return -(displacement * (p_to - p_from))


def delivery(speed: float, displacement: float) -> float:
    """Return the flow that it moves, m^3/s."""
    return displacement * speed


def _anatomy(declared: frozenset[str]) -> Anatomy:
    return Anatomy(
        (_DISPLACEMENT,), (Effort("on", torque), Flow("from", "to", delivery, hook="delivery"))
    )


KIND = ElementKind(
    id="pump",
    summary="A pump (or motor) of fixed displacement between two volumes.",
    ports=(Port("on", (NodeKind.ROTATION,)), Port("from", HYDRAULIC), Port("to", HYDRAULIC)),
    parameters=(_DISPLACEMENT,),
    anatomy=_anatomy,
    required=("displacement",),
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
)
