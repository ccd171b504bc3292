"""The motor's current follows the command with a first-order lag.

    tau di/dt = i_command - i

The closed current loop of a servo drive, seen from outside; the torque uses i, and the current
sensor reads it.

Source: Leonhard, Control of Electrical Drives, 3rd ed., Springer 2001 (equivalent
time constant of the inner current loop).
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter


def follow(lagging: float, asked: float, h: float, time_constant: float) -> float:
    """Return the lagging current after a time h under a constant demand, A (exact)."""
    return asked + (lagging - asked) * math.exp(-h / time_constant)


def flowing(current: float, lagging: float) -> float:
    """Return the current that flows instead of the demanded one, A."""
    return lagging


def at_first(current: float) -> float:
    """Return the lagging current at the first sample: what is logged there, A."""
    return current


EFFECT = Effect(
    id="current_lag",
    summary="The current follows its command with a first-order lag.",
    parameters=(Parameter("time_constant", "s", 2e-3, 0.0, 1.0, "tau_i"),),
    actions={
        "motor_drive": Action(
            {"drive": flowing}, advance={"lagging": follow}, start={"lagging": at_first}
        )
    },
    states=("lagging",),
    source="Leonhard, Control of Electrical Drives, 3rd ed., Springer 2001",
    separate=(
        "log the motor current at 1 kHz or more during steps: a lag bends the current, a delay "
        "shifts it, and compressible oil leaves it untouched"
    ),
)
