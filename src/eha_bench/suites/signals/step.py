"""A single step."""

from __future__ import annotations

import math
from typing import Literal

from eha_bench.core.arrays import FloatArray
from eha_bench.core.signal import Edge
from eha_bench.suites.signals.signal_model import Level, Moment, SignalModel
from eha_bench.suites.signals.staircase import Staircase


class Step(SignalModel):
    """From `initial` to `final` at the time `at`; never ends."""

    kind: Literal["step"]
    initial: Level = 0.0
    final: Level
    at: Moment = 0.0

    @property
    def duration(self) -> float:
        """Infinite."""
        return math.inf

    @property
    def _staircase(self) -> Staircase:
        return Staircase(self.initial, (self.at,), (self.final,), math.inf)

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the reference at `time` in s, shape (n,) -> (n,)."""
        return self._staircase(time)

    @property
    def edges(self) -> tuple[Edge, ...]:
        """The one jump."""
        return self._staircase.edges
