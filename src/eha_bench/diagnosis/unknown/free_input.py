"""How well an unknown input, free at every time, would explain a residual at one place.

Each window's residual is r = J s + H a + G d + e: s what calibrated parameters are off, a the
amplitudes of a curve, d the values of an unknown input at a few instants of the window, e noise of
variance 1. d and a are taken as normal, d of two parts: one that is constant over the window and
one that forgets in a tenth of it. Integrating d and a out leaves the marginal likelihood of r, with
s by restricted maximum likelihood; the sizes of d and a are those that make it largest. What an
input could reproduce without having to is paid for by that integral, so places may be compared
however much they are able to imitate. The place with the largest is the one whose equation is
short: the test by a diffusion term in every state's equation in turn, done window by window.

Sources: Kristensen, Madsen, Jørgensen, A method for systematic improvement of stochastic grey-box
models, Comput. Chem. Eng. 28 (2004) 1431, doi:10.1016/j.compchemeng.2003.10.003; Patterson,
Thompson, Biometrika 58 (1971) 545, doi:10.1093/biomet/58.3.545 (restricted likelihood).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.problem import Problem, soften

KNOTS = 12
"""Instants of a window at which an unknown input has its own value."""

_MEMORY = 0.1
_SIZES = (0.0, *(10.0**k for k in range(-2, 5)))
_FURTHER = (0.0, 1e-3, 1e-2, 1e-1, 1.0)
_CURVES = tuple(10.0**k for k in range(-1, 7))
_RIDGE = 1e-9


@dataclass(frozen=True)
class Support:
    """What speaks for an unknown input at one place.

    Attributes:
        log: marginal log likelihood, up to a constant that all places share.
        constant, rough: variances of the input's two parts, relative to what shows.
        step: (p + k,) best change of the scaled parameters, and best amplitudes of the curve.
        rest: (N,) what stays of the softened residual with all at their best.
    """

    log: float
    constant: float
    rough: float
    step: FloatArray
    rest: FloatArray


class FreeInput:
    """The residual over short windows, for any number of places where something may act.

    Args:
        problem: short windows. residual: (N,) whitened. matrix: (N, p) its Jacobian.
    """

    def __init__(self, problem: Problem, residual: FloatArray, matrix: FloatArray) -> None:
        self.rows = [piece.rows for piece in problem.pieces]
        self.soft, self.weight = soften(residual, problem.soft)
        self.matrix = matrix * self.weight[:, None]

    @property
    def nothing(self) -> float:
        """Marginal log likelihood where nothing acts."""
        table = np.column_stack([self.matrix, self.soft])
        return _marginal_likelihood(table.T @ table, self.matrix.shape[1], 1.0)[0]

    def support(self, influence: FloatArray) -> Support:
        """Return what speaks for an input that follows nothing.

        Args:
            influence: (N, m) change of the residual by each instant's value, m a multiple of KNOTS:
                several inputs, each free by itself, come one after the other.
        """
        none = np.zeros((self.soft.size, 0))
        grid = [(c, r) for c in _SIZES for r in _SIZES]
        return self._best(self.soft, none, influence * self.weight[:, None], grid, (1.0,))

    def support_of_curve(
        self,
        influence: FloatArray,
        curve: FloatArray,
        free: Support,
        amplitudes: FloatArray | None = None,
    ) -> Support:
        """Return what speaks for an input most of which follows a curve.

        Args:
            influence: as in `support`. curve: (N, k) change of the residual by each amplitude.
            free: what `support` gave; with a curve less is left to be free.
            amplitudes: (k,) that the residual has been simulated with (default: none).
        """
        columns = curve * self.weight[:, None]
        target = self.soft if amplitudes is None else self.soft - columns @ amplitudes
        constants = dict.fromkeys(free.constant * share for share in _FURTHER)
        roughs = dict.fromkeys(free.rough * share for share in _FURTHER)
        grid = [(c, r) for c in constants for r in roughs]
        weighted = influence * self.weight[:, None]
        return self._best(target, columns, weighted, grid, _CURVES)

    def _best(
        self,
        target: FloatArray,
        curve: FloatArray,
        influence: FloatArray,
        grid: Sequence[tuple[float, float]],
        sizes: Sequence[float],
    ) -> Support:
        p, k, m = self.matrix.shape[1], curve.shape[1], influence.shape[1]
        table = np.column_stack([self.matrix, curve, target, influence])
        gram = np.array([table[rows].T @ table[rows] for rows in self.rows])
        known = gram[:, : p + k + 1, : p + k + 1]
        cross = gram[:, : p + k + 1, p + k + 1 :]
        own = gram[:, p + k + 1 :, p + k + 1 :]
        scale = float(np.mean(np.einsum("wii->w", own))) / m + 1e-12
        best: tuple[float, tuple[float, float], FloatArray] | None = None
        for variances in grid:
            spread = _covariance(m, *variances) / scale
            inner = np.eye(m) + own @ spread
            volume = float(np.linalg.slogdet(inner)[1].sum())
            gain = spread @ np.linalg.inv(inner)
            left = (known - cross @ gain @ np.swapaxes(cross, 1, 2)).sum(axis=0)
            for size in sizes:
                log, step = _marginal_likelihood(left, p, scale / size)
                log -= 0.5 * volume
                if best is None or log > best[0]:
                    best = (log, variances, step)
        assert best is not None
        log, variances, step = best
        rest = self._rest(table, step, _covariance(m, *variances) / scale)
        return Support(log, *variances, step, rest)

    def _rest(self, table: FloatArray, step: FloatArray, spread: FloatArray) -> FloatArray:
        """Return what stays with parameters, curve and input at their most likely values."""
        at = step.size
        rest = table[:, at] + table[:, :at] @ step
        for rows in self.rows:
            part = table[rows, at + 1 :]
            inner = np.eye(spread.shape[0]) + spread @ (part.T @ part)
            rest[rows] -= part @ np.linalg.solve(inner, spread @ (part.T @ rest[rows]))
        return rest


def _covariance(count: int, constant: float, rough: float) -> FloatArray:
    """Return that of the values at a window's instants, (count, count)."""
    time = np.linspace(0.0, 1.0, KNOTS)
    one = constant + rough * np.exp(-np.abs(time[:, None] - time) / _MEMORY)
    return np.asarray(np.kron(np.eye(count // KNOTS), one), dtype=np.float64)


def _marginal_likelihood(left: FloatArray, p: int, precision: float) -> tuple[float, FloatArray]:
    """Return the log likelihood with parameters and curve integrated out, and their best values.

    Args:
        left: (p + k + 1,) square: products of parameters, curve and target, the input's part out.
        p: number of parameters, of which nothing is known beforehand.
        precision: of the curve's amplitudes, which are normal about zero.
    """
    size = left.shape[0] - 1
    normal = left[:size, :size].copy()
    free = np.arange(p)
    normal[free, free] *= 1.0 + _RIDGE
    normal[free, free] += _RIDGE
    bound = np.arange(p, size)
    normal[bound, bound] += precision
    step = -np.linalg.solve(normal, left[:size, size]) if size else np.zeros(0)
    square = float(left[size, size] + left[:size, size] @ step)
    volume = float(np.linalg.slogdet(normal)[1]) - bound.size * float(np.log(precision))
    return -0.5 * (square + volume), np.asarray(step, dtype=np.float64)
