"""The valve follows its command late, on top of what is declared of its spool.

    first_order:   tau du/dt = u_command - u
    second_order:  u'' = w^2 (u_command - u) - 2 z w u',   w = 2 z / tau
    limited:       du/dt = (u_command - u) / lag, at most u_full / tau either way

The amplifier's current, or a pilot stage, whose flow is what a spool's speed ends at. tau is what
slow commands are late by; of a limited one it is the time of the full stroke. Paths between steps
are exact.

Source: Jelali, Kroll, Hydraulic Servo-systems, Springer 2003, section 4.3 (valve dynamics);
Merritt, Hydraulic Control Systems, Wiley 1967, section 7.4 (spool speed of two-stage valves).
"""

from __future__ import annotations

import math

from eha_bench.plants.compiled import njit
from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_FIRST, _SECOND, _LIMITED = 0.0, 1.0, 2.0
_WORDS = ("first_order", "second_order", "limited")


@njit()
def _swing(h: float, frequency: float, damping: float) -> tuple[float, float]:
    """Return e^(-zwh) cos(w_d h) and e^(-zwh) sin(w_d h) / w_d, or their hyperbolic kin."""
    part = 1.0 - damping * damping
    if part > 1e-9:
        own = frequency * math.sqrt(part)
        fade = math.exp(-damping * frequency * h)
        return fade * math.cos(own * h), fade * math.sin(own * h) / own
    if part < -1e-9:
        own = frequency * math.sqrt(-part)
        slow = math.exp((own - damping * frequency) * h)
        fast = math.exp(-(own + damping * frequency) * h)
        return 0.5 * (slow + fast), 0.5 * (slow - fast) / own
    fade = math.exp(-frequency * h)
    return fade, fade * h


@njit()
def _within_limit(off: float, h: float, fastest: float, lag: float) -> float:
    """Return how far off a limited spool still is after a time h."""
    slow, far = fastest * lag, abs(off)
    if far <= slow:
        return off * math.exp(-h / lag)
    travels = (far - slow) / fastest
    if h <= travels:
        return math.copysign(far - fastest * h, off)
    return math.copysign(slow * math.exp((travels - h) / lag), off)


def speed_before(speed: float) -> float:
    """Return the lagging command's speed at the start of a step, in its unit a second."""
    return speed


def speed_after(
    speed: float,
    lagging: float,
    asked: float,
    h: float,
    time_constant: float,
    damping: float,
    form: float,
) -> float:
    """Return the speed of a second-order lag after a time h, in the command's unit a second."""
    if form != _SECOND:
        return 0.0
    frequency = 2.0 * damping / time_constant
    cosine, sine = _swing(h, frequency, damping)
    bent = cosine - damping * frequency * sine
    return speed * bent - (lagging - asked) * frequency * frequency * sine


def follow(
    lagging: float,
    was: float,
    asked: float,
    full: float,
    h: float,
    time_constant: float,
    damping: float,
    lag: float,
    form: float,
) -> float:
    """Return the lagging command after a time h, in the command's unit."""
    off = lagging - asked
    if form == _FIRST:
        return asked + off * math.exp(-h / time_constant)
    if form == _LIMITED:
        return asked + _within_limit(off, h, full / time_constant, lag)
    frequency = 2.0 * damping / time_constant
    cosine, sine = _swing(h, frequency, damping)
    return asked + off * (cosine + damping * frequency * sine) + was * sine


def acting(asked: float, lagging: float) -> float:
    """Return the command that acts instead of the one that was given."""
    return lagging


def at_first(asked: float) -> float:
    """Return the lagging command at the first sample: what is asked for there."""
    return asked


EFFECT = Effect(
    id="valve_lag",
    summary="The valve follows its command late.",
    parameters=(
        Parameter("time_constant", "s", 3e-3, 0.0, 1.0, "tau_v"),
        choice("form", _WORDS, "how it follows"),
        Parameter("damping", "", 0.7, 0.05, 5.0, "z", when=("form", ("second_order",))),
        Parameter(
            "lag", "s", 1e-3, 1e-6, 1.0, "",
            "of what is left to go below the largest speed", when=("form", ("limited",)),
        ),
    ),
    actions={
        "valve_drive": Action(
            {"drive": acting},
            # in this order: both go on from where both were
            advance={"was": speed_before, "speed": speed_after, "lagging": follow},
            start={"lagging": at_first},
            remembers=True,
        )
    },
    states=("lagging", "speed", "was"),
    source="Jelali, Kroll, Hydraulic Servo-systems, Springer 2003",
    separate="log the spool's position during steps: a lag bends it, a delay shifts it",
    starts=(
        {"time_constant": 1e-3}, {"time_constant": 10e-3},
        {"time_constant": 40e-3, "form": _LIMITED},
    ),
)  # fmt: skip
