"""A straight line from one level to another."""

from __future__ import annotations

from typing import Literal

from eha_bench.core.arrays import FloatArray
from eha_bench.suites.signals.signal_model import Level, Moment, Seconds, SignalModel


class Ramp(SignalModel):
    """From `initial` at the time `at` to `final`, taking the time `over`."""

    kind: Literal["ramp"]
    initial: Level = 0.0
    final: Level
    over: Seconds
    at: Moment = 0.0

    @property
    def duration(self) -> float:
        """End of the ramp in s; `final` is held after it."""
        return self.at + self.over

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the reference at `time` in s, shape (n,) -> (n,)."""
        import numpy as np

        ends = [self.at, self.at + self.over]
        values: FloatArray = np.interp(time, ends, [self.initial, self.final])
        return values
