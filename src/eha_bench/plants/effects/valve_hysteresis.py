"""A valve's opening depends on where its command comes from: magnets and friction hold it back.

The command that acts lags by the play operator, half the loop either way:

    play:     y = min(max(y, u - b/2), u + b/2),   b = H u_full
    rounded:  y = mean of three such, of loops b/2, b and 3b/2
    jump:     y = u where |u - y| > b/2, else y stays

H is the width of the loop as data sheets give it: the difference of the commands that give the same
output on the way up and on the way down, of the full command. A play has sharp corners; a sum of
several rounds them, as magnetic loops are. A spool that sticks holds until it is asked for more
than the band, and then jumps to what was asked for.

What was asked for before says where in its loop a valve is; at the first sample of a recording it
is taken in the middle.

Source: Krasnosel'skii, Pokrovskii, Systems with Hysteresis, Springer 1989 (play, and sums of it:
Prandtl, Ishlinskii); Merritt, Hydraulic Control Systems, Wiley 1967, section 7.3 (torque motors);
Stenman, Gustafsson, Forsman, Int. J. Adaptive Control Signal Processing 17 (2003) 625,
doi:10.1002/acs.769 (a sticking valve jumps).
"""

from __future__ import annotations

from eha_bench.plants.compiled import njit
from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_ROUNDED, _JUMP = 1.0, 2.0
_WORDS = ("play", "rounded", "jump")


@njit()
def _carried(held: float, asked: float, half: float) -> float:
    """Return what a play of so much either way carries to."""
    return min(max(held, asked - half), asked + half)


@njit()
def _held(held: float, asked: float, half: float, form: float) -> float:
    """Return what the loop itself holds: carried along, or jumped to."""
    if form != _JUMP:
        return _carried(held, asked, half)
    return asked if abs(asked - held) > half else held


def narrow(inner: float, demanded: float, full: float, hysteresis: float) -> float:
    """Return what a loop of half the width holds, in the command's unit."""
    return _carried(inner, demanded, 0.25 * hysteresis * full)


def whole(held: float, demanded: float, full: float, hysteresis: float, form: float) -> float:
    """Return what the loop itself holds, in the command's unit."""
    return _held(held, demanded, 0.5 * hysteresis * full, form)


def wide(outer: float, demanded: float, full: float, hysteresis: float) -> float:
    """Return what a loop of one and a half times the width holds, in the command's unit."""
    return _carried(outer, demanded, 0.75 * hysteresis * full)


def held_back(
    demanded: float,
    inner: float,
    held: float,
    outer: float,
    full: float,
    hysteresis: float,
    form: float,
) -> float:
    """Return the command that the valve follows instead of the one that was given."""
    half = 0.5 * hysteresis * full
    middle = _held(held, demanded, half, form)
    if form != _ROUNDED:
        return middle
    ends = _carried(inner, demanded, 0.5 * half) + _carried(outer, demanded, 1.5 * half)
    return (ends + middle) / 3.0


def at_first(demanded: float) -> float:
    """Return what is held where nothing was asked for before: the command itself."""
    return demanded


EFFECT = Effect(
    id="valve_hysteresis",
    summary="A valve's opening lags behind its command, on the way up and on the way down.",
    parameters=(
        Parameter("hysteresis", "", 0.02, 0.0, 0.5, "H", "width of the loop, of the full command"),
        choice("form", _WORDS, "whether the loop has sharp corners, or the valve jumps"),
    ),
    actions={
        "valve_drive": Action(
            {"demand": held_back},
            advance={"inner": narrow, "held": whole, "outer": wide},
            start={"inner": at_first, "held": at_first, "outer": at_first},
            remembers=True,
        )
    },
    states=("inner", "held", "outer"),
    source="Krasnosel'skii, Pokrovskii, Systems with Hysteresis, Springer 1989",
    separate="slow triangles of the command: what moves at the same command, up and down?",
    starts=({"hysteresis": 0.005}, {"hysteresis": 0.06}),
)  # fmt: skip
