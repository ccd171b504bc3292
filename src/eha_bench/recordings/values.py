"""What the values of one field, column or channel look like: range, gaps in it, resolution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.arrays import FloatArray

_MOST = 50_000
"""Different values that a resolution is looked for among."""
_SAME = 1e-9
"""Values this share of the range apart are the same but for rounding."""
_WHOLE = 0.1
"""A step is a whole multiple of another if it is so near to one."""
_FEW = 0.05
_FAR = 30.0
"""Steps so many times the smallest tell nothing: their rounding adds up."""
_FINEST = 1e-6
"""Share of the range below which steps cannot be distinguished from noise."""


@dataclass(frozen=True)
class ValueInformation:
    """Values of one field, column or channel, as they are stored (channels of ours: SI).

    Attributes:
        name: field path, column or channel.
        unit: as the file says it, empty if it says none.
        minimum, maximum: of the finite values; NaN if there is none.
        nan_share: share of the samples that are NaN or infinite.
        resolution: step between neighbouring values; 0 where they have no common step, NaN where
            there are fewer than three different ones.
        step: the median step of values that all rise, as those of a time do; NaN for others.
    """

    name: str
    unit: str
    minimum: float
    maximum: float
    nan_share: float
    resolution: float
    step: float = float("nan")

    @classmethod
    def of(cls, name: str, unit: str, values: NDArray[Any]) -> ValueInformation:
        """Look at values, shape (n,)."""
        numbers = np.asarray(values, dtype=np.float64)
        finite = numbers[np.isfinite(numbers)]
        if not finite.size:
            share = 1.0 if numbers.size else float("nan")
            nothing = float("nan")
            return cls(name, unit, nothing, nothing, share, nothing)
        return cls(
            name,
            unit,
            float(finite.min()),
            float(finite.max()),
            1.0 - finite.size / numbers.size,
            resolution(finite),
            _rise(numbers),
        )


def resolution(values: FloatArray) -> float:
    """Return the step that all finite values (n,) are whole multiples apart; 0 if there is none.

    A converter with steps of any size shows in it, also after a scale and an offset. NaN for fewer
    than three different values.
    """
    with np.errstate(all="ignore"):
        return _step(np.unique(values[:_MOST]))


def _rise(values: FloatArray) -> float:
    """Return the median step of values (n,) of which each is above the one before, else NaN."""
    with np.errstate(all="ignore"):
        steps = np.diff(values)
    if not steps.size or not (steps > 0.0).all() or not np.isfinite(steps).all():
        return float("nan")
    return float(np.median(steps))


def _step(different: FloatArray) -> float:
    """Return the common step of values in order, (n,)."""
    span = float(different[-1] - different[0]) if different.size else 0.0
    if different.size < 3 or not span > 0.0 or not np.isfinite(span):
        return float("nan")
    steps = np.diff(different)
    steps = steps[steps > _SAME * span]
    if not steps.size:
        return float("nan")
    step = float(np.median(steps[steps < 1.5 * steps.min()]))  # one alone carries its rounding
    multiples = steps / step
    near = multiples < _FAR
    if not np.count_nonzero(near):
        return 0.0
    # over many steps their rounding averages out
    step = float(steps[near].sum() / np.round(multiples[near]).sum())
    off = np.abs(steps[near] / step - np.round(multiples[near])) > _WHOLE
    return 0.0 if np.mean(off) > _FEW or step < _FINEST * span else step
