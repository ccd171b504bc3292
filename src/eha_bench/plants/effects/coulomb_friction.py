"""Dry friction of rod or pump, for a plant declared without it.

    F = -sign(v) F_c [1 + (r - 1) exp(-(v / v_s)^2)];  at rest any force up to r F_c

r is the ratio of static to Coulomb friction: 1, the default, is Coulomb's law alone; v_s is the
Stribeck velocity. On the pump (`part: pump`) F_c is meant at the piston, T = F D_p / A, so that one
parameter serves both; there the plant's Stribeck speed holds.

Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083,
doi:10.1016/0005-1098(94)90209-7.
"""

from __future__ import annotations

import math

from eha_bench.plants.compiled import njit
from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice

_ROD, _PUMP = 0.0, 1.0


@njit()
def _friction(force: float, static_ratio: float, ratio: float) -> float:
    """Return the dry friction at a ratio of speed to Stribeck speed, N."""
    return force * (1.0 + (static_ratio - 1.0) * math.exp(-ratio * ratio))


def rod(
    level: float,
    v: float,
    friction_force: float,
    part: float,
    static_ratio: float,
    stribeck_velocity: float,
) -> float:
    """Return the dry friction of the rod, N."""
    if part != _ROD:
        return level
    return level + _friction(friction_force, static_ratio, v / stribeck_velocity)


def pump(
    level: float,
    omega: float,
    pump_displacement: float,
    piston_area_a: float,
    stribeck_speed: float,
    friction_force: float,
    part: float,
    static_ratio: float,
) -> float:
    """Return the dry friction of the pump, N*m."""
    if part != _PUMP:
        return level
    force = _friction(friction_force, static_ratio, omega / stribeck_speed)
    return level + force * pump_displacement / piston_area_a


def drive(
    level: float,
    v: float,
    friction_force: float,
    static_ratio: float,
    stribeck_velocity: float,
) -> float:
    """Return the dry friction of the drive, N."""
    return level + _friction(friction_force, static_ratio, v / stribeck_velocity)


EFFECT = Effect(
    id="coulomb_friction",
    summary="Dry friction that the plant is declared without.",
    parameters=(
        Parameter("friction_force", "N", 20.0, 0.0, 1e6, "F_c"),
        choice("part", ("rod", "pump"), "what rubs"),
        Parameter("static_ratio", "", 1.0, 1.0, 5.0, "r"),
        Parameter(
            "stribeck_velocity", "m/s", 5e-3, 1e-6, 1.0, "v_s",
            "lubricated seals and guides", searched=False, when=("part", ("rod",)),
        ),
    ),
    actions={
        "eha_knee": Action(
            Equation.FORCE,
            {"rod_dry": rod, "pump_dry": pump},
            chosen_by="part",
            equations={"pump": Equation.TORQUE},
            same_as={"rod": "rod_coulomb", "pump": "coulomb_torque"},
        ),
        "linear_drive": Action(
            Equation.FORCE,
            {"rod_dry": drive},
            choices={"part": ("rod",)},
            same_as={"": "coulomb_friction"},
        ),
    },
    source=(
        "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083, "
        "doi:10.1016/0005-1098(94)90209-7"
    ),
    separate="move at several constant speeds both ways: the force jumps where motion reverses",
    starts=({"friction_force": 400.0, "part": _PUMP}, {"friction_force": 40.0, "part": _PUMP}),
)  # fmt: skip
