"""A cylinder: two chambers, a piston between them, one rod or two.

    F = A_a p_a - A_b p_b,    q_a = -A_a v,    q_b = +A_b v
    V_a = V_a0 + A_a x,       V_b = V_b0 - A_b x

Positive motion makes chamber a grow. The volumes are declared as they are at position 0
(`volume_a`, `volume_b`), or as what is left at each end of the stroke (`dead_volume_a`, `_b`),
where the rod's node has a `stroke`. A chamber never holds less than 2 % of that.

Source: Merritt, Hydraulic Control Systems, Wiley 1967; Jelali, Kroll, Hydraulic Servo-systems,
Springer 2003.
"""

from __future__ import annotations

import math

from eha_bench.plants.network.element import (
    HYDRAULIC,
    Anatomy,
    BalanceSide,
    Effort,
    ElementKind,
    Flow,
    NodeKind,
    Oil,
    Port,
    Stops,
)
from eha_bench.plants.parameter import Parameter

_INF = math.inf
_AREA_A = Parameter("area_a", "m^2", 1e-3, 1e-9, _INF, "A_a", drawn=True)
_AREA_B = Parameter("area_b", "m^2", 1e-3, 1e-9, _INF, "A_b", drawn=True)
_VOLUME_A = Parameter("volume_a", "m^3", 1e-4, 1e-12, _INF, "V_a0", "at position 0", drawn=True)
_VOLUME_B = Parameter("volume_b", "m^3", 1e-4, 1e-12, _INF, "V_b0", "at position 0", drawn=True)
_DEAD_A = Parameter(
    "dead_volume_a", "m^3", 1e-5, 1e-12, _INF, "", "with the rod all in", drawn=True
)
_DEAD_B = Parameter(
    "dead_volume_b", "m^3", 1e-5, 1e-12, _INF, "", "with the rod all out", drawn=True
)

# the share of a chamber's volume that is always left
_LEFT = 0.02


def force(p_a: float, p_b: float, area_a: float, area_b: float) -> float:
    """Return the force of the oil on the rod, N."""
    return area_a * p_a - area_b * p_b


def from_a(speed: float, area_a: float) -> float:
    """Return the flow that the piston takes from chamber a, m^3/s."""
    return area_a * speed


def into_b(speed: float, area_b: float) -> float:
    """Return the flow that the piston pushes into chamber b, m^3/s."""
    return area_b * speed


def oil_a(position: float, volume_a: float, area_a: float) -> float:
    """Return the volume of chamber a, m^3."""
    return volume_a + area_a * position


def oil_b(position: float, volume_b: float, area_b: float) -> float:
    """Return the volume of chamber b, m^3."""
    return volume_b - area_b * position


def least_a(volume_a: float) -> float:
    """Return what is always left in chamber a, m^3."""
    return _LEFT * volume_a


def least_b(volume_b: float) -> float:
    """Return what is always left in chamber b, m^3."""
    return _LEFT * volume_b


def low_end(volume_a: float, area_a: float, volume_b: float, area_b: float) -> float:
    """Return the lower end of the stroke where the volumes give it, m."""
    return -(min(volume_a / area_a, volume_b / area_b) * (1.0 - _LEFT))


def high_end(volume_a: float, area_a: float, volume_b: float, area_b: float) -> float:
    """Return the upper end of the stroke where the volumes give it, m."""
    return min(volume_a / area_a, volume_b / area_b) * (1.0 - _LEFT)


def open_volume_a(position: float, low: float, dead_volume_a: float, area_a: float) -> float:
    """Return the volume of chamber a above its dead volume, m^3."""
    return dead_volume_a + area_a * (position - low)


def open_volume_b(position: float, high: float, dead_volume_b: float, area_b: float) -> float:
    """Return the volume of chamber b above its dead volume, m^3."""
    return dead_volume_b + area_b * (high - position)


def dead_a(dead_volume_a: float) -> float:
    """Return what is always left in chamber a, m^3."""
    return 0.5 * dead_volume_a


def dead_b(dead_volume_b: float) -> float:
    """Return what is always left in chamber b, m^3."""
    return 0.5 * dead_volume_b


def _anatomy(declared: frozenset[str]) -> Anatomy:
    common = (
        Effort("on", force, BalanceSide.DRIVE),
        Flow("a", "", from_a),
        Flow("", "b", into_b),
    )
    if {"volume_a", "volume_b"} & declared:
        return Anatomy(
            (_AREA_A, _AREA_B, _VOLUME_A, _VOLUME_B),
            (
                *common,
                Oil("a", oil_a, least_a),
                Oil("b", oil_b, least_b),
                Stops("on", low_end, high_end),
            ),
        )
    return Anatomy(
        (_AREA_A, _AREA_B, _DEAD_A, _DEAD_B),
        (*common, Oil("a", open_volume_a, dead_a), Oil("b", open_volume_b, dead_b)),
    )


KIND = ElementKind(
    id="cylinder",
    summary="A cylinder with one rod or two between two volumes.",
    ports=(Port("on", (NodeKind.TRANSLATION,)), Port("a", HYDRAULIC), Port("b", HYDRAULIC)),
    parameters=(_AREA_A, _AREA_B, _VOLUME_A, _VOLUME_B, _DEAD_A, _DEAD_B),
    anatomy=_anatomy,
    required=("area_a", "area_b"),
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
)
