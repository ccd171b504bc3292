"""A pump with a finite number of pistons delivers in pulses.

    q = D_p w (1 + r p(z theta + phi))

A tone is the first harmonic of any pump's pulses, p = cos. Pistons that move as sines give arcs
that meet in cusps where one takes over from the next: of z of them,

    p = (2/3) (1 - 3 u^2),  u = -1 ... 1 over a pulse, 0 at its top,

whose range is that of the tone. (The arcs are pieces of a cosine, as long as 1/z of its period, or
half of that; from five pistons on they are parabolas to a hundredth.)

An ideal pump also asks for its torque in pulses, D_p dp (1 + r p), so that it gives to the oil
exactly what it takes from the shaft: `acts_on: flow_and_torque`. How the pressure in a piston
changes over between the ports makes the pulses of the torque smaller or larger than that, by
`torque_share`; `torque` alone is friction that follows the load of the pistons. theta is the angle
of the shaft, as it is read or by the gear whose angle is; one that is not measured counts from the
first sample of the recording. z is the number of pistons, or twice that where it is odd.

Source: Ivantysyn, Ivantysynova, Hydrostatic Pumps and Motors, Akademia Books 2001;
Manring, J. Dyn. Sys. Meas. Control 122 (2000) 263.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from eha_bench.plants.compiled import njit
from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice

_FLOW, _BOTH, _TORQUE = 0.0, 1.0, 2.0
_TONE, _PISTONS = 0.0, 1.0


class Pulses(NamedTuple):
    """What pulsates, and how: the effect's own parameters but for its count."""

    ripple: float
    phase: float
    pulse: float
    acts_on: float
    torque_share: float


@njit()
def _pulse(angle: float, count: float, own: Pulses) -> float:
    """Return the pulses of the delivery at an angle, of its mean."""
    along = count * angle + own.phase
    if own.pulse == _TONE:
        return own.ripple * math.cos(along)
    u = along / math.pi
    u -= 2.0 * math.floor(0.5 * (u + 1.0))
    return own.ripple * (2.0 / 3.0) * (1.0 - 3.0 * u * u)


def delivery(flow: float, angle: float, count: float, own: Pulses) -> float:
    """Return the flow of the pump with its pulses, m^3/s."""
    return flow if own.acts_on == _TORQUE else flow * (1.0 + _pulse(angle, count, own))


def reaction(
    torque: float,
    angle: float,
    difference: float,
    displacement: float,
    ratio: float,
    count: float,
    own: Pulses,
) -> float:
    """Return the shaft's torque with the pulses of the pressure on the pistons, N*m."""
    if own.acts_on == _FLOW:
        return torque
    share = own.torque_share if own.acts_on == _BOTH else 1.0
    return torque - ratio * (displacement * difference * share * _pulse(angle, count, own))


EFFECT = Effect(
    id="pump_ripple",
    summary="The pump delivers in pulses, piston by piston.",
    parameters=(
        Parameter("ripple", "", 0.05, 0.0, 1.0, "r"),
        Parameter("count", "", 9.0, 1.0, 200.0, "z", "pulses a revolution"),
        Parameter("phase", "rad", 0.0, -2.0 * math.pi, 2.0 * math.pi, "phi"),
        choice("acts_on", ("flow", "flow_and_torque", "torque"), "what pulsates"),
        choice("pulse", ("tone", "pistons"), "shape of a pulse", refines=True),
        Parameter(
            "torque_share", "", 1.0, 0.0, 2.0, "", "of the pulses of an ideal pump",
            when=("acts_on", ("flow_and_torque",)),
        ),
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
    starts=(
        *(
            {"count": float(count), "phase": phase, "acts_on": acts_on}
            for acts_on in (_FLOW, _BOTH, _TORQUE)
            for count in (3, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 18, 22)
            for phase in (-1.5, 0.0, 1.5, 3.0)
        ),
        *({"pulse": _PISTONS, "acts_on": acts_on} for acts_on in (_FLOW, _BOTH, _TORQUE)),
    ),
)  # fmt: skip
