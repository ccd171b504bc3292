"""A position sensor follows with a first-order lag.

    tau dx_read/dt = x - x_read

The low-pass filter behind a potentiometer, a transformer (LVDT) or a resolver. The reading is kept
as how far it is behind, b = x - x_read:

    db/dt = v - b / tau

At the first sample it is taken to be behind as at that speed, tau v; how far that may be off where
the speed changes is not known.

Source: Doebelin, Measurement Systems, 5th ed., McGraw-Hill 2003 (first-order instruments).
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter


def trail(behind: float, speed: float, h: float, time_constant: float) -> float:
    """Return how far the reading is behind after a time h at a speed, m (or rad)."""
    kept = math.exp(-h / time_constant)
    return behind * kept + speed * time_constant * (1.0 - kept)


def reading(value: float, behind: float) -> float:
    """Return what the sensor reads, m (or rad)."""
    return value - behind


def at_first(speed: float, time_constant: float) -> float:
    """Return how far the reading is behind at a steady speed, m (or rad)."""
    return speed * time_constant


def reach(time_constant: float, acceleration: float) -> float:
    """Return how far that may be off where the speed changes, m (or rad)."""
    return time_constant * time_constant * acceleration


EFFECT = Effect(
    id="position_sensor_lag",
    summary="A position sensor follows with a first-order lag.",
    parameters=(Parameter("time_constant", "s", 5e-3, 0.0, 1.0, "tau_x"),),
    actions={
        "position_sensor": Action(
            {"reading": reading},
            Equation.MEASUREMENT,
            advance={"behind": trail},
            start={"behind": at_first},
            unread={"behind": reach},
        )
    },
    states=("behind",),
    relative=True,
    source="Doebelin, Measurement Systems, 5th ed., McGraw-Hill 2003",
    separate="move it fast and read a second, faster sensor of the same position with it",
)
