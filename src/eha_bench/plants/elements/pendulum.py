"""A mass on an arm that turns in a vertical plane: inertia and weight.

    J = m l^2,    T = -m g l sin(angle - angle_0)

The angle is angle_0 (0 by default) where it hangs straight down.

Source: Siciliano et al., Robotics, Springer 2009 (gravity terms).
"""

from __future__ import annotations

import math

from eha_bench.plants.network.element import Anatomy, Effort, ElementKind, Inertia, NodeKind, Port
from eha_bench.plants.parameter import Parameter

_MASS = Parameter("mass", "kg", 1.0, 0.0, math.inf, "m")
_LENGTH = Parameter("length", "m", 0.1, 0.0, math.inf, "l")
_HANGING = Parameter("hanging_angle", "rad", 0.0, -10.0, 10.0, "angle_0", "where it hangs")
_GRAVITY = Parameter("gravity", "m/s^2", 9.80665, 0.0, 30.0, "g", "on earth")


def inertia_of(mass: float, length: float) -> float:
    """Return the inertia of the mass on its arm, kg*m^2."""
    return mass * length * length


def pull(
    position: float, mass: float, length: float, hanging_angle: float, gravity: float
) -> float:
    """Return the torque of the weight, N*m."""
    return -(mass * gravity * length * math.sin(position - hanging_angle))


def _anatomy(declared: frozenset[str]) -> Anatomy:
    parameters = (_MASS, _LENGTH, _HANGING, _GRAVITY)
    return Anatomy(parameters, (Inertia("on", inertia_of), Effort("on", pull)))


KIND = ElementKind(
    id="pendulum",
    summary="A mass on an arm in a vertical plane.",
    ports=(Port("on", (NodeKind.ROTATION,)),),
    parameters=(_MASS, _LENGTH, _HANGING, _GRAVITY),
    anatomy=_anatomy,
    required=("mass", "length"),
    changed_between_runs=("mass",),
    source="Siciliano et al., Robotics, Springer 2009",
)
