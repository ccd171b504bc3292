"""A joint that gives way: a gear's teeth, a belt, a shaft, a rod's end.

What the plant takes for rigid becomes two parts, joined by a spring with a damper in parallel:

    F = (d + tau dd/dt) / c,    d = x - x_other

pushes the other part forwards and this one back. The compliance c is the inverse of a stiffness, so
that nothing stands for a rigid joint. Of a gear, the shaft that drives it is the other part, at the
speed of the slow side; of a node that carries masses, these are, and its load. Sensors of that node
are before the joint, or beyond it with the other part.

Source: Spong, J. Dyn. Syst. Meas. Control 109 (1987) 310, doi:10.1115/1.3143860.
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Coupling, Effect
from eha_bench.plants.parameter import Parameter, choice

_BEFORE, _BEYOND = 0.0, 1.0

EFFECT = Effect(
    id="joint_elasticity",
    summary="A gear, a shaft or a rod's end gives way between the parts that it joins.",
    parameters=(
        Parameter("compliance", "{compliance}", 1.0, 0.0, 1e3, "c", "inverse of its stiffness"),
        Parameter("damping_time", "s", 1e-3, 0.0, 0.1, "tau", "damping over stiffness"),
        choice(
            "sensors", ("before", "beyond"),
            "whether those of the joint's node are on its own side (of a gear: what it turns) or "
            "with the other part (of a gear: the shaft that drives it)",
        ),
    ),
    actions={"rigid_joint": Action(couples=Coupling("compliance", "damping_time", "sensors"))},
    source="Spong, J. Dyn. Syst. Meas. Control 109 (1987) 310, doi:10.1115/1.3143860",
    separate=(
        "drive sines through the resonance: a soft joint swings, and the angle between motor and "
        "output follows the torque"
    ),
    starts=tuple(
        # a resonance is found from nearby only
        {"sensors": sensors, "compliance": 0.05 * 2.0**k}
        for sensors in (_BEFORE, _BEYOND)
        for k in range(8)
    ),
)  # fmt: skip
