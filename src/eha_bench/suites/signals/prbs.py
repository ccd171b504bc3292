"""A pseudo-random binary sequence of maximal length."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from eha_bench.core.arrays import FloatArray
from eha_bench.core.signal import Edge, Lines
from eha_bench.suites.signals.signal_model import Level, Moment, Seconds, SignalModel
from eha_bench.suites.signals.staircase import Staircase

USEFUL = 0.4
"""Lines are reported up to this fraction of the bit rate: beyond, less than 0.57 of the power."""


class Prbs(SignalModel):
    """Jumps between `low` and `high` every `bit` or not, as a shift register of `order` says.

    The sequence has 2^order - 1 bits and is run `periods` times. `seed` sets where in the sequence
    it begins. Before `at` it keeps `initial`, or the first bit's level.
    """

    kind: Literal["prbs"]
    low: Level
    high: Level
    bit: Seconds
    order: Annotated[int, Field(ge=2, le=20)] = 7
    periods: Annotated[int, Field(ge=1, le=10_000)] = 1
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    initial: Level | None = None
    at: Moment = 0.0

    @model_validator(mode="after")
    def _jumps(self) -> Prbs:
        if self.low >= self.high:
            raise ValueError("low has to lie below high")
        if self.periods * (2**self.order - 1) > 2**24:
            raise ValueError("there are more than 16 million bits: lower order or periods")
        return self

    @property
    def period(self) -> float:
        """Length of the sequence in s."""
        return float(2**self.order - 1) * self.bit

    @property
    def duration(self) -> float:
        """End of the last bit in s."""
        return self.at + self.periods * self.period

    @cached_property
    def _staircase(self) -> Staircase:
        from scipy.signal import max_len_seq  # slow to import, and few suites need it

        length = 2**self.order - 1
        shift = self.seed % length
        bits = np.roll(max_len_seq(self.order)[0], -shift)
        levels = np.where(np.tile(bits, self.periods), self.high, self.low)
        times = self.at + self.bit * np.arange(levels.size)
        initial = float(levels[0]) if self.initial is None else self.initial
        changed = np.diff(levels, prepend=initial) != 0
        return Staircase(
            initial, tuple(times[changed].tolist()), tuple(levels[changed].tolist()), self.duration
        )

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the reference at `time` in s, shape (n,) -> (n,)."""
        return self._staircase(time)

    @property
    def edges(self) -> tuple[Edge, ...]:
        """Every jump."""
        return self._staircase.edges

    @property
    def lines(self) -> tuple[Lines, ...]:
        """The periodic stretch, where there is more than one period."""
        if self.periods < 2:
            return ()
        last = max(1, int(USEFUL * (2**self.order - 1)))
        return (Lines(self.at, self.duration, self.period, tuple(range(1, last + 1))),)
