"""A sine whose frequency sweeps."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field, model_validator

from eha_bench.core.arrays import FloatArray
from eha_bench.core.signal import Spacing, Sweep
from eha_bench.suites.signals.signal_model import (
    Hertz,
    Level,
    Moment,
    Seconds,
    SignalModel,
    within,
)


class Chirp(SignalModel):
    """offset + amplitude * sin(phase), whose frequency goes from `f_start` to `f_stop`.

    `duration` is the length of the sweep, from `at` on; amplitude is the peak value. Spacing
    `logarithmic` spends the same time on every octave, `linear` on every hertz.
    """

    kind: Literal["chirp"]
    amplitude: Level
    f_start: Hertz
    f_stop: Hertz
    span: Seconds = Field(alias="duration")
    offset: Level = 0.0
    spacing: Spacing = Spacing.LOGARITHMIC
    at: Moment = 0.0

    @model_validator(mode="after")
    def _sweeps(self) -> Chirp:
        if self.f_start == self.f_stop:
            raise ValueError("f_start and f_stop are the same: use a sine")
        return self

    @property
    def duration(self) -> float:
        """End of the sweep in s."""
        return self.at + self.span

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the reference at `time` in s, shape (n,) -> (n,)."""
        import numpy as np

        elapsed = within(time, self.at, self.duration) - self.at
        if self.spacing is Spacing.LINEAR:
            slope = (self.f_stop - self.f_start) / self.span
            turns = self.f_start * elapsed + slope * elapsed**2 / 2
        else:
            rate = math.log(self.f_stop / self.f_start) / self.span
            turns = self.f_start * np.expm1(rate * elapsed) / rate
        values: FloatArray = self.offset + self.amplitude * np.sin(2 * np.pi * turns)
        return values

    @property
    def sweeps(self) -> tuple[Sweep, ...]:
        """The one sweep."""
        return (Sweep(self.at, self.duration, self.f_start, self.f_stop, self.spacing),)
