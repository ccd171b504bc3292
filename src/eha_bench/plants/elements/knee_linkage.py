"""The triangle of two links and a cylinder that turns a knee.

    c = c_0 + V_10 / A + x,    cos(angle) = (a^2 + b^2 - c^2) / (2 a b)
    r = d(angle)/dx = c / (a b sin(angle))
    dr/dx = r / c - r^2 cot(angle)

An inertia J on the joint is felt at the rod as J r^2, and where it moves as a force of its own,
-J r (dr/dx) v^2 (Lagrange): r changes with the rod's position.

The angle is the absolute one between the links; c_0 is the actuator's length all in, and half its
stroke V_10 / A that of the cylinder (volume at mid-stroke over its area). Where a drawing has the
length between the pins at the rod's position 0 instead, or where the volumes hold more than the
stroke, that length is declared: c = c_pins + x.

Source: Yang et al. 2023, Eq. (8)-(10).
"""

from __future__ import annotations

import math

from eha_bench.plants.compiled import njit
from eha_bench.plants.network.element import Anatomy, ElementKind, NodeKind, Port, Tie
from eha_bench.plants.parameter import Parameter

_A = Parameter("link_a", "m", 0.3, 1e-6, math.inf, "a")
_B = Parameter("link_b", "m", 0.05, 1e-6, math.inf, "b")
_C0 = Parameter("link_c0", "m", 0.3, 1e-6, math.inf, "c_0")
_LENGTH = Parameter(
    "link_length", "m", 0.3, 1e-6, math.inf, "c_pins",
    source="instead of `link_c0`: between the pins of the actuator, at the rod's position 0",
)  # fmt: skip


@njit()
def _cosine(length: float, link_a: float, link_b: float) -> float:
    """Return the cosine of the joint's angle; held near the dead points, where a leg cannot go."""
    value = (link_a * link_a + link_b * link_b - length * length) / (2.0 * link_a * link_b)
    return min(0.999, max(-0.999, value))


@njit()
def _ratio(length: float, cosine: float, link_a: float, link_b: float) -> float:
    """Return how far the joint turns with the actuator's length, rad/m."""
    return length / (link_a * link_b * math.sqrt(1.0 - cosine * cosine))


@njit()
def angle_of_pins(position: float, link_a: float, link_b: float, link_length: float) -> float:
    """Return the joint's angle, rad."""
    return math.acos(_cosine(link_length + position, link_a, link_b))


@njit()
def joint_angle_per_rod_of_pins(
    position: float, link_a: float, link_b: float, link_length: float
) -> float:
    """Return how far the joint turns with the rod, rad/m."""
    length = link_length + position
    return _ratio(length, _cosine(length, link_a, link_b), link_a, link_b)


@njit()
def joint_angle_bend_of_pins(
    position: float, link_a: float, link_b: float, link_length: float
) -> float:
    """Return by how much more the joint turns with the rod further out, rad/m^2."""
    length = link_length + position
    cosine = _cosine(length, link_a, link_b)
    ratio = _ratio(length, cosine, link_a, link_b)
    return ratio / length - ratio * ratio * cosine / math.sqrt(1.0 - cosine * cosine)


def angle(
    position: float,
    link_a: float,
    link_b: float,
    link_c0: float,
    cylinder_volume_a: float,
    cylinder_area_a: float,
) -> float:
    """Return the joint's angle, rad."""
    return angle_of_pins(position, link_a, link_b, link_c0 + cylinder_volume_a / cylinder_area_a)


def joint_angle_per_rod(
    position: float,
    link_a: float,
    link_b: float,
    link_c0: float,
    cylinder_volume_a: float,
    cylinder_area_a: float,
) -> float:
    """Return how far the joint turns with the rod, rad/m."""
    length = link_c0 + cylinder_volume_a / cylinder_area_a
    return joint_angle_per_rod_of_pins(position, link_a, link_b, length)


def joint_angle_bend(
    position: float,
    link_a: float,
    link_b: float,
    link_c0: float,
    cylinder_volume_a: float,
    cylinder_area_a: float,
) -> float:
    """Return by how much more the joint turns with the rod further out, rad/m^2."""
    length = link_c0 + cylinder_volume_a / cylinder_area_a
    return joint_angle_bend_of_pins(position, link_a, link_b, length)


def _anatomy(declared: frozenset[str]) -> Anatomy:
    if _LENGTH.name in declared:
        tie = Tie("to", "on", joint_angle_per_rod_of_pins, angle_of_pins, joint_angle_bend_of_pins)
        return Anatomy((_A, _B, _LENGTH), (tie,))
    return Anatomy((_A, _B, _C0), (Tie("to", "on", joint_angle_per_rod, angle, joint_angle_bend),))


KIND = ElementKind(
    id="knee_linkage",
    summary="Two links and a cylinder that turns the joint between them, at a length of "
    "`link_c0` + `volume_a` / `area_a` of the cylinder + the rod's position, or of `link_length` + "
    "that position: a crank or a lever, too.",
    ports=(Port("on", (NodeKind.TRANSLATION,)), Port("to", (NodeKind.ROTATION,))),
    parameters=(_A, _B, _C0, _LENGTH),
    anatomy=_anatomy,
    required=("link_a", "link_b"),
    one_of=("link_c0", "link_length"),
    refers=("cylinder",),
    source="Yang et al. 2023, Eq. (8)-(10)",
)
