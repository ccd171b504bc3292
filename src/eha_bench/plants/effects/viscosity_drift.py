"""The oil warms as the machine works, and what is viscous falls with time.

    B(t) = B_0 exp(-r t)

of rotating parts, of sliding parts, or of both; with `oil` the laminar leakage grows as well as the
viscosity falls, L(t) = L_0 exp(r t). Warming of a machine that dissipates constantly starts out
linear in time, and viscosity falls exponentially with temperature (Reynolds' law), hence the
exponential. Time counts from the start of the recording.

Source: Merritt, Hydraulic Control Systems, Wiley 1967 (viscosity against
temperature); Manring, Hydraulic Control Systems, Wiley 2005.
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice

_SHAFT, _ROD, _OIL = 1.0, 2.0, 3.0


def turning(coefficient: float, t: float, rate: float, part: float) -> float:
    """Return the viscous friction of rotating parts after a time, N*m*s/rad."""
    return coefficient if part == _ROD else coefficient * math.exp(-rate * t)


def sliding(coefficient: float, t: float, rate: float, part: float) -> float:
    """Return the viscous friction of sliding parts after a time, N*s/m."""
    return coefficient if part == _SHAFT else coefficient * math.exp(-rate * t)


def leaking(value: float, t: float, rate: float, part: float) -> float:
    """Return a laminar flow, or its conductance, after a time."""
    return value * math.exp(rate * t) if part == _OIL else value


EFFECT = Effect(
    id="viscosity_drift",
    summary="Viscous friction falls with time as the oil warms.",
    parameters=(
        Parameter("rate", "1/s", 0.05, 0.0, 1.0, "r"),
        choice("part", ("all", "shaft", "rod", "oil"), "what falls; oil: leakage as well"),
    ),
    actions={
        "oil": Action(
            {"turning": turning, "sliding": sliding, "leakage": leaking, "leakage_slope": leaking},
            chosen_by="part",
            equations={"rod": Equation.FORCE},
        )
    },
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
    separate="repeat the same free motion cold and warm, or log oil_temperature",
)
