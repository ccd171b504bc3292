"""Before the rod slides, its friction yields like a spring (bristles bend).

    dz/dx = (1 - z sign(v)) / s,   F = F_f z,   -1 <= z <= 1

Dahl's model: z is the share of the dry friction F_f that is reached, s the distance over which it
builds up; sliding further than a few s gives the full friction, and towards s = 0 the rod sticks.
Bristles start relaxed where the rod is at rest at the first sample, bent to the end where it moves.

Source: Dahl, AIAA J. 14 (1976) 1675, doi:10.2514/3.61511; Canudas de Wit, Olsson, Astrom,
Lischinsky, IEEE Trans. Automatic Control 40 (1995) 419, doi:10.1109/9.376053.
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter

# slower than this the rod counts as at rest at the first sample, m/s
_AT_REST = 5e-3


def bend(bristle: float, v: float, h: float, distance: float) -> float:
    """Return how far the bristles are bent after a time h, -1 ... 1 (exact for constant v)."""
    end = 1.0 if v > 0.0 else -1.0
    return end + (bristle - end) * math.exp(-abs(v) * h / distance)


def at_first(v: float) -> float:
    """Return how far the bristles are bent at the first sample."""
    return min(1.0, max(-1.0, v / _AT_REST))


def nothing_sticks(level: float) -> float:
    """Return the part of the dry friction that sticks: none, it is the bristles', N."""
    return 0.0


def resist(force: float, level: float, bristle: float) -> float:
    """Return the force on the rod less the pull of the bristles, N."""
    return force - level * bristle


EFFECT = Effect(
    id="presliding_friction",
    summary="Before the rod slides, its friction yields like a spring.",
    parameters=(Parameter("distance", "m", 2e-4, 0.0, 0.1, "s"),),
    actions={
        "eha_knee": Action(Equation.FORCE, {"rod_sticks": nothing_sticks, "rod_force": resist}),
        "linear_drive": Action(Equation.FORCE, {"rod_sticks": nothing_sticks, "rod_force": resist}),
    },
    states=("bristle",),
    advance={"bristle": bend},
    start={"bristle": at_first},
    source="Dahl, AIAA J. 14 (1976) 1675, doi:10.2514/3.61511",
    separate="push the resting rod to and fro with less force than its friction, and log position",
    starts=({"distance": 2e-5}, {"distance": 2e-3}),
    order=2,
)
