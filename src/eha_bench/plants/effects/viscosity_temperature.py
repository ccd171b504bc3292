"""The oil's viscosity follows its logged temperature.

    B(T) = B_0 exp(-k (T - T_0)),   L(T) = L_0 exp(k (T - T_0))

Reynolds' law, a straight line through Vogel's over the tens of kelvin of a test. Needs the channel
`oil_temperature`; without it the effect does nothing.

Source: Merritt, Hydraulic Control Systems, Wiley 1967; Vogel, Phys. Z. 22 (1921) 645.
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter


def thinner(
    coefficient: float,
    oil_temperature: float,
    temperature_coefficient: float,
    reference_temperature: float,
) -> float:
    """Return a viscous friction coefficient at the oil's temperature, in its own unit."""
    if math.isnan(oil_temperature):
        return coefficient
    return coefficient * math.exp(
        -temperature_coefficient * (oil_temperature - reference_temperature)
    )


def leakier(
    value: float,
    oil_temperature: float,
    temperature_coefficient: float,
    reference_temperature: float,
) -> float:
    """Return a laminar flow, or its conductance, at the oil's temperature."""
    if math.isnan(oil_temperature):
        return value
    return value * math.exp(temperature_coefficient * (oil_temperature - reference_temperature))


EFFECT = Effect(
    id="viscosity_temperature",
    summary="Viscous friction and leakage follow the logged oil temperature.",
    parameters=(
        Parameter("temperature_coefficient", "1/K", 0.02, 0.0, 1.0, "k"),
        Parameter(
            "reference_temperature", "K", 313.15, 200.0, 500.0, "T_0",
            "40 degrees Celsius, where ISO 3448 grades oils", searched=False,
        ),
    ),
    actions={
        "oil": Action(
            {"turning": thinner, "sliding": thinner, "leakage": leakier, "leakage_slope": leakier}
        )
    },
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
    separate="log oil_temperature, and repeat the same motion at two temperatures",
)  # fmt: skip
