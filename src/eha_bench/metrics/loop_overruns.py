"""Ticks at which the control loop was late."""

from __future__ import annotations

import math

import numpy as np

from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial
from eha_bench.metrics.metric import Metric, NotScored, spec_of

LATE = 1.5
"""Sample periods between two ticks above which the later one counts as an overrun."""


class LoopOverruns(Metric):
    """Number of ticks that came more than half a sample period late.

    What the target counted itself (metadata `loop_overruns`) comes first; else the time stamps
    tell, unless they were counted from a sample rate.
    """

    spec = spec_of("loop_overruns")

    def applies(self, trial: Trial) -> bool:
        """Every trial runs on a clock."""
        return trial.sample_rate > 0.0

    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:  # noqa: ARG002 - the base class asks for it
        """Return a count; it is exact, so low = high = value."""
        counted = recording.metadata.get("loop_overruns")
        if counted is not None:
            try:
                number = float(counted)
            except ValueError:
                number = math.nan
            if not number >= 0.0:
                raise NotScored(f"metadata 'loop_overruns' is '{counted}', not a count")
            return Measure(number, number, number, "counted by the target")
        if "time" in recording.resampled:
            raise NotScored("the times were counted from a sample rate: no late tick can be seen")
        if len(recording) < 2:
            raise NotScored(f"the recording has {len(recording)} sample(s)")
        if recording.sample_period > LATE / trial.sample_rate:
            raise NotScored(
                f"recorded every {recording.sample_period:.4g} s, not at the trial's "
                f"{trial.sample_rate:g} Hz: late ticks cannot be counted"
            )
        late = float(np.count_nonzero(np.diff(recording.time) > LATE / trial.sample_rate))
        reason = f"time stamps more than {LATE} periods of {trial.sample_rate:g} Hz apart"
        return Measure(late, late, late, reason)
