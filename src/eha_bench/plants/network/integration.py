"""What every generated kernel integrates with, compiled into it.

ROS2 (Verwer, Spee, Blom, Hundsdorfer, SIAM J. Sci. Comput. 20 (1999) 1456,
doi:10.1137/S1064827597326651) is a two-stage Rosenbrock W-method: second order with any matrix in
place of the Jacobian, L-stable where that matrix holds what is stiff. Here it holds the exchange of
oil between volumes (an open bypass or check valve reaches 10-20 us) and friction that creeps; all
else becomes Heun's method. Within a step, the instants at which something stops are located and the
step is split there, so friction reverses and sticks at the right time. A valve that opens fills its
volume in 10 to 25 us, and at longer steps the second stage would meet it far behind its setting: a
step on which one switches is done again in steps of 25 us.
"""

from __future__ import annotations

import math

from eha_bench.plants.compiled import njit

GAMMA = 1.0 - 1.0 / math.sqrt(2.0)
MAX_SPLITS = 8

LANES = 8
"""Sets that a sweep advances together: two registers of four, or one of eight."""

FINE = 25e-6
"""Step across a valve that opens or closes, s: an open one fills its chamber in 10 to 25 us."""

RESOLVED = 0.2
"""Step across which what swings on a spring is followed, in radians of its swing."""

MOST_STEPS = 100
"""Most steps instead of one, across which a swing is followed."""

_BALANCED = 0.999
"""Share of the friction up to which a speed balances what acts; above it, none is near."""
_LANDS = 2.0 / GAMMA
"""Chords that a step needs to end at their foot, where friction is all there on the way."""
_APART = 1e-3
"""Widths from which two speeds have a chord."""

_SWITCHES = 0.5
"""Share of a conductance that comes or goes where a valve opens or closes."""


@njit()
def creep(
    level: float, net: float, inertia: float, speed: float, width: float, h: float
) -> tuple[float, float]:
    """Rate of change against friction that creeps, level * tanh(speed / width), and its slope.

    The slope, per inertia in 1/s, is for the implicit step: the steepest that it may meet, at the
    slower of its ends. Where a step passes the whole width and reverses, it is the chord's, to the
    speed at which friction balances `net`: the tangent at rest would be far too steep, and hold
    the speed where it is. Where `net` is more than friction, the chord is to the step's end.
    """
    rate = (net - level * math.tanh(speed / width)) / inertia
    later = speed + h * rate
    reverses = speed * later <= 0.0
    if reverses and abs(later - speed) > width:
        settled = later
        if abs(net) < _BALANCED * level:
            settled = width * math.atanh(net / level)
        if abs(settled - speed) > _APART * width:
            fall = math.tanh(settled / width) - math.tanh(speed / width)
            return rate, _LANDS * level / inertia * fall / (settled - speed)
    slowest = 0.0 if reverses else min(abs(speed), abs(later))
    shape = math.tanh(slowest / width)
    return rate, level / (width * inertia) * (1.0 - shape * shape)


@njit()
def breaks_away(net: float, level_up: float, level_down: float) -> float:
    """Direction in which something at rest breaks away; 0 where it sticks."""
    if net > level_up:
        return 1.0
    if net < -level_down:
        return -1.0
    return 0.0


@njit()
def switches(before: float, after: float) -> bool:
    """Whether a conductance comes or goes as that of a valve that opens or closes."""
    return abs(after - before) > _SWITCHES * max(before, after)


@njit()
def limited(value: float, bound: float) -> float:
    """A value within +- a bound."""
    return min(max(value, -bound), bound)
