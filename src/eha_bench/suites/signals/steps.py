"""A sequence of steps: each level held for a while, as in a staircase."""

from __future__ import annotations

from itertools import accumulate
from typing import Annotated, Literal

from pydantic import Field, model_validator

from eha_bench.core.arrays import FloatArray
from eha_bench.core.signal import Edge
from eha_bench.suites.signals.signal_model import Level, Moment, OneOrEachTime, SignalModel
from eha_bench.suites.signals.staircase import Staircase


class Steps(SignalModel):
    """From `initial` through `levels`, the first from `at` on, each held for `hold`.

    `hold` is one length of time for all levels, or a list of one for each.
    """

    kind: Literal["steps"]
    initial: Level = 0.0
    levels: Annotated[tuple[Level, ...], Field(min_length=1)]
    hold: OneOrEachTime
    at: Moment = 0.0

    @model_validator(mode="after")
    def _one_hold_each(self) -> Steps:
        if isinstance(self.hold, tuple) and len(self.hold) != len(self.levels):
            raise ValueError(
                f"{len(self.hold)} lengths in 'hold' for {len(self.levels)} levels: "
                "give one for all, or one for each"
            )
        return self

    @property
    def _holds(self) -> tuple[float, ...]:
        return self.hold if isinstance(self.hold, tuple) else (self.hold,) * len(self.levels)

    @property
    def duration(self) -> float:
        """End of the last level in s."""
        return self.at + sum(self._holds)

    @property
    def _staircase(self) -> Staircase:
        times = tuple(accumulate(self._holds[:-1], initial=self.at))
        return Staircase(self.initial, times, self.levels, self.duration)

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the reference at `time` in s, shape (n,) -> (n,)."""
        return self._staircase(time)

    @property
    def edges(self) -> tuple[Edge, ...]:
        """Every jump."""
        return self._staircase.edges
