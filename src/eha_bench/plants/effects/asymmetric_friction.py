"""Dry friction is stronger in one direction than in the other.

    F_f(+) = F_f (1 + a),   F_f(-) = F_f (1 - a)

on the pump (in every quadrant by the direction of rotation) or on the rod. It scales whatever dry
friction there is, also that of other effects.

Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083,
doi:10.1016/0005-1098(94)90209-7, section 2; for EMPS: Janot, Gautier, Brunot, Workshop on
Nonlinear System Identification Benchmarks 2019.
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice

_PUMP, _ROD = 0.0, 1.0


def pump_level(level: float, direction: float, asymmetry: float, part: float) -> float:
    """Return the pump's dry friction for a direction, N*m."""
    return level * (1.0 + asymmetry * direction) if part == _PUMP else level


def rod_level(level: float, direction: float, asymmetry: float, part: float) -> float:
    """Return the rod's dry friction for a direction, N."""
    return level * (1.0 + asymmetry * direction) if part == _ROD else level


def drive_level(level: float, direction: float, asymmetry: float) -> float:
    """Return the drive's dry friction for a direction, N."""
    return level * (1.0 + asymmetry * direction)


EFFECT = Effect(
    id="asymmetric_friction",
    summary="Dry friction is stronger in one direction than in the other.",
    parameters=(
        Parameter("asymmetry", "", 0.1, -1.0, 1.0, "a"),
        choice("part", ("pump", "rod"), "which friction is lopsided"),
    ),
    actions={
        "eha_knee": Action(
            Equation.TORQUE,
            {"pump_dry": pump_level, "rod_dry": rod_level},
            chosen_by="part",
            equations={"rod": Equation.FORCE},
        ),
        "linear_drive": Action(
            Equation.FORCE, {"rod_dry": drive_level}, choices={"part": ("rod",)}
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
        {"asymmetry": 0.3, "part": _ROD},
        {"asymmetry": -0.3, "part": _ROD},
    ),
    order=1,
)
