"""Check valves that let oil from a charged accumulator into a chamber whose pressure is low.

    q += G max(0, p_c - p)

A valve only lets oil in, so the low side stays near the charge pressure instead of falling below
vacuum, and from then on only one chamber is compressed.

Source: Merritt, Hydraulic Control Systems (1967); Yang et al. 2023, Section 2.
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter


def let_in(flow: float, pressure: float, charge_pressure: float, valve_conductance: float) -> float:
    """Return the flow into a chamber with what the valve lets in, m^3/s."""
    return flow + valve_conductance * max(0.0, charge_pressure - pressure)


def slope(value: float, pressure: float, charge_pressure: float, valve_conductance: float) -> float:
    """Return the conductance to a chamber while its valve is open, m^3/(s*Pa)."""
    return value + (valve_conductance if pressure < charge_pressure else 0.0)


EFFECT = Effect(
    id="anti_cavitation",
    summary="Check valves keep the low-pressure side at the accumulator's charge pressure.",
    parameters=(
        Parameter("valve_conductance", "m^3/(s*Pa)", 6e-10, 0.0, 1e-7, "G"),
        Parameter("charge_pressure", "Pa", 0.6e6, 0.0, 1e7, "p_c"),
    ),
    actions={"chamber": Action({"inflow": let_in, "ground": slope}, charges="charge_pressure")},
    only_together=True,
    source="Merritt, Hydraulic Control Systems, Wiley 1967; Yang et al. 2023, Section 2",
    separate="log both chamber pressures: the low one stops falling at the charge pressure",
)
