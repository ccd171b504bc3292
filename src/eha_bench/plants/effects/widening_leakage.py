"""Oil leaks between the chambers through a gap that the pressure widens.

    q = C d ((d^2 + p_t^2) / p_s^2)^((n - 1) / 2),   d = p_a - p_b,   p_s = 10 MPa

with n above 1: housings and seals give way, and a gap's flow grows with the cube of its height. C
is the conductance at a difference of 10 MPa. Below p_t = 10 kPa every flow is laminar.

Source: Merritt, Hydraulic Control Systems, Wiley 1967 (flow through gaps); Ivantysyn, Ivantysynova,
Hydrostatic Pumps and Motors, Akademia Books 2001 (gaps that deform).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from eha_bench.plants.compiled import njit
from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter

_USUAL, _TRANSITION = 10e6, 1e4


class Gap(NamedTuple):
    """The effect's own parameters."""

    leakage_coefficient: float
    exponent: float


@njit()
def _conductance(difference: float, own: Gap) -> float:
    """Return the flow over the pressure difference, m^3/(s*Pa)."""
    square = (difference * difference + _TRANSITION * _TRANSITION) / (_USUAL * _USUAL)
    return own.leakage_coefficient * math.pow(square, 0.5 * (own.exponent - 1.0))


def into_a(flow: float, p_a: float, p_b: float, own: Gap) -> float:
    """Return the flow into chamber A less what leaks to B, m^3/s."""
    return flow - _conductance(p_a - p_b, own) * (p_a - p_b)


def into_b(flow: float, p_a: float, p_b: float, own: Gap) -> float:
    """Return the flow into chamber B with what leaks from A, m^3/s."""
    return flow + _conductance(p_a - p_b, own) * (p_a - p_b)


def slope(value: float, p_a: float, p_b: float, own: Gap) -> float:
    """Return the conductance between the chambers, never less than the true slope."""
    return value + own.exponent * _conductance(p_a - p_b, own)


EFFECT = Effect(
    id="widening_leakage",
    summary="Oil leaks between the chambers through a gap that the pressure widens.",
    parameters=(
        Parameter(
            "leakage_coefficient", "m^3/(s*Pa)", 6e-14, 0.0, 1e-7, "C", "at a difference of 10 MPa"
        ),
        Parameter("exponent", "", 1.5, 1.0, 3.0, "n"),
    ),
    actions={"chambers": Action({"into_a": into_a, "into_b": into_b, "link": slope})},
    source="Ivantysyn, Ivantysynova, Hydrostatic Pumps and Motors, Akademia Books 2001",
    separate="decay of several pressures with the piston locked: a gap that widens decays faster "
    "at first than a laminar one, a relief valve only above its setting",
)
