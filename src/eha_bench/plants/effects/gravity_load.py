"""The weight of the leg turns about the knee, and the linkage passes that on to the rod.

    tau = G cos(alpha - alpha_0)        the leg hangs, or lifts a link (posture: link)
    tau = G cos(alpha / 2 - alpha_0)    the body stands on the leg (posture: standing)
    F_rod = -tau / l_el(x)

alpha is the absolute knee angle and G the weight times its arm. For one link alpha_0 is the angle
at which it is level; for a body that stands on two links of one length, straight above the wheel,
the knee is l cos(alpha / 2) beside the line of the weight, and alpha_0 is 0. A positive moment
pushes against extension. l_el = a b sin(alpha) / c is the arm of the actuator about the knee and c
its length (Eq. (8)-(10)).

Source: the paper, Eq. (8)-(10); Siciliano et al., Robotics, Springer 2009 (gravity
terms).
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice

_LINK, _STANDING = 0.0, 1.0


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
    posture: float,
) -> float:
    """Return the force on the rod with the weight of the leg, N."""
    length = link_c0 + volume_a / piston_area_a + x
    cosine = (link_a**2 + link_b**2 - length**2) / (2.0 * link_a * link_b)
    # near the dead points the arm vanishes; a leg cannot go there
    cosine = min(0.999, max(-0.999, cosine))
    angle = math.acos(cosine)
    arm = link_a * link_b * math.sin(angle) / length
    share = 0.5 if posture == _STANDING else 1.0
    return force - gravity_torque * math.cos(share * angle - level_angle) / arm


EFFECT = Effect(
    id="gravity_load",
    summary="The weight of the leg acts on the rod through the linkage.",
    parameters=(
        Parameter("gravity_torque", "N*m", 20.0, -1e4, 1e4, "G"),
        Parameter("level_angle", "rad", 1.0, -2.0 * math.pi, 2.0 * math.pi, "alpha_0"),
        choice("posture", ("link", "standing"), "what the weight does with the knee"),
    ),
    actions={"eha_knee": Action(Equation.FORCE, {"rod_force": weighed})},
    source="the paper, Eq. (8)-(10)",
    separate="hold the rod at several positions: a weight changes with the angle, a load does not",
    starts=(
        *(
            {"gravity_torque": torque, "level_angle": angle, "posture": _LINK}
            for torque, angle in (
                (20.0, 0.0), (20.0, 2.0), (20.0, 3.0), (-20.0, 1.0), (-20.0, 2.0),
            )
        ),
        {"gravity_torque": 20.0, "level_angle": 0.0, "posture": _STANDING},
        {"gravity_torque": -20.0, "level_angle": 0.0, "posture": _STANDING},
    ),
)  # fmt: skip
