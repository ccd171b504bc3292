"""Both pressure sensors follow the chamber pressures with a first-order lag.

    tau dp_read/dt = p - p_read

A sensor at the end of a thin line, or the low-pass filter of its amplifier. At the first sample
the reading is taken to have settled.

Source: Doebelin, Measurement Systems, 5th ed., McGraw-Hill 2003 (first-order instruments).
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter


def follow_a(read_a: float, p_a: float, h: float, time_constant: float) -> float:
    """Return the reading of chamber A after a time h, Pa."""
    return p_a + (read_a - p_a) * math.exp(-h / time_constant)


def follow_b(read_b: float, p_b: float, h: float, time_constant: float) -> float:
    """Return the reading of chamber B after a time h, Pa."""
    return p_b + (read_b - p_b) * math.exp(-h / time_constant)


def reading_a(value: float, read_a: float) -> float:
    """Return what the sensor of chamber A reads, Pa."""
    return read_a


def reading_b(value: float, read_b: float) -> float:
    """Return what the sensor of chamber B reads, Pa."""
    return read_b


def settled_a(p_a: float) -> float:
    """Return the reading of chamber A at the first sample, Pa."""
    return p_a


def settled_b(p_b: float) -> float:
    """Return the reading of chamber B at the first sample, Pa."""
    return p_b


EFFECT = Effect(
    id="pressure_sensor_lag",
    summary="The pressure sensors follow with a first-order lag.",
    parameters=(Parameter("time_constant", "s", 3e-3, 0.0, 1.0, "tau_p"),),
    actions={
        "eha_knee": Action(
            Equation.MEASUREMENT,
            {"measured_pressure_a": reading_a, "measured_pressure_b": reading_b},
        )
    },
    states=("read_a", "read_b"),
    advance={"read_a": follow_a, "read_b": follow_b},
    start={"read_a": settled_a, "read_b": settled_b},
    source="Doebelin, Measurement Systems, 5th ed., McGraw-Hill 2003",
    separate=(
        "steps with the piston locked and motor speed logged: with a lag of the sensor the speed "
        "reacts to the true pressure before the reading shows it"
    ),
)
