"""The weight of the leg turns about the knee, and the linkage passes that on to the rod.

    tau = G cos(alpha - alpha_0),   F_rod = -tau / l_el(x)

alpha is the absolute knee angle, G the weight times its arm, alpha_0 the angle at which the link
with the weight is level; a positive moment pushes against extension. l_el = a b sin(alpha) / c is
the arm of the actuator about the knee and c its length (Eq. (8)-(10)).

Source: the paper, Eq. (8)-(10); Siciliano et al., Robotics, Springer 2009, section 7.3 (gravity
terms).
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter


def weighed(
    force: float,
    x: float,
    link_a: float,
    link_b: float,
    link_c0: float,
    volume_a: float,
    piston_area_a: float,
    gravity_torque: float,
    level_angle: float,
) -> float:
    """Return the force on the rod with the weight of the leg, N."""
    length = link_c0 + volume_a / piston_area_a + x
    cosine = (link_a**2 + link_b**2 - length**2) / (2.0 * link_a * link_b)
    # near the dead points the arm vanishes; a leg cannot go there
    cosine = min(0.999, max(-0.999, cosine))
    angle = math.acos(cosine)
    arm = link_a * link_b * math.sin(angle) / length
    return force - gravity_torque * math.cos(angle - level_angle) / arm


EFFECT = Effect(
    id="gravity_load",
    summary="The weight of the leg acts on the rod through the linkage.",
    parameters=(
        Parameter("gravity_torque", "N*m", 20.0, -1e4, 1e4, "G"),
        Parameter("level_angle", "rad", 1.0, -math.pi, math.pi, "alpha_0"),
    ),
    actions={"eha_knee": Action(Equation.FORCE, {"rod_force": weighed})},
    source="the paper, Eq. (8)-(10)",
    separate="hold the rod at several positions: a weight changes with the angle, a load does not",
    starts=(
        {"gravity_torque": 20.0, "level_angle": 0.0},
        {"gravity_torque": 20.0, "level_angle": 2.0},
        {"gravity_torque": 20.0, "level_angle": 3.0},
        {"gravity_torque": -20.0, "level_angle": 1.0},
        {"gravity_torque": -20.0, "level_angle": 2.0},
    ),
)
