"""A force against a rod (or a torque against a shaft): a constant, and what is measured of it.

    F = -(F_e + F_measured)

Positive against positive motion.
"""

from __future__ import annotations

import math

from eha_bench.plants.network.element import (
    MECHANICAL,
    Anatomy,
    Effort,
    ElementKind,
    HeldSignal,
    Input,
    Port,
)
from eha_bench.plants.parameter import Parameter

_FORCE = Parameter("force", "{effort}", 0.0, -math.inf, math.inf, "F_e")


def against(force: float, measured: float) -> float:
    """Return the force of the load in the direction of motion, N (or N*m)."""
    return -(force + measured)


def _anatomy(declared: frozenset[str]) -> Anatomy:
    return Anatomy(
        (_FORCE,),
        (Effort("on", against, hook="load"),),
        signals=(HeldSignal("measured"),),
        inputs=(Input("force", "{effort}", False, "measured"),),
    )


KIND = ElementKind(
    id="load",
    summary="A force or torque against motion, constant and measured.",
    ports=(Port("on", MECHANICAL),),
    parameters=(_FORCE,),
    anatomy=_anatomy,
    changed_between_runs=("force",),
)
