"""Signals found in a recording's own reference, for trials that do not describe theirs.

A trial with the signal `recorded` asks for whatever the `reference` channel did. Its jumps become
edges; where it does not jump and one sine of at least two periods explains it to within 2 % (RMS
of the rest over the amplitude, four-parameter fit of IEEE Std 1057), it becomes a tone. Anything
else has no features: it is then scored for tracking only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.recording import Recording
from eha_bench.core.signal import Edge, FromRecording, Signal, Tone
from eha_bench.core.trial import Trial
from eha_bench.metrics.sine_fit import fit4
from eha_bench.metrics.window import SIGNAL_START, jumps

_SINE_REST = 0.02
_PERIODS = 2


@dataclass(frozen=True)
class SampledSignal(Signal):
    """A reference as it was sampled: time (n,) s from its start, values (n,), held in between."""

    time: FloatArray
    values: FloatArray

    @property
    def duration(self) -> float:
        """From the first to the last sample, and one period more."""
        return float(2 * self.time[-1] - self.time[-2])

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the last sample at or before each `time`, (n,) -> (n,)."""
        index = np.searchsorted(self.time, np.asarray(time) + 1e-9, side="right") - 1
        held: FloatArray = self.values[np.clip(index, 0, self.time.size - 1)]
        return held

    @cached_property
    def _edges(self) -> tuple[Edge, ...]:
        return tuple(jumps(self.time, self.values)) if np.ptp(self.values) > 0 else ()

    @property
    def edges(self) -> tuple[Edge, ...]:
        """Every jump of the samples."""
        return self._edges

    @property
    def tones(self) -> tuple[Tone, ...]:
        """The one sine that the samples are, if they are one."""
        return () if self._edges else self._tones

    @cached_property
    def _tones(self) -> tuple[Tone, ...]:
        if np.ptp(self.values) == 0:
            return ()
        spectrum = np.abs(np.fft.rfft(self.values - self.values.mean()))
        strongest = int(np.argmax(spectrum))
        fit = fit4(self.time, self.values, strongest / self.duration)
        rest = float(np.sqrt(np.mean(fit.residual**2)))
        # a slow arc of a huge sine fits any smooth stretch: ask for whole periods that are there
        if fit.frequency * self.duration < _PERIODS or fit.amplitude > np.ptp(self.values):
            return ()
        if not rest <= _SINE_REST * fit.amplitude:
            return ()
        return (Tone(0.0, self.duration, fit.frequency, fit.amplitude, fit.offset, fit.phase),)


def bind(recording: Recording, trial: Trial) -> tuple[Recording, Trial]:
    """Return both with the recording's own reference in place of a signal that is not known.

    A recording without a usable reference comes back as it is; its scores then say so.
    """
    if not isinstance(trial.signal, FromRecording) or len(recording) < 8:
        return recording, trial
    reference = recording.values.get("reference")
    if reference is None or not np.all(np.isfinite(reference)):
        return recording, trial
    signal = SampledSignal(recording.time - recording.time[0], reference)
    start = {SIGNAL_START: repr(float(recording.time[0]))}
    duration = min(trial.duration, signal.duration)
    return (
        replace(recording, metadata={**recording.metadata, **start}),
        replace(trial, signal=signal, duration=duration),
    )
