"""Oil leaks from a chamber to the case drain, or to where the machine keeps its low pressure.

    q -= C (p - p_d)
    q -= C d ((d^2 + p_t^2) / p_s^2)^((n - 1) / 2),   d = p - p_d,   p_s = 10 MPa   (law: power)

with p_d a constant (`drain: open`), or the pressure of the tank or reservoir (`drain: reservoir`).
A gap that the pressure widens leaks with n above 1, one that is half an orifice with n below; C is
the conductance at a drop of 10 MPa. Below p_t = 10 kPa every flow is laminar.

Source: Merritt, Hydraulic Control Systems, Wiley 1967 (external leakage of pumps);
Jelali, Kroll, Hydraulic Servo-systems, Springer 2003.
"""

from __future__ import annotations

from typing import NamedTuple

from eha_bench.plants.compiled import njit
from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.gap_conductance import gap_conductance
from eha_bench.plants.parameter import Parameter, choice

_OPEN = 0.0
_LAMINAR, _POWER = 0.0, 1.0


class Leak(NamedTuple):
    """The effect's own parameters."""

    leakage_coefficient: float
    drain: float
    drain_pressure: float
    law: float
    exponent: float


@njit()
def _drop(pressure: float, low_pressure: float, own: Leak) -> float:
    """Return the pressure over the gap, Pa."""
    return pressure - (own.drain_pressure if own.drain == _OPEN else low_pressure)


@njit()
def _conductance(drop: float, own: Leak) -> float:
    """Return the flow over the drop, m^3/(s*Pa)."""
    if own.law == _LAMINAR:
        return own.leakage_coefficient
    return gap_conductance(drop, own.leakage_coefficient, own.exponent)


def leak(flow: float, pressure: float, low_pressure: float, own: Leak) -> float:
    """Return the flow into a chamber less what drains, m^3/s."""
    drop = _drop(pressure, low_pressure, own)
    return flow - _conductance(drop, own) * drop


def slope(value: float, pressure: float, low_pressure: float, own: Leak) -> float:
    """Return the conductance from a chamber to the drain, never less than the true slope."""
    steeper = max(1.0, own.exponent) if own.law == _POWER else 1.0
    return value + steeper * _conductance(_drop(pressure, low_pressure, own), own)


EFFECT = Effect(
    id="external_leakage",
    summary="Oil leaks from the chambers to the case drain.",
    parameters=(
        Parameter("leakage_coefficient", "m^3/(s*Pa)", 3e-14, 0.0, 1e-8, "C"),
        choice("drain", ("open", "reservoir"), "where it drains to"),
        Parameter(
            "drain_pressure", "Pa", 0.0, 0.0, 1e7, "p_d", "the drain is open", searched=False
        ),
        choice("law", ("laminar", "power"), "how the flow grows with the pressure", refines=True),
        Parameter("exponent", "", 1.3, 0.3, 3.0, "n", when=("law", ("power",))),
    ),
    actions={"chamber": Action({"inflow": leak, "ground": slope})},
    together=True,
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
    separate=(
        "raise both pressures together and watch their sum fall; air in the oil leaves the sum "
        "alone"
    ),
    starts=(
        {"leakage_coefficient": 1e-12},
        {"leakage_coefficient": 1e-12, "law": _POWER},
        {"leakage_coefficient": 1e-12, "law": _POWER, "exponent": 0.7},
    ),
)
