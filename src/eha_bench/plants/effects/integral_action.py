"""A position loop also integrates its error.

    u = u_law + c,   c <- clip(c + K_i e T, -c_max, c_max)

once a period T, with the part c limited against winding up. At a run's first sample c is taken for
what the law alone leaves of the command that holds the load at rest: all of it where the error is
gone, nothing where the load has sagged, and neither more than all nor against it. How far that is
off, as in the midst of a motion, no reading says: as much as a tenth of a second gathers at an
error that asks for all that the drive gives.

Source: Astrom, Hagglund, Advanced PID Control, ISA 2006, sections 3.3 and 3.5 (integral action,
windup).
"""

from __future__ import annotations

from eha_bench.plants.compiled import njit
from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter

_GATHERED = 0.1
"""How long it may have gathered an error that asks for all that the drive gives, s."""


@njit()
def _gathered(
    collected: float, error: float, h: float, integral_gain: float, limit: float
) -> float:
    return min(max(collected + integral_gain * error * h, -limit), limit)


def gather(collected: float, error: float, h: float, integral_gain: float, limit: float) -> float:
    """Return the integral part after a time h at an error, in the command's unit."""
    return _gathered(collected, error, h, integral_gain, limit)


def command(
    value: float, collected: float, error: float, period: float, integral_gain: float, limit: float
) -> float:
    """Return the command with the integral part of this period, in its unit."""
    return value + _gathered(collected, error, period, integral_gain, limit)


def at_first(holding: float, by_law: float, limit: float) -> float:
    """Return the integral part at the first sample, in the command's unit."""
    left = holding - by_law
    between = min(max(left, min(holding, 0.0)), max(holding, 0.0))
    return min(max(between, -limit), limit)


def reach(integral_gain: float, limit: float, position: float) -> float:
    """Return how far the integral part may be from what it begins at."""
    return min(limit, integral_gain * position * _GATHERED)


EFFECT = Effect(
    id="integral_action",
    summary="A position loop also integrates its error.",
    parameters=(
        Parameter("integral_gain", "{command}/({position}*s)", 2.0, 0.0, 1e9, "K_i"),
        Parameter("limit", "{command}", 0.3, 1e-6, 1e6, "c_max"),
    ),
    actions={
        "position_loop": Action(
            {"loop_command": command},
            advance={"collected": gather},
            start={"collected": at_first},
            unread={"collected": reach},
        )
    },
    states=("collected",),
    source="Astrom, Hagglund, Advanced PID Control, ISA 2006",
    separate="hold against a load for seconds: with an integral the error goes back to nothing",
    starts=({"integral_gain": 0.5}, {"integral_gain": 10.0},
            {"integral_gain": 2.0, "limit": 1.0}),
)  # fmt: skip
