"""A pressure sensor reads a constant too much.

    p_read = p + offset

Source: IEC 61298-2:2008 (zero offset of measuring devices).
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice

_A, _B, _BOTH = 0.0, 1.0, 2.0


def reading_a(value: float, offset: float, sensor: float) -> float:
    """Return what the sensor of chamber A reads, Pa."""
    return value if sensor == _B else value + offset


def reading_b(value: float, offset: float, sensor: float) -> float:
    """Return what the sensor of chamber B reads, Pa."""
    return value if sensor == _A else value + offset


def true_a(pressure: float, offset: float, sensor: float) -> float:
    """Return the pressure in chamber A behind a reading, Pa."""
    return pressure if sensor == _B else pressure - offset


def true_b(pressure: float, offset: float, sensor: float) -> float:
    """Return the pressure in chamber B behind a reading, Pa."""
    return pressure if sensor == _A else pressure - offset


def true_difference(difference: float, offset: float, sensor: float) -> float:
    """Return the pressure difference behind two readings, Pa."""
    if sensor == _BOTH:
        return difference
    return difference - offset if sensor == _A else difference + offset


EFFECT = Effect(
    id="pressure_sensor_offset",
    summary="A pressure sensor reads a constant too much (or too little).",
    parameters=(
        Parameter("offset", "Pa", 0.2e6, -1e7, 1e7),
        choice("sensor", ("a", "b", "both")),
    ),
    actions={
        "eha_knee": Action(
            Equation.MEASUREMENT,
            {
                "measured_pressure_a": reading_a,
                "measured_pressure_b": reading_b,
                "initial_pressure_a": true_a,
                "initial_pressure_b": true_b,
            },
        ),
        "pump_hold": Action(
            Equation.MEASUREMENT,
            {"true_difference": true_difference},
            choices={"sensor": ("a", "b")},
        ),
    },
    source="IEC 61298-2:2008, zero offset of measuring devices",
    separate="read both sensors with the bypass open and the motor off: they must agree",
    starts=(
        {"offset": -0.2e6, "sensor": _A},
        {"offset": 0.2e6, "sensor": _B},
        {"offset": -0.2e6, "sensor": _B},
        {"offset": 0.2e6, "sensor": _BOTH},
    ),
    order=1,
)
