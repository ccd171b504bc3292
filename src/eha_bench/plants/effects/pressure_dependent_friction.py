"""The pump's dry friction grows with the pressure difference across it.

    |T_f| += mu D_p |p_a - p_b|

at all speeds and also at rest: loaded pistons, slippers and bearings rub harder. T_f is the pump's:
where it turns r times as fast as the coordinate that it is geared to, the friction there is r T_f.

Source: Ivantysyn, Ivantysynova, Hydrostatic Pumps and Motors, Akademia Books 2001 (torque losses
proportional to pressure); Schloesser, Hydraulic Power Transmission 1961.
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter


def dry_friction_under_pressure(
    level: float, pump_load: float, friction_coefficient: float
) -> float:
    """Return the dry friction of the loaded pump, N*m."""
    return level + friction_coefficient * pump_load


EFFECT = Effect(
    id="pressure_dependent_friction",
    summary="The pump's friction grows with the pressure difference.",
    parameters=(Parameter("friction_coefficient", "", 0.03, 0.0, 1.0, "mu_p"),),
    actions={
        "pump_friction": Action({"dry": dry_friction_under_pressure}),
        "holding": Action({"pump_dry": dry_friction_under_pressure}),
    },
    source="Ivantysyn, Ivantysynova, Hydrostatic Pumps and Motors, Akademia Books 2001",
    separate="hold several pressures, coming from above and from below: half the gap in current",
)
