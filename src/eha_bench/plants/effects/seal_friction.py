"""The seals of piston and rod are pressed on by the oil, so the rod's friction grows with pressure.

    F_f += mu A (p_a + p_b)        or with |p_a - p_b|, or with the higher of both

A is the piston area, so mu is the share of the hydraulic force that the seals take.

Source: Bonchis, Corke, Rye, A Pressure-Based, Velocity Independent, Friction Model for Asymmetric
Hydraulic Cylinders, IEEE Int. Conf. Robotics and Automation 1999; Nikas, Proc. IMechE J 224 (2010)
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_SUM, _DIFFERENCE, _HIGHER = 0.0, 1.0, 2.0


def pressed(
    level: float,
    p_a: float,
    p_b: float,
    area_a: float,
    friction_coefficient: float,
    pressure: float,
) -> float:
    """Return the rod's dry friction with the seals pressed on, N."""
    if pressure == _SUM:
        load = max(0.0, p_a) + max(0.0, p_b)
    elif pressure == _DIFFERENCE:
        load = abs(p_a - p_b)
    else:
        load = max(0.0, p_a, p_b)
    return level + friction_coefficient * area_a * load


EFFECT = Effect(
    id="seal_friction",
    summary="The rod's friction grows with pressure, because the oil presses its seals on.",
    parameters=(
        Parameter("friction_coefficient", "", 0.02, 0.0, 1.0, "mu"),
        choice("pressure", ("sum", "difference", "higher"), "which pressure presses"),
    ),
    actions={"rod": Action({"dry": pressed})},
    source=(
        "Bonchis, Corke, Rye, IEEE Int. Conf. Robotics and Automation 1999 (pressure-based "
        "friction of cylinders)"
    ),
    separate="move the rod slowly both ways under several loads; viscosity does not care for load",
    starts=({"pressure": _DIFFERENCE}, {"pressure": _HIGHER}),
)
