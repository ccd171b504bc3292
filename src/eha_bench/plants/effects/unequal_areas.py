"""A single-rod cylinder that is declared as symmetrical: the rod takes area from chamber B.

    A_b' = A_b (1 - delta)

It moves less oil on side B, and its pressure there pushes less. Where the declared volume of
chamber B was taken from the area as well, it is smaller by the same share (`chamber: scaled`).

Source: Merritt, Hydraulic Control Systems, Wiley 1967 (single-rod pistons); Jelali,
Kroll, Hydraulic Servo-systems, Springer 2003.
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_SCALED = 1.0


def smaller(area: float, area_difference: float) -> float:
    """Return the piston's area on the side of chamber B, m^2."""
    return area * (1.0 - area_difference)


def smaller_volume(volume: float, area_difference: float, chamber: float) -> float:
    """Return the volume of chamber B at mid-stroke, m^3."""
    return volume * (1.0 - area_difference) if chamber == _SCALED else volume


EFFECT = Effect(
    id="unequal_areas",
    summary="A single-rod cylinder declared as symmetrical.",
    parameters=(
        Parameter("area_difference", "", 0.05, -0.95, 0.95, "delta"),
        choice("chamber", ("kept", "scaled"), "whether the volume of chamber B goes along"),
    ),
    actions={
        "cylinder": Action(
            adjusts={"area_b": smaller, "volume_b": smaller_volume}, alike=("area_a", "area_b")
        )
    },
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
    separate="move the rod by known strokes and compare the oil that both chambers take",
    starts=(
        {"area_difference": -0.05},
        {"area_difference": 0.05, "chamber": _SCALED},
        {"area_difference": -0.05, "chamber": _SCALED},
    ),
)
