"""A signal cut to the length of its trial, or held at its last value until the trial's end."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from eha_bench.core.arrays import FloatArray
from eha_bench.core.signal import Edge, FromRecording, Lines, Signal, Sweep, Tone


@dataclass(frozen=True)
class Excerpt(Signal):
    """The first `length` seconds of `whole`; what lasts to the signal's end is held or cut.

    Attributes:
        whole: the signal as the suite wrote it, whether or not it ends.
        length: duration of the trial in s.
    """

    whole: Signal
    length: float

    @property
    def duration(self) -> float:
        """Length of the trial in s."""
        return self.length

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the reference at `time`, shape (n,) -> (n,)."""
        import numpy as np

        return self.whole(np.asarray(time, dtype=np.float64))

    @cached_property
    def edges(self) -> tuple[Edge, ...]:
        """Jumps before the end; the last level is held until the end of the trial."""
        cut = []
        for edge in self.whole.edges:
            held = edge.until >= min(self.whole.duration, self.length)
            if edge.time < self.length:
                cut.append(replace(edge, until=self.length) if held else edge)
        return tuple(cut)

    @cached_property
    def tones(self) -> tuple[Tone, ...]:
        """Stretches of one sine, as far as they lie within the trial."""
        return tuple(
            replace(tone, stop=min(tone.stop, self.length))
            for tone in self.whole.tones
            if tone.start < self.length
        )

    @cached_property
    def lines(self) -> tuple[Lines, ...]:
        """Periodic multisines, as far as they lie within the trial."""
        return tuple(
            replace(lines, stop=min(lines.stop, self.length))
            for lines in self.whole.lines
            if lines.start < self.length
        )

    @cached_property
    def sweeps(self) -> tuple[Sweep, ...]:
        """Chirps that end within the trial; a chirp cut short ends at the frequency reached."""
        return tuple(
            sweep if sweep.stop <= self.length else sweep.until(self.length)
            for sweep in self.whole.sweeps
            if sweep.start < self.length
        )


def signal_of_length(signal: Signal, length: float) -> Signal:
    """Return the signal for a trial of `length` s; one from a recording is as long as that."""
    return signal if isinstance(signal, FromRecording) else Excerpt(signal, length)
