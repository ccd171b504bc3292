"""The motor's magnets pull its rotor towards preferred angles, or a gear's teeth its output.

    T += c [sin(N theta + phi) + s sin(2 N theta + psi)];  s = 0 where there is one harmonic

of the rotor's angle, or of the angle of the shaft that its gear turns (`at`). An angle that is not
measured counts from the first sample of the recording. The number N of periods a revolution is the
least common multiple of slots and poles (or a divisor of it where the motor is lopsided). Its pull
is a Fourier series, of which the second harmonic is the first that counts.

Source: Hendershot, Miller, Design of Brushless Permanent-Magnet Machines, Motor Design Books 2010;
Zhu, Howe, IEEE Trans. Energy Conversion 15 (2000) 407, doi:10.1109/60.900501.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice

_ONE, _TWO = 0.0, 1.0
_COUNTS = (6, 7, 8, 9, 10, 11, 12, 14, 18, 20, 22, 24, 28, 30, 36, 42, 48, 60, 72, 84)


class Pull(NamedTuple):
    """The shape of the pull: the effect's own parameters but for its count."""

    amplitude: float
    phase: float
    harmonics: float
    second: float
    second_phase: float


def cogging(torque: float, angle: float, ratio: float, count: float, own: Pull) -> float:
    """Return the shaft's torque with the pull of the magnets, N*m, felt through a gear's ratio."""
    wave = math.sin(count * angle + own.phase)
    if own.harmonics != _ONE:
        wave += own.second * math.sin(2.0 * count * angle + own.second_phase)
    return torque + ratio * (own.amplitude * wave)


EFFECT = Effect(
    id="cogging_torque",
    summary="The motor's magnets, or a gear's teeth, pull a shaft towards preferred angles.",
    parameters=(
        Parameter("amplitude", "{effort}", 0.3, 0.0, 10.0, "c"),
        Parameter("count", "", 24.0, 1.0, 400.0, "N", "periods a revolution"),
        Parameter("phase", "rad", 0.0, -2.0 * math.pi, 2.0 * math.pi, "phi"),
        choice("harmonics", ("one", "two"), "of the pull over a period", refines=True),
        Parameter(
            "second", "", 0.2, -1.0, 1.0, "s", "share of the first", when=("harmonics", ("two",))
        ),
        Parameter(
            "second_phase",
            "rad",
            0.0,
            -2.0 * math.pi,
            2.0 * math.pi,
            "psi",
            when=("harmonics", ("two",)),
        ),
    ),
    actions={"turning_motor": Action({"net": cogging}, Equation.TORQUE)},
    source="Zhu, Howe, IEEE Trans. Energy Conversion 15 (2000) 407, doi:10.1109/60.900501",
    separate="turn slowly without load and see whether the torque repeats with the angle",
    starts=(
        *(
            {"count": float(count), "phase": phase}
            for count in _COUNTS
            for phase in (-1.5, 0.0, 1.5, 3.0)
        ),
        {"harmonics": _TWO, "second_phase": 1.5},
    ),
)
