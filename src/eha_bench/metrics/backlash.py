"""Backlash: lost motion between two positions on either side of a play."""

from __future__ import annotations

import math

from eha_bench.core.metric import Better, MetricSpec
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial
from eha_bench.metrics.coverage import between, reach
from eha_bench.metrics.metric import Metric, NotScored
from eha_bench.metrics.strokes import LENGTHS, loop


class Backlash(Metric):
    """Width of the loop of the driving position over the driven one, in the former's unit.

    It is scored on the driving position; the driven one is what the reference asks for.
    """

    spec = MetricSpec(
        "backlash",
        "how far the driving position goes at a reversal before the driven one follows",
        None,
        "piston_position",
        better=Better.LOWER,
    )
    by_default = False

    def applies(self, trial: Trial) -> bool:
        """Whether the trial lasts at all; the recording shows whether there are reversals."""
        return trial.duration > 0.0

    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:
        """Return the lost motion, positive where the driving position leads."""
        if channel in recording and recording.unit(channel) not in LENGTHS:
            raise NotScored(f"{channel} is not a position: backlash needs one on either side of it")
        found = loop(recording, trial, channel)
        value = 2.0 * math.copysign(found.half, found.half * found.slope)
        budget = found.budget.scaled(2.0)
        if recording.resampled & {channel, trial.channel}:
            # each channel's own samples may lie up to half a period from the common clock's
            drive = found.speed * abs(found.slope)
            budget += between("time stamps", drive * recording.sample_period)
        own = reach(budget)
        notes = [f"{found.strokes} strokes, width of {channel} over {trial.channel}"]
        if value < -own:
            notes.append("negative: the driven position leads; check the channels' time stamps")
        notes += found.notes
        return Measure(value, value - own, value + own, "; ".join(notes), budget.merged())
