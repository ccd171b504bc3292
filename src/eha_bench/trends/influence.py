"""What is known to act on every night, by an amount that all nights share and nobody knows well.

The oil is warmer on some nights, and what a kelvin does to the machine was learned on a few of
them. An error of that slope is no scatter: it moves all nights together, in proportion to their
temperature, and does not average out. With c the columns of such influences and u their strengths,

    y = level + changes + c u + scatter,    u ~ N(centre, 1) beforehand,

so that the covariance of the nights is that of the scatter plus c c'. Least squares hold exactly
that where every strength gets a column of its own and a row that says what was believed of it
(mixed estimation: Theil and Goldberger, International Economic Review 2 (1961) 65,
doi:10.2307/2525589); tests of a change then count what the influence may have done instead.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.arrays import FloatArray


@dataclass(frozen=True)
class Influence:
    """Influences on the nights of one series.

    Attributes:
        columns: (n, m) what a strength of one does to each night, in the unit of the values.
        centre: (m,) strengths believed beforehand, each with a standard deviation of one.
    """

    columns: FloatArray
    centre: FloatArray

    @staticmethod
    def none(count: int) -> Influence:
        """Return no influence on a number of nights."""
        return Influence(np.zeros((count, 0)), np.zeros(0))

    @property
    def count(self) -> int:
        """How many strengths there are."""
        return self.centre.size

    def since(self, start: int) -> Influence:
        """Return that on the nights from one on."""
        return replace(self, columns=self.columns[start:])

    def without(self, strengths: FloatArray) -> Influence:
        """Return what is left after `columns @ strengths` was taken from the values."""
        return replace(self, centre=self.centre - strengths)

    def scaled(self, sigma: float) -> Influence:
        """Return it for values in units of a scatter."""
        return replace(self, columns=self.columns / sigma)

    def summed(self, least: float) -> Influence:
        """Return the few independent sums of strengths that do more than a size to a night.

        Strengths that act alike on all nights cannot be told apart and need not be.
        """
        if not self.columns.size:
            return Influence.none(self.columns.shape[0])
        left, sizes, right = np.linalg.svd(self.columns, full_matrices=False)
        kept = sizes > least
        return Influence(left[:, kept] * sizes[kept], right[kept] @ self.centre)

    def beside(self, matrix: FloatArray, weight: float) -> FloatArray:
        """Return a design with the influences' columns, and their beliefs as further rows.

        Args:
            matrix: (n, k). weight: of a belief, in units of the scatter.
        """
        rows = np.zeros((self.count, matrix.shape[1]))
        beliefs = weight * np.eye(self.count)
        return np.block([[matrix, self.columns], [rows, beliefs]])

    def with_beliefs(self, values: FloatArray, weight: float) -> FloatArray:
        """Return values, (n,), followed by what is believed of the strengths, (n + m,)."""
        return np.concatenate((values, weight * self.centre))
