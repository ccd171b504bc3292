"""The reference that a trial asks for: a function of time that knows its own features.

Metrics score by features, not by the signal's class: an `Edge` is a place where a step response
is measured, a `Tone` a stretch of one sine, `Lines` a periodic multisine, a `Sweep` a chirp.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from enum import StrEnum

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import InputError


@dataclass(frozen=True)
class Edge:
    """A jump of the reference: at `time` (s) from `before` to `after`, held until `until` (s)."""

    time: float
    before: float
    after: float
    until: float


@dataclass(frozen=True)
class Tone:
    """A stretch [start, stop) in s of offset + amplitude * sin(2 pi f (t - start) + phase)."""

    start: float
    stop: float
    frequency: float
    amplitude: float
    offset: float = 0.0
    phase: float = 0.0


@dataclass(frozen=True)
class Lines:
    """A periodic multisine in [start, stop): period in s, and the excited harmonics (1-based)."""

    start: float
    stop: float
    period: float
    harmonics: tuple[int, ...]


class Spacing(StrEnum):
    """How a sweep's frequency grows, or how frequencies are spaced."""

    LINEAR = "linear"
    LOGARITHMIC = "logarithmic"


@dataclass(frozen=True)
class Sweep:
    """A sine sweep in [start, stop) s from f_start to f_stop in Hz."""

    start: float
    stop: float
    f_start: float
    f_stop: float
    spacing: Spacing = Spacing.LINEAR

    def frequency(self, time: float) -> float:
        """Return the instantaneous frequency in Hz at a time in s within the sweep."""
        done = (time - self.start) / (self.stop - self.start)
        if self.spacing is Spacing.LINEAR:
            return self.f_start + (self.f_stop - self.f_start) * done
        return float(self.f_start * (self.f_stop / self.f_start) ** done)

    def until(self, stop: float) -> Sweep:
        """Return the part of the sweep before `stop` in s."""
        return replace(self, stop=stop, f_stop=self.frequency(stop))


class Signal(ABC):
    """A reference signal; times in s from the start of the trial, values SI.

    Before time 0 a signal keeps the value from before its first edge (what the trial settles at),
    after its end the last one, so that it may be called with any time.
    """

    @property
    @abstractmethod
    def duration(self) -> float:
        """Length of the signal in s; infinite for one that never ends."""

    @abstractmethod
    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the reference at `time`, shape (n,) -> (n,)."""

    @property
    def edges(self) -> tuple[Edge, ...]:
        """Jumps of the reference, in order of time."""
        return ()

    @property
    def tones(self) -> tuple[Tone, ...]:
        """Stretches of one sine, in order of time."""
        return ()

    @property
    def lines(self) -> tuple[Lines, ...]:
        """Periodic multisines, in order of time."""
        return ()

    @property
    def sweeps(self) -> tuple[Sweep, ...]:
        """Chirps, in order of time."""
        return ()


class FromRecording(Signal):
    """A reference that is only known from a recording: scored by what its `reference` channel did.

    It cannot be run; the metrics put in its place what they find in the recording.
    """

    @property
    def duration(self) -> float:
        """A day: as long as the recording, which is no longer than that."""
        return 86_400.0

    def __call__(self, time: FloatArray) -> FloatArray:  # noqa: ARG002 - there is none
        """Refuse to be a reference.

        Raises:
            InputError: always.
        """
        raise InputError(
            "the signal 'recorded' has no reference",
            hint="it scores recordings made elsewhere (eha-bench score) and cannot be run",
        )
