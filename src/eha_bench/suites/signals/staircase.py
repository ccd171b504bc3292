"""Levels that are held one after the other: what steps, step sequences and PRBS have in common."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from eha_bench.core.arrays import FloatArray
from eha_bench.core.signal import Edge
from eha_bench.suites.signals.signal_model import TICK


@dataclass(frozen=True)
class Staircase:
    """Piecewise constant: `initial` before times[0], then levels[i] from times[i] on.

    Attributes:
        initial: level before the first time.
        times: (n,) s, increasing.
        levels: (n,) in SI.
        end: until when the last level lasts, s.
    """

    initial: float
    times: tuple[float, ...]
    levels: tuple[float, ...]
    end: float

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the level at `time` in s, shape (n,) -> (n,)."""
        import numpy as np

        index = np.searchsorted(self.times, np.asarray(time) + TICK, side="right")
        values: FloatArray = np.array([self.initial, *self.levels], dtype=np.float64)[index]
        return values

    @property
    def edges(self) -> tuple[Edge, ...]:
        """The jumps; equal levels in a row are one level."""
        jumps = [
            (time, before, after)
            for time, (before, after) in zip(
                self.times, pairwise((self.initial, *self.levels)), strict=True
            )
            if before != after
        ]
        ends = [*(time for time, _, _ in jumps), self.end][1:]
        return tuple(
            Edge(time, before, after, until)
            for (time, before, after), until in zip(jumps, ends, strict=True)
        )
