"""Check valves that let oil from a charged accumulator into a chamber whose pressure is low.

    q_a += G max(0, p_c - p_a),   q_b += G max(0, p_c - p_b)

A valve only lets oil in, so the low side stays near the charge pressure instead of falling below
vacuum, and from then on only one chamber is compressed.

Source: Merritt, Hydraulic Control Systems (1967); the paper, Section 2.
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter


def flow_a(flow: float, p_a: float, charge_pressure: float, valve_conductance: float) -> float:
    """Flow into chamber A with what the valve lets in, m^3/s."""
    return flow + valve_conductance * max(0.0, charge_pressure - p_a)


def flow_b(flow: float, p_b: float, charge_pressure: float, valve_conductance: float) -> float:
    """Flow into chamber B with what the valve lets in, m^3/s."""
    return flow + valve_conductance * max(0.0, charge_pressure - p_b)


def slope_a(value: float, p_a: float, charge_pressure: float, valve_conductance: float) -> float:
    """Conductance to chamber A while its valve is open, m^3/(s*Pa)."""
    return value + (valve_conductance if p_a < charge_pressure else 0.0)


def slope_b(value: float, p_b: float, charge_pressure: float, valve_conductance: float) -> float:
    """Conductance to chamber B while its valve is open, m^3/(s*Pa)."""
    return value + (valve_conductance if p_b < charge_pressure else 0.0)


EFFECT = Effect(
    id="anti_cavitation",
    summary="Check valves keep the low-pressure side at the accumulator's charge pressure.",
    parameters=(
        Parameter("valve_conductance", "m^3/(s*Pa)", 6e-10, 0.0, 1e-7, "G"),
        Parameter("charge_pressure", "Pa", 0.6e6, 0.0, 1e7, "p_c"),
    ),
    actions={
        "eha_knee": Action(
            Equation.FLOW,
            {
                "chamber_flow_a": flow_a,
                "chamber_flow_b": flow_b,
                "conductance_a": slope_a,
                "conductance_b": slope_b,
            },
        )
    },
    source="Merritt, Hydraulic Control Systems, Wiley 1967; the paper, Section 2",
    separate="log both chamber pressures: the low one stops falling at the charge pressure",
)
