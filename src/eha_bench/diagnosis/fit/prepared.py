"""One window ready to be simulated, and how its start state is weighed.

r = e - U z - W y, z and y ~ N(0, 1): what is left of a window is noise, what its start state and
its inputs' noise make of it (U), and what the zeros of its sensors do where they wander (W,
`problem`). A zero moves the readings of its own sensor alone, so W is a small block for each of
them, and the white residual is (1 + V V')^(-1/2) (1 + W W')^(-1/2) r with V = (1 + W W')^(-1/2) U.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray
from eha_bench.diagnosis.data.windows import Window
from eha_bench.diagnosis.fit.input_noise import InputNoise
from eha_bench.diagnosis.fit.instants import Instants
from eha_bench.plants.plant import Drive

_SMALL, _SMALLEST = 1e-10, 1e-4
"""Squares of what is not a column, relative to the largest one, or to the noise."""


@dataclass(frozen=True)
class WanderingZero:
    """What one sensor's zero does to its own readings of a window.

    Attributes:
        rows: (n,) these readings. basis, shrink: as a window has them, (n, k) and (k,).
    """

    rows: IndexArray
    basis: FloatArray
    shrink: FloatArray

    @classmethod
    def of(cls, rows: IndexArray, columns: FloatArray) -> WanderingZero:
        """Return it from its columns of W, (n, k)."""
        basis, sizes = orthonormal_of_many(columns)
        return cls(rows, basis, _shrink(sizes))

    def without(self, values: FloatArray) -> FloatArray:
        """Return (1 + W W')^(-1/2) of a residual (N,), or of columns (N, k)."""
        out = values.copy()
        own = values[self.rows]
        out[self.rows] = own - (self.basis * self.shrink) @ (self.basis.T @ own)
        return out


@dataclass
class Prepared:
    """One window ready to be simulated.

    Attributes:
        window: what it is of. drive: its inputs, with some ticks before it.
        columns: outputs of the plant that are compared. pick: (N,) which of their readings are
            there, of (ticks, columns) in one row. places: (N,) the same in what is simulated.
        target: (N,) readings, in their noise. scale: (N,) that noise, SI.
        basis, shrink: V as an orthonormal basis (N, k), and 1 - (1 + s^2)^(-1/2) of its sizes.
        zeros: of its sensors, where they wander.
        shaken, lost: what the inputs' noise does, and inputs that were lost.
        weights: (N,) of rows that what is too fast for U shakes as well; None where nothing is.
        whitening: of noise that remembers. instants: when each reading was taken.
        starts: states that are uncertain at the start, each with its spread. moved: by how many of
            these the start is moved from the measured one, (k,). offset: U of these times `moved`,
            (N,).
        cost: sum of squares of the white residual where it was prepared.
    """

    window: Window
    drive: Drive
    columns: IndexArray
    pick: IndexArray
    places: IndexArray
    target: FloatArray
    scale: FloatArray
    basis: FloatArray
    shrink: FloatArray
    shaken: InputNoise | None = None
    whitening: csr_array | None = None
    instants: Instants | None = None
    lost: InputNoise | None = None
    weights: FloatArray | None = None
    starts: Mapping[str, float] = field(default_factory=dict)
    moved: FloatArray | None = None
    offset: FloatArray | None = None
    cost: float = 0.0
    zeros: tuple[WanderingZero, ...] = ()

    @property
    def of_inputs(self) -> FloatArray:
        """What the inputs' noise, and inputs that were lost, do to the residual, (N, k)."""
        columns = [item.columns for item in (self.shaken, self.lost) if item is not None]
        return np.column_stack([np.zeros((self.pick.size, 0)), *columns])

    @property
    def shift(self) -> FloatArray:
        """By how much the start is moved from the measured one, in its spreads, (k,)."""
        return np.zeros(len(self.starts)) if self.moved is None else self.moved

    def span(
        self, columns: FloatArray, zeros: Sequence[tuple[IndexArray, FloatArray]] = ()
    ) -> None:
        """Take U, (N, k), the rows and columns of W of each sensor, and the weights of rows."""
        self.weights = self._weights()
        weights = np.ones(self.pick.size) if self.weights is None else self.weights
        self.zeros = tuple(WanderingZero.of(rows, own * weights[rows, None]) for rows, own in zeros)
        columns = self._without_zeros(columns * weights[:, None])
        if columns.shape[1] == 0:
            self.basis, self.shrink = columns, np.zeros(0)
            return
        self.basis, sizes = orthonormal(columns)
        self.shrink = _shrink(sizes)

    def from_start(self, residual: FloatArray) -> FloatArray:
        """Return a residual as it were from the measured start, to first order, (N,)."""
        return residual if self.offset is None else residual - self.offset

    def white(self, residual: FloatArray) -> FloatArray:
        """Return what is white of a residual, (N,)."""
        residual = self._without_zeros(self._weighted(residual))
        if self.shrink.size == 0:
            return residual
        return residual - self.basis @ (self.shrink * (self.basis.T @ residual))

    def at_best(self, residual: FloatArray) -> FloatArray:
        """Return C^(-1) of a residual: what is left from the best start, (N,)."""
        residual = self._without_zeros(self._weighted(residual))
        if self.shrink.size:
            # 1 - 1 / (1 + s^2), from 1 - 1 / sqrt(1 + s^2)
            share = 1.0 - (1.0 - self.shrink) ** 2
            residual = residual - self.basis @ (share * (self.basis.T @ residual))
        return self._without_zeros(residual)

    def _weighted(self, residual: FloatArray) -> FloatArray:
        return residual if self.weights is None else residual * self.weights

    def _without_zeros(self, values: FloatArray) -> FloatArray:
        for zero in self.zeros:
            values = zero.without(values)
        return values

    def _weights(self) -> FloatArray | None:
        """Return 1 / sqrt(1 + d) of each row, d the variance that is too fast for U, by channel."""
        if self.shaken is None or not self.shaken.faster.any():
            return None
        channels = self.pick % self.columns.size
        count = np.maximum(np.bincount(channels, minlength=self.columns.size), 1)
        squares = np.bincount(channels, self.shaken.faster**2, minlength=self.columns.size)
        return np.asarray(1.0 / np.sqrt(1.0 + squares / count)[channels], dtype=np.float64)

    @property
    def length(self) -> float:
        """Time that a simulation of it covers, s."""
        time = self.window.measured.time
        return float(time[self.window.last - 1] - time[self.window.first])


def best_start(
    residual: FloatArray,
    slopes: FloatArray,
    others: FloatArray,
    moved: FloatArray,
    rows: BoolArray,
) -> tuple[FloatArray, float]:
    """Return the best start by some rows, and what those cost with it.

    Args:
        residual: (N,) where the start is `moved`, (k,) in its spreads. slopes: (N, k) there.
        others: (N, m) what else shakes it. rows: (N,) which of them count.
    """
    error = (residual - slopes @ moved)[rows]
    columns = np.column_stack([slopes, others])[rows]
    # stacked: where a simulation runs away with its start, squares of its slopes would drown the 1
    stacked = np.vstack([columns, np.eye(columns.shape[1])])
    best = -np.linalg.lstsq(stacked, np.append(error, np.zeros(columns.shape[1])))[0]
    start = np.asarray(best[: moved.size], dtype=np.float64)
    return start, float(error @ (error + columns @ best))


def _shrink(sizes: FloatArray) -> FloatArray:
    return np.asarray(1.0 - 1.0 / np.sqrt(1.0 + sizes * sizes), dtype=np.float64)


def orthonormal(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return an orthonormal basis of columns, and how large they are along each of it."""
    basis, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return basis, sizes


def orthonormal_of_many(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the same by the columns' products, at a fifth of the cost."""
    if not columns.shape[1]:
        # over a few readings a zero wanders by less than their noise
        return columns, np.zeros(0)
    values, vectors = np.linalg.eigh(columns.T @ columns)
    keep = values > max(_SMALL * float(values[-1]), _SMALLEST)
    sizes = np.sqrt(values[keep])
    return columns @ (vectors[:, keep] / sizes), sizes
