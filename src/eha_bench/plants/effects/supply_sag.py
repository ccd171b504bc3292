"""A supply gives way as oil is drawn from it.

    tau ds/dt = R q - s,    p = p_0 - s

A source of resistance R behind which a volume or an accumulator evens out, in a time tau, what is
drawn: its pressure falls with the flow q, and comes back when nothing is drawn.

Source: Merritt, Hydraulic Control Systems, Wiley 1967 (supplies); Findeisen, Helduser,
Ölhydraulik, 6th ed., Springer 2015.
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter


def sagging_pressure(pressure: float, sag: float) -> float:
    """Return the pressure of the supply, Pa."""
    return pressure - sag


def follow(sag: float, drawn: float, h: float, resistance: float, recovery_time: float) -> float:
    """Return how far the supply has fallen after a time h, Pa."""
    end = resistance * drawn
    return end + (sag - end) * math.exp(-h / recovery_time)


def at_first() -> float:
    """Return how far the supply has fallen at the first sample, Pa."""
    return 0.0


EFFECT = Effect(
    id="supply_sag",
    summary="The supply's pressure falls as oil is drawn from it.",
    parameters=(
        Parameter("resistance", "Pa*s/m^3", 5e9, 0.0, 1e13, "R"),
        Parameter("recovery_time", "s", 0.1, 1e-3, 100.0, "tau"),
    ),
    actions={
        "supply": Action(
            {"pressure": sagging_pressure}, advance={"sag": follow}, start={"sag": at_first}
        )
    },
    states=("sag",),
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
    separate="move fast for seconds, then rest, and log the supply's pressure at the valve",
    starts=({"recovery_time": 0.02}, {"recovery_time": 1.0}, {"resistance": 5e8}),
)
