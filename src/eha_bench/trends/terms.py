"""Steps and kinks in a series, scanned over all nights at once.

A step at night t adds a level from t on, a kink a slope from t on. With Q an orthonormal basis of
what is in the model already and r the residual, a column x would reduce the sum of squares by
(x'r)^2 / (x'x - |Q'x|^2); for steps and kinks all of these are cumulative sums.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from eha_bench.core.arrays import FloatArray


class Kind(StrEnum):
    """What changes at a night: the level, or the slope."""

    STEP = "step"
    KINK = "kink"


@dataclass(frozen=True, order=True)
class Term:
    """A change at the index of the first night of the new regime."""

    start: int
    kind: Kind

    def column(self, count: int) -> FloatArray:
        """Return what the term adds, shape (count,), for a size of one."""
        night = np.arange(count, dtype=np.float64) - self.start
        if self.kind is Kind.STEP:
            return (night >= 0).astype(np.float64)
        return np.maximum(night + 1.0, 0.0)


def design(terms: tuple[Term, ...] | list[Term], count: int) -> FloatArray:
    """Return the columns of the model, a constant first, shape (count, 1 + terms)."""
    return np.column_stack([np.ones(count), *(term.column(count) for term in terms)])


def _sums_to_end(values: FloatArray) -> FloatArray:
    """Return the sums of all values from each index on, along the first axis."""
    reverse: FloatArray = np.cumsum(values[::-1], axis=0)[::-1]
    return reverse


def gains(values: FloatArray, model: FloatArray, kind: Kind, count: int) -> FloatArray:
    """Return by how much a further term would reduce the sum of squares, for every start.

    Args:
        values: (n + m,), the nights first; what follows no term changes.
        model: (n + m, k) columns of what is in the model.
        kind: of the further term.
        count: n.

    Returns:
        (n,), 0 where it would add nothing or lies at the very ends.
    """
    basis, _ = np.linalg.qr(model)
    residual = values - basis @ (basis.T @ values)
    onto, within = _sums_to_end(residual[:count]), _sums_to_end(basis[:count])
    if kind is Kind.STEP:
        squares = np.arange(count, 0, -1, dtype=np.float64)
        edge = 3
    else:
        onto, within = _sums_to_end(onto), _sums_to_end(within)
        left = np.arange(count, 0, -1, dtype=np.float64)
        squares = left * (left + 1.0) * (2.0 * left + 1.0) / 6.0
        edge = 5
    own = squares - np.sum(within**2, axis=1)
    found = np.where(own > 1e-8 * squares, onto**2 / np.maximum(own, 1e-300), 0.0)
    found[:edge] = 0.0
    found[count - edge + 1 :] = 0.0
    return found


def pair_gains(
    values: FloatArray, model: FloatArray, kind: Kind, count: int, length: int
) -> FloatArray:
    """Return by how much a further term and its undoing `length` nights later would do so.

    Two steps make a passing change of level, two kinks a drift that ends. Arguments and result as
    for `gains`; shape (n - length,).
    """
    basis, _ = np.linalg.qr(model)
    residual = values - basis @ (basis.T @ values)
    onto, within = _sums_to_end(residual[:count]), _sums_to_end(basis[:count])
    if kind is Kind.STEP:
        squares = np.full(count - length, float(length))
    else:
        onto, within = _sums_to_end(onto), _sums_to_end(within)
        after = np.arange(count, length, -1, dtype=np.float64) - length
        squares = length * (length + 1.0) * (2.0 * length + 1.0) / 6.0 + length**2 * after
    onto, within = onto[:-length] - onto[length:], within[:-length] - within[length:]
    own = squares - np.sum(within**2, axis=1)
    found = np.where(own > 1e-8 * squares, onto**2 / np.maximum(own, 1e-300), 0.0)
    found[:3] = found[-3:] = 0.0
    return found
