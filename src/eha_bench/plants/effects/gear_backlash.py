"""Play between a drive and its load, each of which moves by itself while it is crossed.

    d = x - x_other,    s = d - min(max(d, -g/2), g/2)
    F = (s + tau ds/dt) / c

pushes the other part forwards and this one back; within the play g nothing is pushed, and at its
ends it only pushes. Of a gear, the shaft that drives it is the other part, at the speed of the slow
side; of a node that carries masses, these are, and its load, and the node's sensors are with them.
A play that such sensors are before is `joint_backlash`.

Source: Nordin, Gutman, Automatica 38 (2002) 1633, doi:10.1016/S0005-1098(02)00047-X.
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Coupling, Effect
from eha_bench.plants.parameter import Parameter, choice

_STIFF, _ELASTIC = 0.0, 1.0

EFFECT = Effect(
    id="gear_backlash",
    summary="Play between a drive and its load, in a gear or before the load's sensor.",
    parameters=(
        Parameter("play", "{play}", 1e-4, 0.0, 0.5, "g", "from end to end"),
        Parameter("damping_time", "s", 1e-3, 0.0, 0.1, "tau", "damping over stiffness"),
        choice(
            "sensors", ("before", "beyond"),
            "whether those of the joint's node are on its own side (of a gear: what it turns) or "
            "with the other part (of a gear: the shaft that drives it)",
            default="beyond",
        ),
        Parameter(
            "compliance", "{compliance}", 0.0, 0.0, 1e3, "c",
            "of the teeth; 0: as stiff as a step follows; one that is declared acts in any case",
            when=("contact", ("elastic",)),
        ),
        choice("contact", ("stiff", "elastic"), "whether the teeth give way", refines=True),
    ),
    actions={
        "rigid_joint": Action(
            couples=Coupling("compliance", "damping_time", "sensors", "play"), plays="play"
        )
    },
    source="Nordin, Gutman, Automatica 38 (2002) 1633, doi:10.1016/S0005-1098(02)00047-X",
    separate=(
        "reverse slowly: with play the torque falls to what the drive alone takes before the load "
        "follows"
    ),
    starts=(
        *({"contact": _STIFF, "play": 1e-4 * 2.0**k} for k in range(-1, 5)),
        *({"contact": _ELASTIC, "play": 2e-4, "compliance": 0.05 * 4.0**k} for k in range(4)),
    ),
    yields_to="joint_backlash",
    reversing=True,
)  # fmt: skip
