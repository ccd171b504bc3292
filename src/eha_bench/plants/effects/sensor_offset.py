"""A sensor of a plant that is written in Python reads a constant too much.

    y_read = y + offset

Such a plant's balances are its own code, so what may act on it is what acts on its signals. In a
plant.yaml pressures have `pressure_sensor_offset`, and the balances show what else is off zero.

Source: IEC 61298-2:2008 (zero offset of measuring devices).
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter


def reading(value: float, offset: float) -> float:
    """Return what the sensor reads, in its unit."""
    return value + offset


def true(value: float, offset: float) -> float:
    """Return what is behind a reading, in its unit."""
    return value - offset


EFFECT = Effect(
    id="sensor_offset",
    summary="A sensor reads a constant too much (or too little).",
    parameters=(Parameter("offset", "{reading}", 0.02, -1e12, 1e12),),
    actions={
        "sensor": Action({"reading": reading, "initial": true}, Equation.MEASUREMENT),
    },
    source="IEC 61298-2:2008, zero offset of measuring devices",
    separate="read the sensor where its value is known: at a stop, or against a second one",
    starts=({"offset": -0.02},),
    order=1,
)
