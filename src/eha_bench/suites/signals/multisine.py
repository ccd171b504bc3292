"""A periodic multisine: many frequencies at once, all of them on the lines of its period.

R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., 2012,
doi:10.1002/9781118287422: settled periods of several random-phase realisations tell noise (which
differs from period to period) from nonlinear distortion (which differs between realisations only).
"""

from __future__ import annotations

import math
from enum import StrEnum
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from eha_bench.core.arrays import FloatArray
from eha_bench.core.signal import Lines
from eha_bench.suites.signals.signal_model import (
    TICK,
    Hertz,
    Level,
    Moment,
    Seconds,
    SignalModel,
    within,
)

MOST_LINES = 20_000


class Harmonics(StrEnum):
    """Which lines between f_min and f_max are excited."""

    ALL = "all"
    ODD = "odd"


class Phases(StrEnum):
    """How the phases are chosen."""

    RANDOM = "random"
    SCHROEDER = "schroeder"


class Multisine(SignalModel):
    """offset + a sum of sines of equal amplitude, periodic with `period`.

    `amplitude` is the largest magnitude of the whole signal about the offset, so that it says what
    the actuator has to bear; all realisations share one scale, hence one spectrum. Each realisation
    is repeated for `periods` periods, the first of which are transient. Phases `random` (uniform,
    seeded; needed for more than one realisation) or `schroeder` (a low crest factor: M. Schroeder,
    doi:10.1109/TIT.1970.1054411).
    """

    kind: Literal["multisine"]
    amplitude: Level
    period: Seconds
    f_min: Hertz
    f_max: Hertz
    harmonics: Harmonics = Harmonics.ALL
    phases: Phases = Phases.RANDOM
    periods: Annotated[int, Field(ge=1, le=10_000)] = 4
    realisations: Annotated[int, Field(ge=1, le=1000)] = 1
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    offset: Level = 0.0
    at: Moment = 0.0

    @model_validator(mode="after")
    def _has_lines(self) -> Multisine:
        if self.f_max < self.f_min:
            raise ValueError("f_max lies below f_min")
        if (self.f_max - self.f_min) * self.period > MOST_LINES:
            raise ValueError(f"there are more than {MOST_LINES} lines: shorten the period")
        if not self.lines_excited:
            raise ValueError(
                f"no line of a period of {self.period:g} s lies between {self.f_min:g} and "
                f"{self.f_max:g} Hz: they are {1 / self.period:g} Hz apart"
            )
        if self.phases is Phases.SCHROEDER and self.realisations > 1:
            raise ValueError(
                "Schroeder's phases are the same in every realisation: use phases: random"
            )
        return self

    @property
    def lines_excited(self) -> tuple[int, ...]:
        """Harmonics (1-based) of the period that have a sine."""
        first = max(1, math.ceil(self.f_min * self.period - 1e-9))
        last = math.floor(self.f_max * self.period + 1e-9)
        step = 2 if self.harmonics is Harmonics.ODD else 1
        return tuple(range(first + (step == 2 and first % 2 == 0), last + 1, step))

    @property
    def _length(self) -> float:
        return self.periods * self.period

    @property
    def duration(self) -> float:
        """End of the last period in s."""
        return self.at + self.realisations * self._length

    @property
    def lines(self) -> tuple[Lines, ...]:
        """One periodic stretch for each realisation."""
        starts = [self.at + index * self._length for index in range(self.realisations)]
        stops = [*starts[1:], self.duration]
        return tuple(
            Lines(start, stop, self.period, self.lines_excited)
            for index, (start, stop) in enumerate(zip(starts, stops, strict=True))
        )

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the reference at `time` in s, shape (n,) -> (n,)."""
        held = within(time, self.at, self.duration) - self.at
        index = np.minimum((held + TICK) // self._length, self.realisations - 1).astype(int)
        values = np.empty_like(held)
        for realisation in np.unique(index):
            chosen = index == realisation
            values[chosen] = self._wave(int(realisation), held[chosen])
        return self.offset + self._scale * values

    def _wave(self, realisation: int, time: FloatArray) -> FloatArray:
        """Sum of sines of amplitude 1, at `time` in s from any period's start, (n,) -> (n,)."""
        turn = 2 * np.pi * np.mod(time / self.period, 1.0)
        wave = np.zeros_like(turn)
        for harmonic, phase in zip(self.lines_excited, self._phases[realisation], strict=True):
            wave += np.sin(harmonic * turn + phase)
        return wave

    @cached_property
    def _phases(self) -> FloatArray:
        """Phases in rad, shape (realisations, lines)."""
        count = len(self.lines_excited)
        if self.phases is Phases.SCHROEDER:
            number = np.arange(1, count + 1)
            return np.asarray(-np.pi * number * (number - 1) / count + np.pi / 2)[None, :]
        # raw output of a bit generator: unlike NumPy's distributions it is the same in all versions
        sequences = np.random.SeedSequence(self.seed).spawn(self.realisations)
        raw = [np.random.PCG64(sequence).random_raw(count) for sequence in sequences]
        phases: FloatArray = 2 * np.pi * (np.asarray(raw, dtype=np.float64) / 2.0**64)
        return phases

    @cached_property
    def _scale(self) -> float:
        """Amplitude of one sine, such that the largest magnitude is `amplitude`."""
        count = 32 * self.lines_excited[-1]  # dense enough to miss no peak by more than 0.5 %
        largest = 0.0
        for realisation in range(self.realisations):
            spectrum = np.zeros(count // 2 + 1, dtype=np.complex128)
            spectrum[list(self.lines_excited)] = np.exp(1j * self._phases[realisation])
            wave = np.fft.irfft(-1j * spectrum, n=count) * (count / 2)
            largest = max(largest, float(np.max(np.abs(wave))))
        return self.amplitude / largest
