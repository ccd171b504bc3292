"""The end of a search: a step of integration that no longer shows, and the bottom of the cost.

A fit stops where a step gains little of what is unexplained, and its problem is integrated as
coarsely as a search can bear. Both are too far from the minimum for an interval: with a hundred
thousand samples a tenth of the noise moves a parameter by several standard deviations. So while a
search lasts the step is halved until what that changes would not be looked at; at its end the fit
goes on, at half that step, until nothing is gained. What the last halving moves is kept: a method
of first order or better is off by no more than that (Hairer, Norsett, Wanner, Solving Ordinary
Differential Equations I, 2nd ed. 1993, section II.4), and an instant of sticking that falls into
another step makes as much.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.convergence import determined_directions
from eha_bench.diagnosis.fit.evidence import SOFT_MEAN
from eha_bench.diagnosis.fit.least_squares import Fit, jacobian, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import SLOPES, Problem, cost_of, soften
from eha_bench.diagnosis.fit.side_by_side import side_by_side

FINEST = 1.25e-5
"""Finest integration step, s: an eighth of the usual one."""

_LITTLE = 0.002
"""Share of the noise's cost that an error of integration may make: a tenth of what is looked at."""
_SHARE = 0.02
"""The same, of what is unexplained."""
_ROUNDS = 4
_FAR = 1.0
"""Fall of the cost from which slopes are computed again, in squares of a standard deviation."""
_SHOWN = 30.0
"""Change of the residual by a long difference, in standard deviations of the noise."""
_SHORT, _LONG = 0.02, 0.1
"""Shortest and longest half of it, in sizes of the parameters."""
_AGAIN = 3
"""Weakest directions along which slopes are taken once more."""
_TRUE = 0.5
"""Share of the information foreseen in the weakest one that has to be found there."""
_LENGTHS = (1.0, 0.5, 0.2)
"""Parts of an undamped step that are tried."""
_CORRECTIONS = 4
"""Damped steps that lead back to the bottom of a curved valley."""
_FOLDS = 0.5
"""Relative change up to which a parameter moves in its logarithm."""
_NOTHING = 0.1
"""Fall of the cost that ends a fit, in squares of a standard deviation."""


def fine_enough(problem: Problem, vector: FloatArray) -> Problem:
    """Return the problem at a step whose halving changes the cost too little to be looked at.

    Args:
        problem: at the usual step. vector: where it is simulated.
    """
    noise = SOFT_MEAN * problem.size
    cost = cost_of(problem, vector)
    while problem.longest_step > FINEST:
        finer = problem.halved()
        other = cost_of(finer, vector)
        if abs(cost - other) < max(_LITTLE * noise, _SHARE * (other - noise)):
            return problem
        problem, cost = finer, other
    return problem


@dataclass(frozen=True)
class ConvergedFit:
    """A fit at the bottom of its cost.

    Attributes:
        fit: with the Jacobian at its own place.
        shifts: what halving the step of integration last moved each parameter by, SI, by key.
    """

    fit: Fit
    shifts: Mapping[str, float]


def converged_fit(problem: Problem, fit: Fit) -> ConvergedFit:
    """Return a fit at the bottom of the cost, at half the step at which it was found or the finest.

    Args:
        problem: what was fitted. fit: its end.
    """
    finer = problem.at_step(max(0.5 * problem.step, FINEST))
    fit = _at(finer, fit)
    for _ in range(_ROUNDS):
        better = levenberg_marquardt(
            finer,
            fit.vector,
            fit.free,
            iterations=4,
            tolerance=_NOTHING,
            known=fit.columns,
            refresh=0,
            share=0.0,
        )
        gain = fit.cost - better.cost
        fit = _at(finer, better) if gain > _FAR else better
        if gain < _NOTHING:
            break
    fit = _with_long_slopes(finer, fit)
    if fit.free:
        # what says little is moved at last by slopes that are right
        last = levenberg_marquardt(
            finer, fit.vector, fit.free, iterations=2, tolerance=_NOTHING,
            known=fit.columns, refresh=0, share=0.0,
        )  # fmt: skip
        fit = to_the_bottom(finer, replace(last, jacobian=fit.jacobian))
    soft, weight = soften(fit.residual, fit.soft)
    coarse, _ = soften(problem.at_step(2.0 * finer.step).residual(fit.vector), fit.soft)
    matrix = fit.jacobian * weight[:, None]
    moved = np.linalg.lstsq(matrix, coarse - soft, rcond=1e-10)[0] if fit.free else np.zeros(0)
    return ConvergedFit(
        fit,
        {item.key: float(step * item.scale) for item, step in zip(fit.free, moved, strict=True)},
    )


def lowest_fit(problem: Problem, fit: Fit) -> Fit:
    """Return a fit at the bottom of its cost, at the step at which it was found.

    Args:
        problem: what was fitted. fit: its end.
    """
    found = to_the_bottom(problem, _with_long_slopes(problem, _at(problem, fit)))
    return found if found.cost < fit.cost else fit


