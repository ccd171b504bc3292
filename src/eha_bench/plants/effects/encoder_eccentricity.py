"""An encoder whose disc or magnet turns about another axis errs once a turn.

    q_read = q + e sin(q + phi)
    w_read = w [1 + e cos(q + phi)]     where the speed is the same encoder's (speed: same)

The disc's offset over the radius at which it is read is e: 0.1 mm at 10 mm is 0.01 rad. At the
first sample the angle behind a reading is found by iteration, which converges where e < 1.

Source: Heidenhain, Rotary Encoders, brochure 349529 (deviation 412 e/D, arc seconds from um and mm:
2 e/D in rad); Alejandre, Artes, Meas. Sci. Technol. 15 (2004) 1331,
doi:10.1088/0957-0233/15/7/015.
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice

_SAME = 0.0
_ITERATIONS = 6
"""Steps of the iteration for the true angle: each leaves a share e of its error, 0.5 at most."""


def reading(value: float, eccentricity: float, phase: float) -> float:
    """Return the angle that is read, rad."""
    return value + eccentricity * math.sin(value + phase)


def reading_speed(
    value: float, position: float, eccentricity: float, phase: float, speed_sensor: float
) -> float:
    """Return the speed that is read, rad/s."""
    if speed_sensor != _SAME:
        return value
    return value * (1.0 + eccentricity * math.cos(position + phase))


def behind(position: float, eccentricity: float, phase: float) -> float:
    """Return the angle behind a reading, rad."""
    angle = position
    for _ in range(_ITERATIONS):
        angle = position - eccentricity * math.sin(angle + phase)
    return angle


EFFECT = Effect(
    id="encoder_eccentricity",
    summary="A joint's encoder errs once a turn: its disc or magnet is not centred.",
    parameters=(
        Parameter("eccentricity", "{position}", 0.01, 0.0, 0.2, "e"),
        Parameter("phase", "rad", 0.0, -2.0 * math.pi, 2.0 * math.pi, "phi"),
        choice("speed_sensor", ("same", "another"), "what tells the speed"),
    ),
    actions={
        "turning_joint": Action(
            {"read_position": reading, "read_speed": reading_speed, "initial_position": behind},
            Equation.MEASUREMENT,
        ),
    },
    source="Alejandre, Artes, Meas. Sci. Technol. 15 (2004) 1331, doi:10.1088/0957-0233/15/7/015",
    separate=(
        "compare it with a second angle sensor over a whole turn, or turn its axis upright: a "
        "weight no longer acts, the encoder's error stays"
    ),
    starts=tuple(
        {"eccentricity": 0.01, "phase": phase, "speed_sensor": sensor}
        for sensor in (_SAME, 1.0)
        for phase in (-1.5, 0.0, 1.5, 3.0)
    ),
)
