"""The valve follows its command with a first-order lag, beside what is declared of its spool.

    tau du/dt = u_command - u

The amplifier's current, or a pilot stage.

Source: Jelali, Kroll, Hydraulic Servo-systems, Springer 2003, section 4.3 (valve dynamics).
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter


def follow(lagging: float, asked: float, h: float, time_constant: float) -> float:
    """Return the lagging command after a time h (exact), in the command's unit."""
    return asked + (lagging - asked) * math.exp(-h / time_constant)


def acting(asked: float, lagging: float) -> float:
    """Return the command that acts instead of the one that was given."""
    return lagging


def at_first(current: float) -> float:
    """Return the lagging command at the first sample: what acts there."""
    return current


EFFECT = Effect(
    id="valve_lag",
    summary="The valve follows its command with a first-order lag.",
    parameters=(Parameter("time_constant", "s", 3e-3, 0.0, 1.0, "tau_v"),),
    actions={
        "valve_drive": Action(
            {"drive": acting}, advance={"lagging": follow}, start={"lagging": at_first}
        )
    },
    states=("lagging",),
    source="Jelali, Kroll, Hydraulic Servo-systems, Springer 2003",
    separate="log the spool's position during steps: a lag bends it, a delay shifts it",
    starts=({"time_constant": 1e-3}, {"time_constant": 10e-3}),
)
