"""Oil leaks from the chambers to the case drain.

    q_a -= C (p_a - p_d),   q_b -= C (p_b - p_d)

Source: Merritt, Hydraulic Control Systems, Wiley 1967 (external leakage of pumps);
Jelali, Kroll, Hydraulic Servo-systems, Springer 2003.
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice

_BOTH, _A, _B = 0.0, 1.0, 2.0


def from_a(
    flow: float, p_a: float, leakage_coefficient: float, chamber: float, drain_pressure: float
) -> float:
    """Return the flow into chamber A less what drains, m^3/s."""
    return flow if chamber == _B else flow - leakage_coefficient * (p_a - drain_pressure)


def from_b(
    flow: float, p_b: float, leakage_coefficient: float, chamber: float, drain_pressure: float
) -> float:
    """Return the flow into chamber B less what drains, m^3/s."""
    return flow if chamber == _A else flow - leakage_coefficient * (p_b - drain_pressure)


def slope_a(value: float, leakage_coefficient: float, chamber: float) -> float:
    """Return the conductance from chamber A to the drain, m^3/(s*Pa)."""
    return value if chamber == _B else value + leakage_coefficient


def slope_b(value: float, leakage_coefficient: float, chamber: float) -> float:
    """Return the conductance from chamber B to the drain, m^3/(s*Pa)."""
    return value if chamber == _A else value + leakage_coefficient


EFFECT = Effect(
    id="external_leakage",
    summary="Oil leaks from the chambers to the case drain.",
    parameters=(
        Parameter("leakage_coefficient", "m^3/(s*Pa)", 3e-14, 0.0, 1e-8, "C"),
        choice("chamber", ("both", "a", "b"), "which chamber drains"),
        Parameter(
            "drain_pressure", "Pa", 0.0, 0.0, 1e7, "p_d", "the drain is open", searched=False
        ),
    ),
    actions={
        "eha_knee": Action(
            Equation.FLOW,
            {
                "chamber_flow_a": from_a,
                "chamber_flow_b": from_b,
                "conductance_a": slope_a,
                "conductance_b": slope_b,
            },
        )
    },
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
    separate=(
        "raise both pressures together (bypass open, charged) and watch their sum fall; air in the "
        "oil leaves the sum alone"
    ),
    starts=({"chamber": _A}, {"chamber": _B}),
)
