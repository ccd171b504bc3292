"""A sensor of a plant that is written in Python follows with a first-order lag.

    tau dy_read/dt = y - y_read

At the first sample the reading is taken to have settled.

Source: Doebelin, Measurement Systems, 5th ed., McGraw-Hill 2003 (first-order instruments).
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter


def follow(read: float, before: float, value: float, h: float, time_constant: float) -> float:
    """Return the reading after a time h over which the value went on from `before`."""
    slope = (value - before) / h
    late = slope * time_constant
    return value - late + (read - before + late) * math.exp(-h / time_constant)


def reading(value: float, read: float) -> float:
    """Return what the sensor reads, in its unit."""
    return read


def reading_at_first(value: float) -> float:
    """Return the reading at the first sample, in its unit."""
    return value


EFFECT = Effect(
    id="sensor_lag",
    summary="A sensor follows with a first-order lag.",
    parameters=(Parameter("time_constant", "s", 5e-3, 0.0, 10.0, "tau"),),
    actions={
        "sensor": Action(
            {"reading": reading},
            Equation.MEASUREMENT,
            advance={"read": follow},
            start={"read": reading_at_first},
        )
    },
    states=("read",),
    source="Doebelin, Measurement Systems, 5th ed., McGraw-Hill 2003",
    separate="move it fast and read a second, faster sensor of the same quantity with it",
)
