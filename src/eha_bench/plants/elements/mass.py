"""Mass that moves with a rod, or inertia that turns with a shaft, in addition to the node's own."""

from __future__ import annotations

import math

from eha_bench.plants.network.element import MECHANICAL, Anatomy, ElementKind, Inertia, Port
from eha_bench.plants.parameter import Parameter

_MASS = Parameter("mass", "{inertia}", 1.0, 0.0, math.inf, "m")


def mass_of(mass: float) -> float:
    """Return the mass, kg (or the inertia, kg*m^2)."""
    return mass


def _anatomy(declared: frozenset[str]) -> Anatomy:
    return Anatomy((_MASS,), (Inertia("on", mass_of),))


KIND = ElementKind(
    id="mass",
    summary="Mass or inertia in addition to the node's own.",
    ports=(Port("on", MECHANICAL),),
    parameters=(_MASS,),
    anatomy=_anatomy,
    changed_between_runs=("mass",),
    required=("mass",),
)
