"""A position loop does nothing about small errors: the dead zone of its controller.

    e_eff = e - d where e > d,   e + d where e < -d,   0 between    `form: shifted`
    e_eff = e where |e| > d,   0 else                               `form: jump`

It acts on the error before the drive limits what the loop asks for: full command is still there,
while that of a dead zone behind the limit (`current_deadband`) falls short of it. What damps the
speed goes on.

Source: Tao, Kokotovic, IEEE Trans. Automatic Control 39 (1994) 59, doi:10.1109/9.273339 (dead
zones); the dead zone of the error is a register of smart servos (`CW / CCW compliance margin` of
Robotis AX-12, `dead zone` of Feetech STS).
"""

from __future__ import annotations

from eha_bench.plants.dead_zone import dead_zone
from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_SHIFTED, _JUMP = 0.0, 1.0
_SHARP = 0.0


def followed(reference: float, reading: float, deadband: float, form: float) -> float:
    """Return the reference whose error is what the zone passes, in its unit."""
    error = reference - reading
    if form == _JUMP:
        return reference if abs(error) > deadband else reading
    return reading + dead_zone(error, deadband, 0.0, _SHARP)


EFFECT = Effect(
    id="position_deadband",
    summary="A position loop does nothing about small errors.",
    parameters=(
        Parameter("deadband", "{position}", 0.1, 0.0, 100.0, "d"),
        choice("form", ("shifted", "jump"), "whether an error counts from the zone's edge"),
    ),
    actions={"position_loop": Action({"reference": followed})},
    source="Tao, Kokotovic, IEEE Trans. Automatic Control 39 (1994) 59, doi:10.1109/9.273339",
    separate="ask for slow ramps both ways, unloaded: the position lags by the zone either way, "
    "and fast steps are as fast as without it",
    starts=({"deadband": 0.03}, {"deadband": 0.3}, {"deadband": 0.1, "form": _JUMP}),
    order=1,
)
