"""The command reaches the drive late, by a constant transport delay.

    i(t) = i_command(t - T)

The command is held between its samples, so the delayed command is a staircase. What the kernel
gets is the mean of that staircase over each of its steps: the result is then a continuous
function of the delay, which a search needs. What was commanded before the recording is taken to be
the current that flows at its first sample.

Source: Astrom, Wittenmark, Computer-Controlled Systems, 3rd ed., Prentice Hall 1997
(sampling a system with a time delay).
"""

from __future__ import annotations

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter


def delayed_command(
    value: float,
    k: int,
    t: float,
    h: float,
    times: FloatArray,
    commands: FloatArray,
    delay: float,
    before: float,
) -> float:
    """Return the mean of the delayed command over [t, t + h], A; t lies in [times[k], ...]."""
    first = t - delay
    last = first + h
    # The newest command that has arrived at the end of the step, -1 where none has: back in strides
    # that double, then by halving, as half a second is hundreds of ticks.
    late = k + 1
    j, stride = k, 1
    while j >= 0 and times[j] >= last:
        late = j
        j -= stride
        stride *= 2
    j = max(j, -1)
    while late - j > 1:
        middle = (j + late) // 2
        if times[middle] >= last:
            late = middle
        else:
            j = middle
    total = 0.0
    upper = last
    while upper > first:
        lower = first if j < 0 else max(first, times[j])
        total += (upper - lower) * (before if j < 0 else commands[j])
        upper = lower
        j -= 1
    return total / h


def at_first(current: float) -> float:
    """Return what is taken to have been commanded before the recording, A."""
    return current


EFFECT = Effect(
    id="command_delay",
    summary="The command takes effect after a constant delay.",
    parameters=(Parameter("delay", "s", 2e-3, 0.0, 0.5, "T"),),
    actions={
        "drive": Action({"command": delayed_command}, start={"before": at_first}),
        "command_path": Action({"command": delayed_command}, start={"before": at_first}),
    },
    states=("before",),
    source="Astrom, Wittenmark, Computer-Controlled Systems, 3rd ed., 1997",
    separate="log the motor current during steps: a delay shifts it, a lag bends it",
    starts=({"delay": 0.5e-3}, {"delay": 5e-3}),
)
