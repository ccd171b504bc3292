"""Friction is stronger in one direction than in the other.

    F_f(+) = F_f (1 + a),   F_f(-) = F_f (1 - a)

on the pump (by the direction of rotation) or on the rod: its dry friction, its viscous friction,
or both (`kind`). It scales whatever friction there is, also that of other effects.

Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083,
doi:10.1016/0005-1098(94)90209-7; EMPS, whose viscous friction is lopsided: Janot,
Gautier, Brunot, Workshop on Nonlinear System Identification Benchmarks 2019.
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice

_PUMP, _ROD = 0.0, 1.0
_DRY, _VISCOUS, _ALL = 0.0, 1.0, 2.0


def pump_level(level: float, direction: float, asymmetry: float, part: float, kind: float) -> float:
    """Return the pump's dry friction for a direction, N*m."""
    if part != _PUMP or kind == _VISCOUS:
        return level
    return level * (1.0 + asymmetry * direction)


def rod_level(level: float, direction: float, asymmetry: float, part: float, kind: float) -> float:
    """Return the rod's dry friction for a direction, N."""
    if part != _ROD or kind == _VISCOUS:
        return level
    return level * (1.0 + asymmetry * direction)


def drive_level(level: float, direction: float, asymmetry: float, kind: float) -> float:
    """Return the drive's dry friction for a direction, N."""
    return level if kind == _VISCOUS else level * (1.0 + asymmetry * direction)


def pump_viscous(
    coefficient: float, omega: float, asymmetry: float, part: float, kind: float
) -> float:
    """Return the pump's viscous friction for a direction, N*m*s/rad."""
    if part != _PUMP or kind == _DRY:
        return coefficient
    return coefficient * (1.0 + asymmetry if omega > 0.0 else 1.0 - asymmetry)


def rod_viscous(coefficient: float, v: float, asymmetry: float, part: float, kind: float) -> float:
    """Return the rod's viscous friction for a direction, N*s/m."""
    if part != _ROD or kind == _DRY:
        return coefficient
    return coefficient * (1.0 + asymmetry if v > 0.0 else 1.0 - asymmetry)


def drive_viscous(coefficient: float, v: float, asymmetry: float, kind: float) -> float:
    """Return the drive's viscous friction for a direction, N*s/m."""
    if kind == _DRY:
        return coefficient
    return coefficient * (1.0 + asymmetry if v > 0.0 else 1.0 - asymmetry)


EFFECT = Effect(
    id="asymmetric_friction",
    summary="Friction is stronger in one direction than in the other.",
    parameters=(
        Parameter("asymmetry", "", 0.1, -1.0, 1.0, "a"),
        choice("part", ("pump", "rod"), "whose friction is lopsided"),
        choice("kind", ("dry", "viscous", "all"), "which friction is lopsided"),
    ),
    actions={
        "eha_knee": Action(
            Equation.TORQUE,
            {
                "pump_dry": pump_level,
                "rod_dry": rod_level,
                "pump_viscous": pump_viscous,
                "rod_viscous": rod_viscous,
            },
            chosen_by="part",
            equations={"rod": Equation.FORCE},
        ),
        "linear_drive": Action(
            Equation.FORCE,
            {"rod_dry": drive_level, "rod_viscous": drive_viscous},
            choices={"part": ("rod",)},
        ),
    },
    source=(
        "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083, "
        "doi:10.1016/0005-1098(94)90209-7"
    ),
    separate=(
        "run both ways with the bypass open: friction then differs by direction, a sensor's offset "
        "does not matter"
    ),
    starts=(
        {"asymmetry": -0.1, "part": _PUMP},
        {"asymmetry": 0.1, "part": _PUMP, "kind": _VISCOUS},
        {"asymmetry": 0.1, "part": _PUMP, "kind": _ALL},
        {"asymmetry": 0.3, "part": _ROD},
        {"asymmetry": -0.3, "part": _ROD},
        {"asymmetry": 0.1, "part": _ROD, "kind": _VISCOUS},
        {"asymmetry": 0.1, "part": _ROD, "kind": _ALL},
    ),
    order=1,
)
