"""Oil leaks from a chamber to the case drain, or to where the machine keeps its low pressure.

    q -= C (p - p_d)

with p_d a constant (`drain: open`), or the pressure of the tank or reservoir (`drain: reservoir`).

Source: Merritt, Hydraulic Control Systems, Wiley 1967 (external leakage of pumps);
Jelali, Kroll, Hydraulic Servo-systems, Springer 2003.
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_OPEN = 0.0


def leak(
    flow: float,
    pressure: float,
    low_pressure: float,
    leakage_coefficient: float,
    drain_pressure: float,
    drain: float,
) -> float:
    """Return the flow into a chamber less what drains, m^3/s."""
    into = drain_pressure if drain == _OPEN else low_pressure
    return flow - leakage_coefficient * (pressure - into)


def slope(value: float, leakage_coefficient: float) -> float:
    """Return the conductance from a chamber to the drain, m^3/(s*Pa)."""
    return value + leakage_coefficient


EFFECT = Effect(
    id="external_leakage",
    summary="Oil leaks from the chambers to the case drain.",
    parameters=(
        Parameter("leakage_coefficient", "m^3/(s*Pa)", 3e-14, 0.0, 1e-8, "C"),
        choice("drain", ("open", "reservoir"), "where it drains to"),
        Parameter(
            "drain_pressure", "Pa", 0.0, 0.0, 1e7, "p_d", "the drain is open", searched=False
        ),
    ),
    actions={"chamber": Action({"inflow": leak, "ground": slope})},
    together=True,
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
    separate=(
        "raise both pressures together and watch their sum fall; air in the oil leaves the sum "
        "alone"
    ),
    starts=({"leakage_coefficient": 1e-12},),
)
