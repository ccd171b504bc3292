"""A position loop gets its reference late, by a constant transport delay.

    r(t) = r_logged(t - T)

A bus cycle, a queue of a gateway, a servo that is polled in turn: the loop itself goes on at once,
so what it damps is not late, as it is with a delay behind the loop (`command_delay`). The loop
takes the mean of what arrives over one of its periods, so that a run changes continuously with T.
What was asked for before the recording is taken to be what is asked for at its first sample.

Source: Astrom, Wittenmark, Computer-Controlled Systems, 3rd ed., Prentice Hall 1997
(sampling a system with a time delay).
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.effects.command_delay import delayed_command
from eha_bench.plants.parameter import Parameter


def at_first(asked: float) -> float:
    """Return what is taken to have been asked for before the recording."""
    return asked


EFFECT = Effect(
    id="reference_delay",
    summary="A position loop gets its reference after a constant delay.",
    parameters=(Parameter("delay", "s", 5e-3, 0.0, 0.5, "T"),),
    actions={
        "position_loop": Action({"reference": delayed_command}, start={"before": at_first}),
    },
    states=("before",),
    source="Astrom, Wittenmark, Computer-Controlled Systems, 3rd ed., 1997",
    separate="push the joint by hand while it holds: a late reference leaves the loop's answer at "
    "once, a late command does not; a lag bends a step, and a limited rate takes as long as the "
    "way is",
    starts=({"delay": 1.5e-3}, {"delay": 1.5e-2}, {"delay": 4e-2}),
)
