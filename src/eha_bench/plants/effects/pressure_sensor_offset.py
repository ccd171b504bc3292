"""A pressure sensor reads a constant too much.

    p_read = p + offset

Source: IEC 61298-2:2008 (zero offset of measuring devices).
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice

_A = 0.0


def reading(value: float, offset: float) -> float:
    """Return what the sensor reads, Pa."""
    return value + offset


def true(pressure: float, offset: float) -> float:
    """Return the pressure behind a reading, Pa."""
    return pressure - offset


def true_difference(difference: float, offset: float, sensor: float) -> float:
    """Return the pressure difference behind two readings, Pa."""
    return difference - offset if sensor == _A else difference + offset


EFFECT = Effect(
    id="pressure_sensor_offset",
    summary="A pressure sensor reads a constant too much (or too little).",
    parameters=(
        Parameter("offset", "Pa", 0.2e6, -1e7, 1e7),
        choice("sensor", ("a", "b"), "of a difference of two", of_role="holding"),
    ),
    actions={
        "pressure_sensor": Action({"reading": reading, "initial": true}),
        "holding": Action({"true_difference": true_difference}, Equation.MEASUREMENT),
    },
    together=True,
    source="IEC 61298-2:2008, zero offset of measuring devices",
    separate="read all sensors with the ports connected and the motor off: they must agree",
    starts=({"offset": -0.2e6},),
    order=1,
)
