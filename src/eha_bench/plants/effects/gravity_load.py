"""A weight turns a joint, or pulls along a slide that is not level.

    tau = G cos(angle - alpha_0)        the arm hangs, or lifts a link (posture: link)
    tau = G cos(angle / 2 - alpha_0)    a body stands on two links (posture: standing)
    F_rod = -tau d(angle)/dx            behind a linkage;  T = +tau on the shaft itself
    F = -F_g,  F_g = m g sin(slope)     along a slide, positive against extension

The angle is the joint's and G the weight times its arm. For one link alpha_0 is the angle at which
it is level; for a body that stands on two links of one length, straight above the wheel, the knee
is l cos(angle / 2) off the line of the weight, and alpha_0 is 0. Behind a linkage a positive
moment pushes against extension.

Source: Yang et al. 2023, Eq. (8)-(10); Siciliano et al., Robotics, Springer 2009 (gravity terms).
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_LINK, _STANDING = 0.0, 1.0


def effort_with_gravity(
    effort: float,
    angle: float,
    turns: float,
    gravity_torque: float,
    level_angle: float,
    posture: float,
) -> float:
    """Return the effort with the weight, N (or N*m); `turns` is d(angle)/dx, -1 at the shaft."""
    share = 0.5 if posture == _STANDING else 1.0
    return effort - gravity_torque * math.cos(share * angle - level_angle) * turns


def force_with_gravity(effort: float, gravity_force: float) -> float:
    """Return the force with the weight's component along the slide, N."""
    return effort - gravity_force


EFFECT = Effect(
    id="gravity_load",
    summary="A weight acts on a joint, or along a slide that is not level.",
    parameters=(
        Parameter("gravity_torque", "{weight}", 20.0, -1e4, 1e4, "G", role="hanging"),
        Parameter(
            "level_angle", "rad", 1.0, -2.0 * math.pi, 2.0 * math.pi, "alpha_0", role="hanging"
        ),
        choice(
            "posture", ("link", "standing"), "what the weight does with the joint",
            of_role="hanging",
        ),
        Parameter("gravity_force", "{effort}", 0.3, -1e6, 1e6, "F_g", role="slide"),
    ),
    actions={
        "hanging": Action({"net": effort_with_gravity}),
        "slide": Action({"net": force_with_gravity}, same_as="load"),
    },
    source="Yang et al. 2023, Eq. (8)-(10)",
    separate=(
        "hold the joint at several angles: a weight changes with the angle, a load does not; "
        "turn a slide over: a weight changes its sign, lopsided friction keeps it"
    ),
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
