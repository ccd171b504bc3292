"""Oil leaks between the chambers through a gap that the pressure widens.

    q = C d ((d^2 + p_t^2) / p_s^2)^((n - 1) / 2),   d = p_a - p_b,   p_s = 10 MPa

with n above 1: housings and seals give way, and a gap's flow grows with the cube of its height. C
is the conductance at a difference of 10 MPa. Below p_t = 10 kPa every flow is laminar.

Source: Merritt, Hydraulic Control Systems, Wiley 1967 (flow through gaps); Ivantysyn, Ivantysynova,
Hydrostatic Pumps and Motors, Akademia Books 2001 (gaps that deform).
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.gap_conductance import gap_conductance
from eha_bench.plants.parameter import Parameter


def into_a(
    flow: float, p_a: float, p_b: float, leakage_coefficient: float, exponent: float
) -> float:
    """Return the flow into chamber A less what leaks to B, m^3/s."""
    d = p_a - p_b
    return flow - gap_conductance(d, leakage_coefficient, exponent) * d


def into_b(
    flow: float, p_a: float, p_b: float, leakage_coefficient: float, exponent: float
) -> float:
    """Return the flow into chamber B with what leaks from A, m^3/s."""
    d = p_a - p_b
    return flow + gap_conductance(d, leakage_coefficient, exponent) * d


def slope(
    value: float, p_a: float, p_b: float, leakage_coefficient: float, exponent: float
) -> float:
    """Return the conductance between the chambers, never less than the true slope."""
    return value + exponent * gap_conductance(p_a - p_b, leakage_coefficient, exponent)


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
