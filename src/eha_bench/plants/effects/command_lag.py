"""What is commanded of a plant that is written in Python follows with a first-order lag.

    tau du/dt = u_command - u

What acts over a step is the mean of u over it. In a plant.yaml a motor's drive has `current_lag`
and a valve `valve_lag`.

Source: Leonhard, Control of Electrical Drives, 3rd ed., Springer 2001 (equivalent time constant of
an inner loop).
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter


def mean(value: float, lagging: float, h: float, time_constant: float) -> float:
    """Return the mean of what acts over a time h under a constant command."""
    share = (1.0 - math.exp(-h / time_constant)) * time_constant / h
    return value + (lagging - value) * share


def follow(lagging: float, asked: float, h: float, time_constant: float) -> float:
    """Return what acts after a time h under a constant command (exact)."""
    return asked + (lagging - asked) * math.exp(-h / time_constant)


def at_first(current: float) -> float:
    """Return what acts at the first sample: what was commanded just before."""
    return current


EFFECT = Effect(
    id="command_lag",
    summary="What is commanded follows with a first-order lag.",
    parameters=(Parameter("time_constant", "s", 5e-3, 0.0, 10.0, "tau"),),
    actions={
        "command_path": Action(
            {"command": mean},
            Equation.ACTUATION,
            advance={"lagging": follow},
            start={"lagging": at_first},
        )
    },
    states=("lagging",),
    source="Leonhard, Control of Electrical Drives, 3rd ed., Springer 2001",
    separate="log what the drive gives during steps: a lag bends it, a delay shifts it",
    order=2,
)
