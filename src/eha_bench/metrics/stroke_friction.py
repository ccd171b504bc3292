"""Friction from slow strokes: what is needed more in the direction of motion than against it."""

from __future__ import annotations

import math

from eha_bench.core.metric import Better, MetricSpec
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial
from eha_bench.metrics.coverage import reach
from eha_bench.metrics.metric import Metric, NotScored
from eha_bench.metrics.strokes import LENGTHS, loop


class StrokeFriction(Metric):
    """Half the width of the loop of effort over position, in the unit of the effort.

    The effort is the channel it is scored on: a pressure difference, a current, a force.
    """

    spec = MetricSpec(
        "stroke_friction",
        "half of what the effort differs by between a stroke forth and back at the same place",
        None,
        "pressure_difference",
        better=Better.LOWER,
    )
    by_default = False

    def applies(self, trial: Trial) -> bool:
        """Whether the trial lasts at all; the recording shows whether there are strokes."""
        return trial.duration > 0.0

    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:
        """Return the friction at the speed of the strokes, as a magnitude."""
        if channel in recording and recording.unit(channel) in LENGTHS:
            raise NotScored(f"{channel} is a position, not what the motion takes")
        found = loop(recording, trial, channel)
        own = reach(found.budget)
        value = abs(found.half)
        turning = recording.unit(trial.channel) == "rad"
        speed = f"{math.degrees(found.speed):.3g} deg/s" if turning else f"{found.speed:.3g} m/s"
        notes = (
            f"{found.strokes} strokes, middle three fifths of the travel, at {speed}",
            *found.notes,
        )
        return Measure(value, value - own, value + own, "; ".join(notes), found.budget.merged())
