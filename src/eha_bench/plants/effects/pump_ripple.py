"""A pump with a finite number of pistons delivers in pulses.

    q = D_p w (1 + r cos(z theta + phi))

An ideal pump also asks for its torque in pulses, D_p dp (1 + r cos(z theta + phi)), so that it
gives to the oil exactly what it takes from the shaft: `acts_on: flow_and_torque`; `torque` alone is
friction that follows the load of the pistons. theta counts from the first sample of the recording;
z is the number of pistons, or twice that where it is odd.

Source: Ivantysyn, Ivantysynova, Hydrostatic Pumps and Motors, Akademia Books 2001;
Manring, J. Dyn. Sys. Meas. Control 122 (2000) 263.
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice

_FLOW, _BOTH, _TORQUE = 0.0, 1.0, 2.0


def delivery(
    flow: float, angle: float, ripple: float, count: float, phase: float, acts_on: float
) -> float:
    """Return the flow of the pump with its pulses, m^3/s."""
    if acts_on == _TORQUE:
        return flow
    return flow * (1.0 + ripple * math.cos(count * angle + phase))


def reaction(
    torque: float,
    angle: float,
    difference: float,
    displacement: float,
    ratio: float,
    ripple: float,
    count: float,
    phase: float,
    acts_on: float,
) -> float:
    """Return the shaft's torque with the pulses of the pressure on the pistons, N*m."""
    if acts_on == _FLOW:
        return torque
    pulse = ripple * math.cos(count * angle + phase)
    return torque - ratio * (displacement * difference * pulse)


EFFECT = Effect(
    id="pump_ripple",
    summary="The pump delivers in pulses, piston by piston.",
    parameters=(
        Parameter("ripple", "", 0.05, 0.0, 1.0, "r"),
        Parameter("count", "", 9.0, 1.0, 200.0, "z", "pulses a revolution"),
        Parameter("phase", "rad", 0.0, -2.0 * math.pi, 2.0 * math.pi, "phi"),
        choice("acts_on", ("flow", "flow_and_torque", "torque"), "what pulsates"),
    ),
    actions={
        "pump": Action(
            {"delivery": delivery, "net": reaction},
            chosen_by="acts_on",
            equations={"torque": Equation.TORQUE},
        )
    },
    source="Manring, J. Dyn. Sys. Meas. Control 122 (2000) 263",
    separate="turn slowly against the locked piston: does the pressure repeat with the angle?",
    starts=tuple(
        {"count": float(count), "phase": phase, "acts_on": acts_on}
        for acts_on in (_FLOW, _BOTH, _TORQUE)
        for count in (3, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 18, 22)
        for phase in (-1.5, 0.0, 1.5, 3.0)
    ),
)
