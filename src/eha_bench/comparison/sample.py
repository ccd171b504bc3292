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
        low, high: (n,) bounds of each value's own 95 % interval; NaN where unknown.
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

    def distance_from(self, aim: float) -> Sample:
        """Return the distances from `aim`, whose intervals begin at 0 where they hold it."""
        values = np.abs(self.values - aim)
        ends = np.abs(np.stack((self.low, self.high)) - aim)
        holds = (self.low <= aim) & (aim <= self.high)
        return Sample(values, np.where(holds, 0.0, ends.min(axis=0)), ends.max(axis=0))
