"""A supply gives way as oil is drawn from it, by this machine or by others.

    tau ds/dt = R q - s,    p = p_0 - s

A source of resistance R behind which a volume or an accumulator evens out, in a time tau, what is
drawn: its pressure falls with the flow q, and comes back when nothing is drawn. Others that draw
from the same source are seen in the same way: a steady consumer of flow Q from the start of the
recording on (an accumulator that runs down, where tau is long), or one that draws more and less,
slowly enough for the source to follow,

    s = R Q (1 - exp(-t / tau)),    s = R Q w(f t + phi / 2 pi)

where w is between 0 and 1: a sine, or the sawtooth of an accumulator that a pump fills again and
again. Only the product R Q is seen there, so Q is given and R fitted. Time counts from the start of
the recording.

Source: Merritt, Hydraulic Control Systems, Wiley 1967 (supplies); Findeisen, Helduser,
Ölhydraulik, 6th ed., Springer 2015 (accumulators, and pumps that cut in).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_MACHINE, _SWINGING, _STEADY = 0.0, 1.0, 2.0
_SAWTOOTH = 1.0
_USUAL = 0.1
"""Share of its pressure that a supply gives way by."""


class Others(NamedTuple):
    """What others draw: the effect's own parameters."""

    resistance: float
    recovery_time: float
    drawn_by: float
    others: float
    frequency: float
    phase: float
    wave: float


def sagging_pressure(pressure: float, sag: float, t: float, own: Others) -> float:
    """Return the pressure of the supply, Pa."""
    if own.drawn_by == _MACHINE:
        return pressure - sag
    if own.drawn_by == _STEADY:
        share = 1.0 - math.exp(-t / own.recovery_time)
        return pressure - own.resistance * own.others * share
    turn = own.frequency * t + own.phase / (2.0 * math.pi)
    share = 0.5 + 0.5 * math.sin(2.0 * math.pi * turn)
    if own.wave == _SAWTOOTH:
        # its fundamental has the sine's phase
        share = turn + 0.5 - math.floor(turn + 0.5)
    return pressure - own.resistance * own.others * share


def follow(sag: float, drawn: float, h: float, resistance: float, recovery_time: float) -> float:
    """Return how far the supply has fallen after a time h by what this machine draws, Pa."""
    end = resistance * drawn
    return end + (sag - end) * math.exp(-h / recovery_time)


def at_first() -> float:
    """Return how far the supply has fallen at the first sample, Pa."""
    return 0.0


def reach(drawn_by: float, pressure: float) -> float:
    """Return how far a supply of some pressure may have fallen in the midst of a motion, Pa."""
    return _USUAL * pressure if drawn_by == _MACHINE else 0.0


EFFECT = Effect(
    id="supply_sag",
    summary="The supply's pressure falls as oil is drawn from it.",
    parameters=(
        Parameter("resistance", "Pa*s/m^3", 5e9, 0.0, 1e13, "R"),
        choice(
            "drawn_by",
            ("machine", "swinging", "steady"),
            "or by others: more and less, or from the start on",
        ),
        Parameter(
            "recovery_time", "s", 0.1, 1e-3, 100.0, "tau", when=("drawn_by", ("machine", "steady"))
        ),
        Parameter(
            "others",
            "m^3/s",
            1e-4,
            1e-7,
            1e-1,
            "Q",
            "6 l/min",
            assumed=True,
            searched=False,
            when=("drawn_by", ("swinging", "steady")),
        ),
        Parameter("frequency", "Hz", 1.0, 0.05, 20.0, "f", when=("drawn_by", ("swinging",))),
        Parameter(
            "phase",
            "rad",
            0.0,
            -2.0 * math.pi,
            2.0 * math.pi,
            "phi",
            when=("drawn_by", ("swinging",)),
        ),
        choice(
            "wave",
            ("sine", "sawtooth"),
            "of what others draw",
            refines=True,
            when=("drawn_by", ("swinging",)),
        ),
    ),
    actions={
        "supply": Action(
            {"pressure": sagging_pressure},
            advance={"sag": follow},
            start={"sag": at_first},
            unread={"sag": reach},
        )
    },
    states=("sag",),
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
    separate="move fast for seconds, then rest, and log the supply's pressure at the valve",
    starts=(
        {"drawn_by": _MACHINE},
        {"drawn_by": _MACHINE, "recovery_time": 0.02},
        {"drawn_by": _MACHINE, "recovery_time": 1.0},
        {"drawn_by": _MACHINE, "resistance": 5e8},
        {"drawn_by": _STEADY, "recovery_time": 3.0},
        {"drawn_by": _STEADY, "recovery_time": 30.0},
        {"drawn_by": _SWINGING},
        {"drawn_by": _SWINGING, "wave": _SAWTOOTH},
    ),
)
