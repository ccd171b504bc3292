"""Pressure sensors follow the pressures with a first-order lag.

    tau dp_read/dt = p - p_read

A sensor at the end of a thin line, or the low-pass filter of its amplifier. At the first sample
the reading is taken to have settled. Sensors of one kind are alike; one of them may be behind a
line of its own (`at`).

Source: Doebelin, Measurement Systems, 5th ed., McGraw-Hill 2003 (first-order instruments).
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter


def follow(read: float, pressure: float, h: float, time_constant: float) -> float:
    """Return the reading after a time h, Pa."""
    return pressure + (read - pressure) * math.exp(-h / time_constant)


def reading(value: float, read: float) -> float:
    """Return what the sensor reads, Pa."""
    return read


def reading_at_first(pressure: float) -> float:
    """Return the reading at the first sample, Pa."""
    return pressure


EFFECT = Effect(
    id="pressure_sensor_lag",
    summary="The pressure sensors follow with a first-order lag.",
    parameters=(Parameter("time_constant", "s", 3e-3, 0.0, 1.0, "tau_p"),),
    actions={
        "pressure_sensor": Action(
            {"reading": reading}, advance={"read": follow}, start={"read": reading_at_first}
        )
    },
    states=("read",),
    together=True,
    source="Doebelin, Measurement Systems, 5th ed., McGraw-Hill 2003",
    separate=(
        "steps with the piston locked and motor speed logged: with a lag of the sensor the speed "
        "reacts to the true pressure before the reading shows it"
    ),
)
