"""The motor's magnets pull its rotor towards preferred angles, or a gear's teeth its output.

    T += c sin(N theta + phi)

of the rotor's angle, or of the angle of the shaft that its gear turns (`at`). An angle that is not
measured counts from the first sample of the recording. The number N of periods a revolution is the
least common multiple of slots and poles (or a divisor of it where the motor is lopsided).

Source: Hendershot, Miller, Design of Brushless Permanent-Magnet Machines, Motor Design Books 2010;
Zhu, Howe, IEEE Trans. Energy Conversion 15 (2000) 407, doi:10.1109/60.900501.
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter


def cogging(
    torque: float, angle: float, ratio: float, amplitude: float, count: float, phase: float
) -> float:
    """Return the shaft's torque with the pull of the magnets, N*m, felt through a gear's ratio."""
    return torque + ratio * (amplitude * math.sin(count * angle + phase))


EFFECT = Effect(
    id="cogging_torque",
    summary="The motor's magnets, or a gear's teeth, pull a shaft towards preferred angles.",
    parameters=(
        Parameter("amplitude", "{effort}", 0.3, 0.0, 10.0, "c"),
        Parameter("count", "", 24.0, 1.0, 400.0, "N", "periods a revolution"),
        Parameter("phase", "rad", 0.0, -2.0 * math.pi, 2.0 * math.pi, "phi"),
    ),
    actions={"turning_motor": Action({"net": cogging}, Equation.TORQUE)},
    source="Zhu, Howe, IEEE Trans. Energy Conversion 15 (2000) 407, doi:10.1109/60.900501",
    separate="turn slowly without load and see whether the torque repeats with the angle",
    starts=tuple(
        {"count": float(count), "phase": phase}
        for count in (6, 7, 8, 9, 10, 11, 12, 14, 18, 20, 22, 24, 28, 30, 36, 42, 48, 60, 72, 84)
        for phase in (-1.5, 0.0, 1.5, 3.0)
    ),
)
