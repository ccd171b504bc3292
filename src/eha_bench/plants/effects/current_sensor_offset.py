"""The current sensor reads a constant too much.

    i_read = i + offset

Source: IEC 61298-2:2008 (zero offset of measuring devices).
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter


def reading(value: float, offset: float) -> float:
    """Return what the current sensor reads, A."""
    return value + offset


EFFECT = Effect(
    id="current_sensor_offset",
    summary="The current sensor reads a constant too much (or too little).",
    parameters=(
        Parameter("offset", "A", 0.2, -10.0, 10.0, source="1 % of a sensor's range of 20 A"),
    ),
    actions={"holding": Action({"measured_current": reading}, Equation.MEASUREMENT)},
    source="IEC 61298-2:2008, zero offset of measuring devices",
    separate="read the current with the motor off: it must be nothing",
)
