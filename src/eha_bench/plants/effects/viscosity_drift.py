"""The oil warms as the machine works, and what is viscous falls with time.

    B(t) = B_0 exp(-r t)

of the pump, of the rod, or of both; with `leakage` the laminar leakage grows as the viscosity
falls, L(t) = L_0 exp(r t). Warming of a machine that dissipates constantly starts out linear in
time, and viscosity falls exponentially with temperature (Reynolds' law), hence the exponential.
Time counts from the start of the recording.

Source: Merritt, Hydraulic Control Systems, Wiley 1967 (viscosity against
temperature); Manring, Hydraulic Control Systems, Wiley 2005.
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice

_PUMP_AND_ROD, _PUMP, _ROD, _OIL = 0.0, 1.0, 2.0, 3.0


def pump(coefficient: float, t: float, rate: float, part: float) -> float:
    """Return the pump's viscous friction after a time, N*m*s/rad."""
    return coefficient if part == _ROD else coefficient * math.exp(-rate * t)


def rod(coefficient: float, t: float, rate: float, part: float) -> float:
    """Return the rod's viscous friction after a time, N*s/m."""
    return coefficient if part == _PUMP else coefficient * math.exp(-rate * t)


def drive(coefficient: float, t: float, rate: float) -> float:
    """Return the drive's viscous friction after a time, N*s/m."""
    return coefficient * math.exp(-rate * t)


def leak(coefficient: float, t: float, rate: float, part: float) -> float:
    """Return the laminar leakage after a time, m^3/(s*Pa)."""
    return coefficient * math.exp(rate * t) if part == _OIL else coefficient


EFFECT = Effect(
    id="viscosity_drift",
    summary="Viscous friction falls with time as the oil warms.",
    parameters=(
        Parameter("rate", "1/s", 0.05, -1.0, 1.0, "r"),
        choice("part", ("pump_and_rod", "pump", "rod", "oil"), "what falls; oil: leakage as well"),
    ),
    actions={
        "eha_knee": Action(
            Equation.TORQUE,
            {"pump_viscous": pump, "rod_viscous": rod, "leakage": leak},
            chosen_by="part",
            equations={"rod": Equation.FORCE},
        ),
        "linear_drive": Action(Equation.FORCE, {"rod_viscous": drive}, choices={"part": ("rod",)}),
    },
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
    separate="repeat the same free motion cold and warm, or log oil_temperature",
    starts=({"part": _PUMP}, {"part": _ROD}, {"part": _OIL}),
)
