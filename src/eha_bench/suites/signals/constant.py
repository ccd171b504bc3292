"""A constant reference."""

from __future__ import annotations

import math
from typing import Literal

from eha_bench.core.arrays import FloatArray
from eha_bench.suites.signals.signal_model import Level, SignalModel


class Constant(SignalModel):
    """`value` all the time; never ends."""

    kind: Literal["constant"]
    value: Level

    @property
    def duration(self) -> float:
        """Infinite."""
        return math.inf

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the reference at `time` in s, shape (n,) -> (n,)."""
        import numpy as np

        return np.full(np.shape(time), self.value)
