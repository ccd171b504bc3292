"""One sine after the other: the slow and certain way to a frequency response."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from eha_bench.core.arrays import FloatArray
from eha_bench.core.signal import Tone
from eha_bench.suites.signals.frequencies import Frequencies, FrequencyGrid
from eha_bench.suites.signals.signal_model import (
    Level,
    Moment,
    OneOrEachLevel,
    Seconds,
    SignalModel,
    within,
)


class SteppedSine(SignalModel):
    """offset + amplitude * sin(2 pi f t) at each of the `frequencies`, in their order.

    Every frequency lasts a whole number of its periods, so that the signal is continuous: at least
    `cycles`, and as many more as fill the time `dwell`. `amplitude` (the peak value) is one for
    all frequencies, or a list of one for each.
    """

    kind: Literal["stepped_sine"]
    amplitude: OneOrEachLevel
    frequencies: Frequencies
    cycles: Annotated[int, Field(ge=1, le=10_000)] = 8
    dwell: Seconds | None = None
    offset: Level = 0.0
    at: Moment = 0.0

    @model_validator(mode="after")
    def _one_amplitude_each(self) -> SteppedSine:
        given = len(self.amplitude) if isinstance(self.amplitude, tuple) else None
        if given is not None and given != len(self._frequencies):
            raise ValueError(
                f"{given} amplitudes for {len(self._frequencies)} frequencies: "
                "give one for all, or one for each"
            )
        return self

    @property
    def _frequencies(self) -> tuple[float, ...]:
        return (
            self.frequencies.values()
            if isinstance(self.frequencies, FrequencyGrid)
            else self.frequencies
        )

    @property
    def tones(self) -> tuple[Tone, ...]:
        """One stretch of sine for each frequency."""
        found = []
        start = self.at
        frequencies = self._frequencies
        amplitudes = (
            self.amplitude
            if isinstance(self.amplitude, tuple)
            else (self.amplitude,) * len(frequencies)
        )
        for frequency, amplitude in zip(frequencies, amplitudes, strict=True):
            fill = math.ceil((self.dwell or 0.0) * frequency - 1e-9)
            stop = start + max(self.cycles, fill) / frequency
            found.append(Tone(start, stop, frequency, amplitude, self.offset))
            start = stop
        return tuple(found)

    @property
    def duration(self) -> float:
        """End of the last frequency in s."""
        return self.tones[-1].stop

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the reference at `time` in s, shape (n,) -> (n,)."""
        tones = self.tones
        held = within(time, self.at, self.duration)
        starts = np.array([tone.start for tone in tones])
        index = np.clip(np.searchsorted(starts, held, side="right") - 1, 0, None)
        frequency = np.array([tone.frequency for tone in tones])[index]
        amplitude = np.array([tone.amplitude for tone in tones])[index]
        angle = 2 * np.pi * frequency * (held - starts[index])
        values: FloatArray = self.offset + amplitude * np.sin(angle)
        return values
