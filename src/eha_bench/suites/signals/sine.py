"""A sine about an offset."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from eha_bench.core.arrays import FloatArray
from eha_bench.core.signal import Tone
from eha_bench.suites.signals.signal_model import (
    Angle,
    Hertz,
    Level,
    Moment,
    SignalModel,
    within,
)


class Sine(SignalModel):
    """offset + amplitude * sin(2 pi frequency (t - at) + phase); amplitude is the peak value.

    Before `at` it keeps its first value. With `cycles` it ends after so many periods, without it
    never ends.
    """

    kind: Literal["sine"]
    amplitude: Level
    frequency: Hertz
    offset: Level = 0.0
    phase: Angle = 0.0
    at: Moment = 0.0
    cycles: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None

    @property
    def duration(self) -> float:
        """End of the last cycle in s, or infinite."""
        return math.inf if self.cycles is None else self.at + self.cycles / self.frequency

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the reference at `time` in s, shape (n,) -> (n,)."""
        import numpy as np

        elapsed = within(time, self.at, self.duration) - self.at
        angle = 2 * np.pi * self.frequency * elapsed + self.phase
        values: FloatArray = self.offset + self.amplitude * np.sin(angle)
        return values

    @property
    def tones(self) -> tuple[Tone, ...]:
        """The one sine."""
        tone = Tone(self.at, self.duration, self.frequency, self.amplitude, self.offset, self.phase)
        return (tone,)
