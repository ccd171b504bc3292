"""The motor's current follows the command with a first-order lag.

In the drive, what the command asks for comes late: the closed current loop of a servo drive, seen
from outside; the torque uses i, and the current sensor reads it.

    tau di/dt = i_command - i

In the winding of a motor that a voltage drives, the current comes late behind what the voltage
leaves over the back-EMF, by its inductance:

    tau di/dt = (u - K_E w) / R - i,    tau = L / R

At low speed, and where the voltage is smooth, both are the same.

Source: Leonhard, Control of Electrical Drives, 3rd ed., Springer 2001 (equivalent
time constant of the inner current loop; armature circuit of the DC machine).
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_WINDING = 1.0


def follow(lagging: float, asked: float, h: float, time_constant: float) -> float:
    """Return the lagging current after a time h under a constant demand, A (exact)."""
    return asked + (lagging - asked) * math.exp(-h / time_constant)


def flowing(current: float, lagging: float) -> float:
    """Return the current that flows instead of the demanded one, A."""
    return lagging


def at_first(current: float) -> float:
    """Return the lagging current at the first sample: what is logged there, A."""
    return current


def follow_either(
    lagging: float, asked: float, winding: float, h: float, time_constant: float, place: float
) -> float:
    """Return what lags after a time h: the drive's output or the winding's current (exact)."""
    end = winding if place == _WINDING else asked
    return end + (lagging - end) * math.exp(-h / time_constant)


def drive_output(current: float, lagging: float, place: float) -> float:
    """Return what the drive puts out instead of what is demanded."""
    return current if place == _WINDING else lagging


def winding_torque(torque: float, lagging: float, torque_constant: float, place: float) -> float:
    """Return the torque of the current in the winding, N*m."""
    return torque_constant * lagging if place == _WINDING else torque


def current_reading(current: float, lagging: float, place: float) -> float:
    """Return what a sensor of the winding's current reads, A."""
    return lagging if place == _WINDING else current


def either_at_first(current: float, winding: float, place: float) -> float:
    """Return what lags at the first sample, where it is in balance."""
    return winding if place == _WINDING else current


EFFECT = Effect(
    id="current_lag",
    summary="The current follows its command with a first-order lag.",
    parameters=(
        Parameter("time_constant", "s", 2e-3, 0.0, 1.0, "tau_i"),
        choice(
            "place",
            ("drive", "winding"),
            "what lags: what the drive puts out, or the current in a winding that a voltage drives",
            of_role="voltage_drive",
        ),
    ),
    actions={
        "voltage_drive": Action(
            {"drive": drive_output, "torque": winding_torque, "read_current": current_reading},
            advance={"lagging": follow_either},
            start={"lagging": either_at_first},
        ),
        "motor_drive": Action(
            {"drive": flowing},
            advance={"lagging": follow},
            start={"lagging": at_first},
        ),
    },
    states=("lagging",),
    source="Leonhard, Control of Electrical Drives, 3rd ed., Springer 2001",
    separate=(
        "log the motor current at 1 kHz or more during steps: a lag bends the current, a delay "
        "shifts it, and compressible oil leaves it untouched"
    ),
)
