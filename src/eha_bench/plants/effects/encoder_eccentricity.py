"""An encoder errs once to four times a turn: its disc is off centre or oval, its waves no sines.

    q_read = q + e sin(k q + phi),   k = 1, 2, 3, 4
    w_read = w [1 + e k cos(k q + phi)]     where the speed is the same encoder's (speed: same)

A disc's offset over the radius at which it is read is e, once a turn: 0.1 mm at 10 mm is 0.01 rad.
An oval disc, and a magnet's sine and cosine of unequal size, err twice a turn; their harmonics
three and four times. Larger than 1/k the error cannot be: the reading would turn back.

At the first sample the angle behind a reading is found by Newton's iteration.

Source: Heidenhain, Rotary Encoders, brochure 349529 (deviation 412 e/D, arc seconds from um and mm:
2 e/D in rad); Alejandre, Artes, Meas. Sci. Technol. 15 (2004) 1331,
doi:10.1088/0957-0233/15/7/015; Kuntz, Dauth, Gerlach, Ott, Fella, arXiv:2205.08472 (harmonics).
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice

_SAME, _ANOTHER = 0.0, 1.0
_WAVES = ("once", "twice", "three times", "four times")
_ITERATIONS = 8
"""Steps of Newton's iteration for the true angle, which has come to rest after five."""


def reading(value: float, eccentricity: float, waves: float, phase: float) -> float:
    """Return the angle that is read, rad."""
    return value + eccentricity * math.sin((waves + 1.0) * value + phase)


def reading_speed(
    value: float,
    position: float,
    eccentricity: float,
    waves: float,
    phase: float,
    speed_sensor: float,
) -> float:
    """Return the speed that is read, rad/s."""
    if speed_sensor != _SAME:
        return value
    turns = waves + 1.0
    return value * (1.0 + eccentricity * turns * math.cos(turns * position + phase))


def behind(position: float, eccentricity: float, waves: float, phase: float) -> float:
    """Return the angle behind a reading, rad."""
    turns = waves + 1.0
    angle = position
    for _ in range(_ITERATIONS):
        at = turns * angle + phase
        off = angle + eccentricity * math.sin(at) - position
        angle -= off / (1.0 + eccentricity * turns * math.cos(at))
    return angle


EFFECT = Effect(
    id="encoder_eccentricity",
    summary="A joint's encoder errs once to four times a turn: it is not centred, or oval.",
    parameters=(
        Parameter("eccentricity", "{position}", 0.01, 0.0, 0.2, "e"),
        choice("waves", _WAVES, "how often it errs in a turn"),
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
        {
            "eccentricity": 0.01 / (waves + 1),
            "waves": float(waves),
            "phase": phase,
            "speed_sensor": sensor,
        }
        for waves in range(len(_WAVES))
        for sensor in ((_SAME, _ANOTHER) if waves == 0 else (_SAME,))
        for phase in (-1.5, 0.0, 1.5, 3.0)
    ),
)
