"""Before it slides, dry friction yields like a spring (bristles bend).

    dz/dt = (v - |v| z) / s,   F = F_f (z + tau dz/dt),   -1 <= z <= 1

The LuGre model (tau = sigma_1 / sigma_0), without damping tau Dahl's. z is the share of the dry
friction F_f that is reached, s the distance over which it builds up; sliding further than a few s
gives the full friction, and towards s = 0 it sticks. On the rod, or on the pump: there the distance
is that of the piston which the pump's turning would move, x = D_p theta / A, so that one parameter
serves both. Bristles start relaxed where there is rest at the first sample, bent to the end where
there is motion. They only take energy: v dz/dt >= 0.

Source: Dahl, AIAA J. 14 (1976) 1675, doi:10.2514/3.61511; Canudas de Wit, Olsson, Astrom,
Lischinsky, IEEE Trans. Automatic Control 40 (1995) 419, doi:10.1109/9.376053.
"""

from __future__ import annotations

import math

from eha_bench.plants.compiled import njit
from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice

_ROD, _PUMP = 0.0, 1.0
# slower than this the rod or piston counts as at rest at the first sample, m/s
_AT_REST = 5e-3


@njit()
def _bent(bristle: float, v: float, h: float, distance: float) -> float:
    end = 1.0 if v > 0.0 else -1.0
    return end + (bristle - end) * math.exp(-abs(v) * h / distance)


@njit()
def _share(v: float) -> float:
    return min(1.0, max(-1.0, v / _AT_REST))


def bend(bristle: float, v: float, h: float, distance: float) -> float:
    """Return how far the rod's bristles are bent after a time h, -1 ... 1 (exact, constant v)."""
    return _bent(bristle, v, h, distance)


def at_first(v: float) -> float:
    """Return how far the rod's bristles are bent at the first sample."""
    return _share(v)


def turn(
    winding: float,
    omega: float,
    h: float,
    distance: float,
    pump_displacement: float,
    piston_area_a: float,
) -> float:
    """Return how far the pump's bristles are bent after a time h, -1 ... 1."""
    return _bent(winding, pump_displacement / piston_area_a * omega, h, distance)


def turning_at_first(omega: float, pump_displacement: float, piston_area_a: float) -> float:
    """Return how far the pump's bristles are bent at the first sample."""
    return _share(pump_displacement / piston_area_a * omega)


def rod_sticks(level: float, part: float) -> float:
    """Return the part of the rod's dry friction that sticks: none where bristles hold it, N."""
    return level if part == _PUMP else 0.0


@njit()
def _pull(z: float, v: float, distance: float, damping_time: float) -> float:
    """Return the share of the dry friction that bent and bending bristles put up."""
    return z + damping_time * (v - abs(v) * z) / distance


def rod_pull(
    force: float,
    level: float,
    v: float,
    bristle: float,
    distance: float,
    damping_time: float,
    part: float,
) -> float:
    """Return the force on the rod less the pull of its bristles, N."""
    if part == _PUMP:
        return force
    return force - level * _pull(bristle, v, distance, damping_time)


def pump_sticks(level: float, part: float) -> float:
    """Return the part of the pump's dry friction that sticks, N*m."""
    return 0.0 if part == _PUMP else level


def pump_pull(
    torque: float,
    level: float,
    omega: float,
    winding: float,
    pump_displacement: float,
    piston_area_a: float,
    distance: float,
    damping_time: float,
    part: float,
) -> float:
    """Return the torque on the shaft less the pull of its bristles, N*m."""
    if part != _PUMP:
        return torque
    v = pump_displacement / piston_area_a * omega
    return torque - level * _pull(winding, v, distance, damping_time)


def drive_sticks(level: float) -> float:
    """Return the part of the drive's dry friction that sticks: none, N."""
    return 0.0


def drive_pull(
    force: float, level: float, v: float, bristle: float, distance: float, damping_time: float
) -> float:
    """Return the force on the carriage less the pull of the bristles, N."""
    return force - level * _pull(bristle, v, distance, damping_time)


EFFECT = Effect(
    id="presliding_friction",
    summary="Before it slides, dry friction yields like a spring.",
    parameters=(
        Parameter("distance", "m", 2e-4, 0.0, 0.1, "s"),
        choice("part", ("rod", "pump"), "whose friction yields"),
        Parameter("damping_time", "s", 5e-4, 0.0, 0.1, "tau", "of the bristles; 0: Dahl"),
    ),
    actions={
        "eha_knee": Action(
            Equation.FORCE,
            {
                "rod_sticks": rod_sticks,
                "rod_force": rod_pull,
                "pump_sticks": pump_sticks,
                "shaft_torque": pump_pull,
            },
            chosen_by="part",
            equations={"pump": Equation.TORQUE},
            advance={"bristle": bend, "winding": turn},
            start={"bristle": at_first, "winding": turning_at_first},
        ),
        "linear_drive": Action(
            Equation.FORCE,
            {"rod_sticks": drive_sticks, "rod_force": drive_pull},
            choices={"part": ("rod",)},
            advance={"bristle": bend},
            start={"bristle": at_first},
        ),
    },
    states=("bristle", "winding"),
    source="Dahl, AIAA J. 14 (1976) 1675, doi:10.2514/3.61511",
    separate="push the resting rod to and fro with less force than its friction, and log position",
    starts=(
        {"distance": 2e-5},
        {"distance": 2e-3},
        {"distance": 1e-5, "part": _PUMP},
        {"distance": 1e-4, "part": _PUMP},
    ),
    order=2,
)
