"""Friction of a gear (or a guide) that grows with what it carries.

    |F_f| += mu |F|

with F what the load asks for (`load`), what the motor gives (`drive`), or what passes between the
two, the mean of both (`passed`). Teeth and bearings rub harder under load, at all speeds and also
at rest.

Source: Bittencourt, Gunnarsson, Static friction in a robot joint - modeling and identification of
load and temperature effects, J. Dyn. Sys. Meas. Control 134 (2012) 051013, doi:10.1115/1.4006589;
Duclusaud, Passault, Extended friction models for the physics simulation of servo actuators, 2024.
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_LOAD, _DRIVE = 0.0, 1.0


def dry_friction_under_load(
    level: float, drive: float, load: float, friction_coefficient: float, by: float
) -> float:
    """Return the dry friction under load, N (or N*m)."""
    if by == _LOAD:
        return level + friction_coefficient * abs(load)
    if by == _DRIVE:
        return level + friction_coefficient * abs(drive)
    return level + friction_coefficient * 0.5 * (abs(load) + abs(drive))


EFFECT = Effect(
    id="load_dependent_friction",
    summary="Friction grows with the load that a gear or a guide carries.",
    parameters=(
        Parameter("friction_coefficient", "", 0.1, 0.0, 2.0, "mu"),
        choice("by", ("load", "drive", "passed"), "which load presses"),
    ),
    actions={"geared": Action({"dry": dry_friction_under_load})},
    source="Bittencourt, Gunnarsson, J. Dyn. Sys. Meas. Control 134 (2012) 051013",
    separate="lift and lower several loads slowly: the gap between both ways grows with the load",
)
