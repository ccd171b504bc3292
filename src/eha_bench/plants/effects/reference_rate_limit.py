"""The reference that a position loop follows moves at most so fast.

    y_r <- y_r + clip(r - y_r, -v T, v T)                      `form: rate`
    w <- w + clip(w* - w, -a T, a T),   y_r <- y_r + w T       `form: trapezoid`
    w* = sign(r - y_r) min(v, sqrt(2 a |r - y_r|)),   a = v / t_a

once a period T of the loop: a ramp generator, a profile velocity, the goal speed of a smart servo.
A trapezoidal profile takes a time t_a to its full speed, and to rest. The strength is the time that
the reference takes for a unit of its way, 1 / v; 0 is no limit. It begins at what is asked for
first.

Source: Biagiotti, Melchiorri, Trajectory Planning for Automatic Machines and Robots, Springer 2008,
sections 3.2 (trapezoidal profiles) and 4.6 (filters that limit rate and acceleration).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from eha_bench.plants.compiled import njit
from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_RATE, _TRAPEZOID = 0.0, 1.0


class PacedReference(NamedTuple):
    """The profile's own parameters."""

    time_per_unit: float
    ramp_time: float
    form: float


@njit()
def _acceleration(own: PacedReference) -> float:
    """Return the acceleration of a trapezoid, in the reference's unit a second squared."""
    return 1.0 / (own.time_per_unit * own.ramp_time)


@njit()
def _wanted_pace(off: float, h: float, own: PacedReference) -> float:
    """Return the pace at which a profile wants to go what is left, in its unit a second."""
    fastest = 1.0 / own.time_per_unit
    if own.form == _TRAPEZOID:
        fastest = min(fastest, math.sqrt(2.0 * _acceleration(own) * abs(off)))
    return math.copysign(min(fastest, abs(off) / h), off)


@njit()
def _next_pace(off: float, pace: float, h: float, own: PacedReference) -> float:
    wanted = _wanted_pace(off, h, own)
    if own.form != _TRAPEZOID:
        return wanted
    most = _acceleration(own) * h
    return pace + min(max(wanted - pace, -most), most)


@njit()
def _moved_on(profile: float, pace: float, asked: float, h: float, own: PacedReference) -> float:
    return profile + h * _next_pace(asked - profile, pace, h, own)


def pace_before(pace: float) -> float:
    """Return the profile's pace at the start of a step, in its unit a second."""
    return pace


def pace_after(profile: float, pace: float, asked: float, h: float, own: PacedReference) -> float:
    """Return the profile's pace after a time h, in its unit a second."""
    return _next_pace(asked - profile, pace, h, own)


def follow(profile: float, was: float, asked: float, h: float, own: PacedReference) -> float:
    """Return the profile after a time h, in the reference's unit."""
    return _moved_on(profile, was, asked, h, own)


def followed(
    reference: float, profile: float, pace: float, period: float, own: PacedReference
) -> float:
    """Return what the loop follows instead of its reference: a period on from the last."""
    return _moved_on(profile, pace, reference, period, own)


def at_first(asked: float) -> float:
    """Return the profile at the first sample: what is asked for there."""
    return asked


EFFECT = Effect(
    id="reference_rate_limit",
    summary="The reference that a position loop follows moves at most so fast.",
    parameters=(
        Parameter("time_per_unit", "1/{speed}", 3.0, 0.0, 1e4, "1/v"),
        choice("form", ("rate", "trapezoid"), "whether its acceleration is limited, too",
               refines=True),
        Parameter("ramp_time", "s", 0.1, 1e-4, 100.0, "t_a", "to full speed, and to rest",
                  when=("form", ("trapezoid",))),
    ),
    actions={
        "position_loop": Action(
            {"reference": followed},
            # in this order: both go on from where both were
            advance={"was": pace_before, "pace": pace_after, "profile": follow},
            start={"profile": at_first},
            remembers=True,
        )
    },
    states=("profile", "pace", "was"),
    source="Biagiotti, Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008",
    separate="ask for steps of different size: the time of a limited reference grows with the way, "
    "that of a lag does not; then lower the profile's speed on purpose",
    starts=({"time_per_unit": 1.0}, {"time_per_unit": 1.5}, {"time_per_unit": 6.0},
            {"time_per_unit": 20.0}),
)  # fmt: skip
