"""The values of one metric on the two sides, ready to be compared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray


@dataclass(frozen=True)
class Sample:
    """A metric's values over the repeats of one side, SI, all finite.

    Attributes:
        values: (n,).
        low, high: (n,) bounds of each value's own 95 % interval; NaN where unknown, infinite at an
            end that is open.
    """

    values: FloatArray
    low: FloatArray
    high: FloatArray

    @staticmethod
    def of(values: FloatArray | list[float]) -> Sample:
        """Return a sample whose values have no intervals."""
        array = np.asarray(values, dtype=np.float64)
        unknown = np.full(array.shape, np.nan)
        return Sample(array, unknown, unknown)

    def __len__(self) -> int:
        """How many repeats were scored."""
        return int(self.values.size)

    @property
    def mean(self) -> float:
        """Mean over the repeats; NaN if there are none."""
        return float(self.values.mean()) if self.values.size else float("nan")

    @property
    def variance(self) -> float:
        """Unbiased variance over the repeats; NaN for fewer than two."""
        return float(self.values.var(ddof=1)) if self.values.size > 1 else float("nan")

    @property
    def open_below(self) -> bool:
        """Whether one of the values may be any lower than it says."""
        return bool(np.any(np.isneginf(self.low)))

    @property
    def open_above(self) -> bool:
        """Whether one of the values may be any higher than it says, as a clipped peak may."""
        return bool(np.any(np.isposinf(self.high)))

    def distance_from(self, aim: float) -> Sample:
        """Return the distances from `aim`, whose intervals begin at 0 where they hold it."""
        values = np.abs(self.values - aim)
        ends = np.abs(np.stack((self.low, self.high)) - aim)
        holds = (self.low <= aim) & (aim <= self.high)
        # what may be anything beyond a value that the aim is beyond, too, may be nearer or farther
        across = np.isinf(self.low) & (self.values > aim) | np.isinf(self.high) & (
            self.values < aim
        )
        nearest = np.where(holds, 0.0, ends.min(axis=0))
        return Sample(values, np.where(across, -np.inf, nearest), ends.max(axis=0))
