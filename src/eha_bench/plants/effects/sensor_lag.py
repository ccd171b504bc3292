"""A sensor follows with a first-order lag.

    tau dy_read/dt = y - y_read

At the first sample the reading is taken to have settled; where a speed's is followed from the midst
of a motion, how far it is behind is not known. In a plant.yaml it is a speed's: drives
filter the differences of an encoder's counts before they report them. Pressures there have
`pressure_sensor_lag`; any signal of a plant that is written in Python has it.

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


def fall_behind(behind: float, last: float, speed: float, h: float, time_constant: float) -> float:
    """Return how far the reading of a speed is behind it after a time h, in its unit.

    A kernel moves effects on by halves of a step, and what moves by whole ones: a change shows in
    the second half, and is one over both.
    """
    kept = math.exp(-h / time_constant)
    slope = (speed - last) / (2.0 * h)
    return behind * kept + slope * (1.0 - kept * kept) * time_constant


def passed(speed: float) -> float:
    """Return the speed that a reading follows from here on, in its unit."""
    return speed


def reading_behind(value: float, behind: float) -> float:
    """Return what the sensor of a speed reads, in its unit."""
    return value - behind


def level() -> float:
    """Return how far a reading is behind at the first sample, in its unit."""
    return 0.0


def reach(time_constant: float, acceleration: float) -> float:
    """Return how far a reading may be behind in the midst of a motion, in its unit."""
    return time_constant * acceleration


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
        ),
        "speed_sensor": Action(
            {"reading": reading_behind},
            advance={"behind": fall_behind, "last": passed},
            start={"behind": level, "last": passed},
            unread={"behind": reach},
        ),
    },
    states=("read", "behind", "last"),
    source="Doebelin, Measurement Systems, 5th ed., McGraw-Hill 2003",
    separate="move it fast and read a second, faster sensor of the same quantity with it",
)