def to_the_bottom(problem: Problem, fit: Fit) -> Fit:
    """Return a fit after undamped Gauss-Newton steps along all directions that are determined.

    Damping is a share of each parameter's own information, so where the parameters can nearly be
    scaled together it holds what little tells their scale, such as what is believed of them, to
    nothing: a fit then stops, and is several standard deviations from its minimum. Such a valley
    is curved. Parameters move along it in logarithms, in which products keep (m l beside K_T), and
    damped steps with the same slopes lead back to its bottom.

    Args:
        problem: what was fitted. fit: with the Jacobian at its place, and right in every direction.
    """
    for _ in range(_ROUNDS):
        for length in _LENGTHS:
            better = levenberg_marquardt(
                problem, _vector_along(fit, length), fit.free, iterations=_CORRECTIONS,
                tolerance=_NOTHING, known=fit.columns, refresh=0, share=0.0,
            )  # fmt: skip
            if better.cost < fit.cost:
                break
        else:
            return fit
        gain, fit = fit.cost - better.cost, replace(better, jacobian=fit.jacobian)
        if gain < _NOTHING:
            break
    return fit


def _vector_along(fit: Fit, length: float) -> FloatArray:
    """Return the parameters some part of an undamped step further."""
    found = determined_directions(fit)
    vector = fit.vector.copy()
    step = -length * found.directions @ (found.slopes / found.information)
    for k, change in zip(found.inside, step, strict=True):
        item, value = fit.free[k], float(fit.vector[fit.free[k].at])
        share = float(change) / value if value else 0.0
        moved = value * math.exp(share) if 0.0 < abs(share) < _FOLDS else value + float(change)
        vector[item.at] = min(max(moved, item.low), item.high)
    return vector


def _with_long_slopes(problem: Problem, fit: Fit) -> Fit:
    """Return a fit whose Jacobian is right where it says little.

    A difference of a percent of one parameter moves instants of sticking from one step to another,
    and that noise makes directions look determined in which nothing changes at all: K_T, J,
    friction, D_p, leakage and 1 / beta of a locked run can all be scaled by one factor. So the
    slope along each eigenvector of the information matrix is taken again between ends as far apart
    as the residual foreseen there allows, and then once more along the weakest of what came out.
    """
    if not fit.free:
        return fit
    problem = problem.at_step(max(problem.step, SLOPES))
    sizes = np.array([abs(fit.vector[item.at]) or item.scale for item in fit.free])
    units = sizes / np.array([item.scale for item in fit.free])
    matrix = fit.jacobian.copy()
    _, weight = soften(fit.residual, fit.soft)
    for weakest in (len(fit.free), *(_AGAIN for _ in range(_ROUNDS))):
        weighted = matrix * weight[:, None] * units
        values, vectors = np.linalg.eigh(weighted.T @ weighted)
        directions = [vectors[:, k] for k in range(min(weakest, len(fit.free)))]
        lengths = np.clip(_SHOWN / np.sqrt(np.maximum(values, 1e-300)), _SHORT, _LONG)
        slopes = side_by_side(
            lambda item: _slope_along(problem, fit, item[0] * sizes, item[1], sizes),
            list(zip(directions, lengths, strict=False)),
        )
        for direction, slope in zip(directions, slopes, strict=True):
            if slope is not None:
                matrix += np.outer(slope - matrix @ (direction * units), direction / units)
        if slopes[0] is None or _size(slopes[0], weight) > _TRUE * float(values[0]):
            break
    return replace(fit, jacobian=matrix)


def _size(slope: FloatArray, weight: FloatArray) -> float:
    return float(np.sum((slope * weight) ** 2))


def _slope_along(
    problem: Problem, fit: Fit, direction: FloatArray, length: float, sizes: FloatArray
) -> FloatArray | None:
    """Return the residual's slope between two ends about a fit, (N,); None where bounds hold it."""
    ends = [_vector_after(fit, side * length * direction) for side in (1.0, -1.0)]
    apart = np.array([ends[0][f.at] - ends[1][f.at] for f in fit.free]) / sizes
    reached = float(apart @ (direction / sizes))
    if reached < length:
        return None
    return (problem.residual(ends[0]) - problem.residual(ends[1])) / reached


def _vector_after(fit: Fit, step: FloatArray) -> FloatArray:
    vector = fit.vector.copy()
    for item, change in zip(fit.free, step, strict=True):
        vector[item.at] = min(max(vector[item.at] + float(change), item.low), item.high)
    return vector


def _at(problem: Problem, fit: Fit) -> Fit:
    """Return a fit as it is in a problem, with a Jacobian computed again."""
    residual = problem.residual(fit.vector)
    soft, _ = soften(residual, problem.soft)
    matrix = jacobian(problem, fit.vector, fit.free, residual)
    return replace(
        fit, residual=residual, jacobian=matrix, cost=float(soft @ soft), soft=problem.soft
    )
