"""Numbers of a drawing, and scales, that are wrong and that readings hardly tell from right ones.

A piston area that is declared too small is made up for by a mass, a friction and a leak that are
each too small: nothing is missing, but what is believed of these is contradicted. So each number
that nobody calibrates, and the scale of each channel, is fitted beside what is calibrated, to
readings and beliefs, and what makes all as it is believed is named.

Where readings tell nothing, the cost has a narrow valley along which parameters follow powers of
one another. In their logarithms it is straight, and differences to both sides see it: by one-sided
ones it would seem to rise. It bends where a sum is what readings tell, so what is calibrated is
fitted again behind each step.

Source: Björck, Numerical Methods for Least Squares Problems, SIAM 1996, section 9.2 (Gauss-Newton).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.beliefs import contradicted
from eha_bench.diagnosis.fit.finish import lowest_fit
from eha_bench.diagnosis.fit.least_squares import Fit, Free, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem, cost_of, soften
from eha_bench.diagnosis.outcome.doubt import Doubt, doubts_of
from eha_bench.diagnosis.search.state import Search

_SEVERAL = 2
"""Values further off than is believed from which one cause of all of them is looked for."""
_AGREES = 1.5
"""Multiple of what is given under `within` up to which a value is as believed."""
_DIFFERENCE = 0.01
"""Of a logarithm, to either side, by which a slope is taken."""
_FOLLOWED = 3
"""Doubts that are followed, the most promising ones."""
_HOPEFUL = 0.5
"""Share of the most promising one's fall of the cost that another one promises at least."""
_STEPS = 4
_SHARES = (0.5, 1.0, 2.0)
"""Of a step, that are tried: the valley is longer than its slopes promise, or shorter."""
_ITERATIONS = 4
_FURTHEST = 10.0
"""Factor by which what is declared may be off at most."""
_WORTH = 1.0
"""Fall of the cost by a step from which the next one is tried."""


@dataclass(frozen=True)
class _Cleared:
    """A doubt at its best: the factor of what was declared, and the cost and beliefs with it."""

    doubt: Doubt
    factor: float
    cost: float
    agrees: bool


class DoubtfulNumbers(NamedTuple):
    """Numbers, or scales, with each of which all would be as believed, and a note on them."""

    words: tuple[str, ...]
    note: str


def doubtful_numbers(search: Search) -> DoubtfulNumbers | None:
    """Return the numbers, or scales, with which all is as believed that is not, None for none.

    Args:
        search: finished, without anything that was added.
    """
    if len(contradicted(search.problem.beliefs, search.fit.vector)) < _SEVERAL:
        return None
    problem = search.problem.apart()
    problem.prepare(search.fit.vector)
    # a calibration that stopped in a valley comes back by itself
    fit = lowest_fit(problem, search.fit)
    off = contradicted(problem.beliefs, fit.vector)
    if len(off) < _SEVERAL:
        return None
    fit = replace(fit, cost=cost_of(problem, fit.vector))
    clear = search.thresholds.behind
    found = [
        _cleared(problem, fit, doubt, len(off)) for doubt in _promising(problem, fit, search.keys)
    ]
    helping = [item for item in found if item.agrees and fit.cost - item.cost > clear]
    if not helping:
        return None
    least = min(item.cost for item in helping)
    alike = [item for item in helping if item.cost - least < clear]
    alike.sort(key=lambda item: item.cost)
    words = tuple(item.doubt.said(item.factor) for item in alike)
    note = (
        f"CAUTION: nothing is missing, but {', '.join(item.key for item in off)} are outside "
        f"their `within`; all would be as believed with {', or '.join(words)}: check it"
    )
    return DoubtfulNumbers(words, note)


def _promising(problem: Problem, fit: Fit, calibrated: tuple[str, ...]) -> Sequence[Doubt]:
    """Return the doubts that promise most by the slopes at what is declared."""
    vector = fit.vector
    residual = problem.residual(vector)
    slopes = _slopes(problem, fit.free, vector)
    falls = {}
    for doubt in doubts_of(problem, vector, calibrated):
        own = _slope(doubt, problem, vector, 1.0)
        falls[doubt] = _step(slopes, own, residual, problem.soft)[1]
    least = _HOPEFUL * max(falls.values(), default=0.0)
    order = sorted(falls, key=lambda doubt: -falls[doubt])
    return [doubt for doubt in order if falls[doubt] >= least][:_FOLLOWED]


def _cleared(base: Problem, fit: Fit, doubt: Doubt, off: int) -> _Cleared:
    """Return a doubt fitted beside what is calibrated, as far down as it goes.

    It agrees with what is believed where most of what was beyond it comes within.
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
    beliefs = base.beliefs
    agrees = len(contradicted(beliefs, vector)) <= off / 2.0
    return _Cleared(doubt, factor, cost, agrees and not contradicted(beliefs, vector, _AGREES))


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
    return np.column_stack(columns)


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
    moved = value * float(np.exp(change)) if positive else value + change * item.scale
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
