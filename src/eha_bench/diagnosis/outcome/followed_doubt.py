"""A number, or a scale, fitted beside what is calibrated.

Where readings tell nothing, the cost has a narrow valley along which parameters follow powers of
one another. In their logarithms it is straight, and differences to both sides see it: by one-sided
ones it would seem to rise. It bends where a sum is what readings tell, so what is calibrated is
fitted again behind each step.

Source: Björck, Numerical Methods for Least Squares Problems, SIAM 1996, section 9.2 (Gauss-Newton).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.least_squares import Fit, Free, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem, soften
from eha_bench.diagnosis.outcome.doubt import Doubt

AnyDoubt = TypeVar("AnyDoubt", bound=Doubt)

_DIFFERENCE = 0.01
"""Of a logarithm, to either side, by which a slope is taken."""
_STEPS = 4
_SHARES = (0.5, 1.0, 2.0)
"""Of a step, that are tried: the valley is longer than its slopes promise, or shorter."""
_ITERATIONS = 4
_FURTHEST = 10.0
"""Factor by which what is declared may be off at most."""
_MOST = 5.0
"""Longest step of a logarithm: what readings do not tell has none."""
_WORTH = 1.0
"""Fall of the cost by a step from which the next one is tried."""


@dataclass(frozen=True)
class Promised:
    """What the slopes at a fit promise of a doubt.

    Attributes:
        factor: to be multiplied by at the bottom of the cost. fall: of the cost there.
    """

    factor: float
    fall: float


@dataclass(frozen=True)
class Followed:
    """A doubt at its best: the factor of what was declared, and the cost and parameters with it."""

    doubt: Doubt
    factor: float
    cost: float
    vector: FloatArray


def promised(base: Problem, fit: Fit, doubts: Iterable[AnyDoubt]) -> dict[AnyDoubt, Promised]:
    """Return what each doubt promises by the slopes at a fit, as all is declared.

    Args:
        base: prepared. fit: of what is calibrated. doubts: about what is not.
    """
    vector = fit.vector
    residual = base.residual(vector)
    slopes = _slopes(base, fit.free, vector)
    return {
        doubt: _promised(slopes, _slope(doubt, base, vector, 1.0), residual, base.soft)
        for doubt in doubts
    }


def promised_further(base: Problem, fit: Fit, doubt: Doubt, factor: float) -> Promised:
    """Return what a doubt promises by the slopes at a fit with a factor of what was declared.

    Args:
        base: prepared, as all is declared. fit: of what is calibrated, with that factor.
    """
    problem, vector = doubt.times(base, fit.vector, factor)
    slopes = _slopes(problem, fit.free, vector)
    own = _slope(doubt, base, vector, factor)
    return _promised(slopes, own, problem.residual(vector), problem.soft)


def _promised(slopes: FloatArray, own: FloatArray, residual: FloatArray, soft: float) -> Promised:
    step, fall = _step(slopes, own, residual, soft)
    return Promised(float(np.exp(np.clip(step[-1], -_MOST, _MOST))), fall)


def followed(base: Problem, fit: Fit, doubt: Doubt) -> Followed:
    """Return a doubt fitted beside what is calibrated, as far down as it goes.

    Args:
        base: prepared, as all is declared. fit: of what is calibrated, with its cost.
    """
    vector, factor, cost = fit.vector, 1.0, fit.cost
    for _ in range(_STEPS):
        problem, vector = doubt.times(base, vector, factor)
        slopes = _slopes(problem, fit.free, vector)
        own = _slope(doubt, base, vector, factor)
        step, _ = _step(slopes, own, problem.residual(vector), problem.soft)
        ends: list[tuple[float, Fit]] = []
        for share in _SHARES:
            moved = factor * float(np.exp(share * step[-1]))
            if 1.0 / _FURTHEST < moved < _FURTHEST:
                start = _along(fit.free, vector, share * step[:-1])
                other, start = doubt.times(base, start, moved)
                ends.append((moved, _fitted(other, fit, start)))
        if not ends:
            break
        best, end = min(ends, key=lambda pair: pair[1].cost)
        if not end.cost < cost - _WORTH:
            break
        factor, cost, vector = best, end.cost, end.vector
    return Followed(doubt, factor, cost, vector)


def _along(free: Sequence[Free], vector: FloatArray, step: FloatArray) -> FloatArray:
    """Return parameters moved along the valley."""
    moved = vector.copy()
    for item, change in zip(free, step, strict=True):
        moved[item.at] = _moved(item, vector, change)
    return moved


def _fitted(problem: Problem, fit: Fit, vector: FloatArray) -> Fit:
    """Return the fit of what is calibrated from some parameters, with a fit's slopes to begin."""
    return levenberg_marquardt(
        problem, vector, fit.free, known=fit.columns, refresh=0, iterations=_ITERATIONS
    )


def _slopes(problem: Problem, free: Sequence[Free], vector: FloatArray) -> FloatArray:
    """Return what the residual changes by with what is calibrated, as `_moved` counts, (N, p)."""
    columns = []
    for item in free:
        ends, inside = [], 0
        for change in (_DIFFERENCE, -_DIFFERENCE):
            moved = vector.copy()
            moved[item.at] = _moved(item, vector, change)
            inside += moved[item.at] != vector[item.at]
            ends.append(problem.residual(moved))
        # at a bound it moves to one side alone
        columns.append((ends[0] - ends[1]) / (max(inside, 1) * _DIFFERENCE))
    return np.column_stack(columns) if columns else np.zeros((problem.residual(vector).size, 0))


def _slope(doubt: Doubt, problem: Problem, vector: FloatArray, factor: float) -> FloatArray:
    """Return what the residual changes by with the logarithm of a doubt's factor, (N,)."""
    ends = []
    for change in (_DIFFERENCE, -_DIFFERENCE):
        other, moved = doubt.times(problem, vector, factor * float(np.exp(change)))
        ends.append(other.residual(moved))
    return np.asarray((ends[0] - ends[1]) / (2.0 * _DIFFERENCE), dtype=np.float64)


def _moved(item: Free, vector: FloatArray, change: float) -> float:
    """Return a parameter moved by a change of its logarithm, or in its scale where it has none."""
    value = float(vector[item.at])
    positive = item.low >= 0.0 and value > 0.0
    moved = (
        value * float(np.exp(np.clip(change, -_MOST, _MOST)))
        if positive
        else value + change * item.scale
    )
    return min(max(moved, item.low), item.high)


def _step(
    slopes: FloatArray, own: FloatArray, residual: FloatArray, soft: float
) -> tuple[FloatArray, float]:
    """Return the step of what is calibrated and of a doubt, and by how much the cost is to fall."""
    softened, weight = soften(residual, soft)
    columns = np.column_stack([slopes, own]) * weight[:, None]
    if not np.isfinite(columns).all():
        return np.zeros(columns.shape[1]), 0.0
    step = np.asarray(-np.linalg.lstsq(columns, softened)[0], dtype=np.float64)
    left = softened + columns @ step
    return step, float(softened @ softened - left @ left)
