"""Before it slides, dry friction yields like a spring (bristles bend).

    dz/dt = v (1 - sign(v) z)^i / s,   F = F_f (z + tau dz/dt),   -1 <= z <= 1

The LuGre model (tau = sigma_1 / sigma_0), without damping tau Dahl's; i is 1 or, where bristles
soften earlier, 2 (Dahl's exponent; `softening`). z is the share of the dry
friction F_f that is reached (with its Stribeck fall, where it has one), s the distance over which
it builds up; sliding further than a few s gives the full friction, and towards s = 0 it sticks.
Bristles start relaxed where there is rest at the first sample, bent to the end where there is
motion. They only take energy: v dz/dt >= 0.

Source: Dahl, AIAA J. 14 (1976) 1675, doi:10.2514/3.61511; Canudas de Wit, Olsson, Astrom,
Lischinsky, IEEE Trans. Automatic Control 40 (1995) 419, doi:10.1109/9.376053.
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_LINEAR = 0.0
_LONG = 10.0
"""Distance, in usual ones, from which bristles are long beside the way between two reversals."""


def bend(bristle: float, speed: float, h: float, distance: float, softening: float) -> float:
    """Return how far the bristles are bent after a time h, -1 ... 1 (exact, constant speed)."""
    end = 1.0 if speed > 0.0 else -1.0
    way = abs(speed) * h / distance
    if softening == _LINEAR:
        return end + (bristle - end) * math.exp(-way)
    return end + (bristle - end) / (1.0 + abs(bristle - end) * way)


def at_first(speed: float, slow: float) -> float:
    """Return how far the bristles are bent at the first sample."""
    return min(1.0, max(-1.0, speed / slow))


def reach(distance: float, position: float) -> float:
    """Return how far bristles may be from bent to the end in the midst of a motion, 0 ... 1.

    Short ones are bent as soon as it goes on; long ones may not have been when it turned last.
    """
    return distance / (distance + _LONG * position)


def sticks(level: float) -> float:
    """Return the part of the dry friction that sticks: none where bristles hold it, N (or N*m)."""
    return 0.0


def pull(
    effort: float,
    level: float,
    speed: float,
    bristle: float,
    distance: float,
    damping_time: float,
    softening: float,
) -> float:
    """Return the effort less the pull of bent and bending bristles, N (or N*m)."""
    bending = damping_time * (speed - abs(speed) * bristle) / distance
    if softening != _LINEAR:
        bending *= 1.0 - bristle if speed > 0.0 else 1.0 + bristle
    return effort - level * (bristle + bending)


EFFECT = Effect(
    id="presliding_friction",
    summary="Before it slides, dry friction yields like a spring.",
    parameters=(
        Parameter("distance", "{position}", 1.0, 0.0, 10.0, "s"),
        Parameter("damping_time", "s", 5e-4, 0.0, 0.1, "tau", "of the bristles; 0: Dahl"),
        choice("softening", ("linear", "square"), "how their stiffness falls", refines=True),
    ),
    actions={
        "friction": Action(
            {"sticks": sticks, "net": pull},
            advance={"bristle": bend},
            start={"bristle": at_first},
            unread={"bristle": reach},
        )
    },
    states=("bristle",),
    source="Dahl, AIAA J. 14 (1976) 1675, doi:10.2514/3.61511",
    separate="push what rests back and forth with less than its friction, and log its position",
    starts=({"distance": 0.1}, {"distance": 10.0}),
    order=2,
)
