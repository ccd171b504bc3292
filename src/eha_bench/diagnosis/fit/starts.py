"""A calibration from several starts, so that it ends where the recordings ask for.

Over long windows the cost of a wrong model has many minima, and a fit stops in the nearest. Over
windows of a few samples a simulation is its start state and one step of its equations: what is
compared there is the error of the equations, nearly linear in the parameters, with the noise of
the start states weighed (`problem`). So where a fit from the declared values leaves much, another
one begins over the shortest windows and goes on to longer ones (multiple shooting with growing
intervals; Bock 1987, doi:10.1007/978-3-642-93360-6; Ribeiro et al., Automatica 121 (2020) 109158,
doi:10.1016/j.automatica.2020.109158). A stretch that oscillates has a minimum for every period that
a simulation is ahead by: where a few windows hold most of what is left, a fit begins without them.
Where that leaves much as well, starts are spread about the
declared values: within what is believed of them, else by factors.

Of two parameters whose sum alone is told clearly (a gap of a pump and the drains of its case) one
may end at nothing and the other far above what is believed, where a curved valley is nearly level.
So another fit begins where the best one ended, with what it took too far as it is believed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.beliefs import FAR, contradicted
from eha_bench.diagnosis.fit.evidence import SOFT_MEAN
from eha_bench.diagnosis.fit.least_squares import Fit, Free, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem, cost_of
from eha_bench.diagnosis.fit.short_windows import WINDOW, medium_problem
from eha_bench.diagnosis.fit.side_by_side import side_by_side

Watch = Callable[[FloatArray], None]

_WELL = 1.2
"""Mean square of a residual, in the noise's, that no other start is looked for with."""
_POOR = 2.0
"""Mean square over short windows from which starts are spread."""
_SHORTEST = 0.012
"""Length of the shortest windows, s; never less than six samples."""
_ROUNDS = 4
"""Times that windows of one length are fitted, and weighed again."""
_SETTLED = 0.95
"""Share of the mean square before from which another round is not worth it."""
_PATIENCE = 8
"""Tries of a step far from the minimum."""
_SPREAD = 12
"""Starts that are spread about the declared values."""
_FITTED = 2
"""Of these, how many are fitted."""
_FACTOR = 30.0
"""Largest factor by which a start is moved from a declared value."""
_BETTER = 0.9
"""Share of the cost over short windows below which a spread start is worth a fit over long ones."""
_SAME = 0.02
"""Relative difference of two ends' costs from which they are no longer the same."""


@dataclass(frozen=True)
class MultistartFit:
    """Where several starts ended.

    Attributes:
        fit: the best end. tried: number of starts.
        agreed: how many of them ended at the same cost.
    """

    fit: Fit
    tried: int = 1
    agreed: int = 1


def best_fit_of_starts(
    problem: Problem, vector: FloatArray, free: Sequence[Free], watch: Watch
) -> MultistartFit:
    """Return the best fit from as many starts as it takes.

    Args:
        problem: over long windows, prepared at the vector. vector: declared. free: what may move.
        watch: given every vector that is better than all before.
    """
    found = _from_declared(problem, vector, free, watch)
    off = contradicted(problem.beliefs, found.fit.vector, FAR)
    if not off:
        return found
    back = found.fit.vector.copy()
    for belief in off:
        back[belief.at] = belief.value
    fit = levenberg_marquardt(problem, back, free, iterations=6, refresh=1, tries=_PATIENCE)
    is_same = max(fit.cost, found.fit.cost) < (1.0 + _SAME) * min(fit.cost, found.fit.cost)
    if fit.cost >= found.fit.cost:
        return MultistartFit(found.fit, found.tried + 1, found.agreed + is_same)
    watch(fit.vector)
    return MultistartFit(fit, found.tried + 1, found.agreed * is_same + 1)


def _from_declared(
    problem: Problem, vector: FloatArray, free: Sequence[Free], watch: Watch
) -> MultistartFit:
    """Return the best fit that begins from declared values, and from starts spread about them."""
    vector = _undeclared_first(problem, vector, free)
    first = levenberg_marquardt(problem, vector, free, iterations=6, refresh=1, watch=watch)
    if not free or _mean_square(problem, first) < _WELL:
        return MultistartFit(first)
    calm = _without_loud(problem, first, free)
    if _mean_square(problem, calm) < _WELL:
        watch(calm.vector)
        return MultistartFit(calm, tried=2)
    if calm is not first:
        problem.prepare(vector)  # starts that were moved for a fit that failed suit no other
    ends = [first]
    grown, short = _fit_growing_windows(problem, vector, free)
    ends.append(_over_long(problem, grown, free))
    if _mean_square(short, grown) > _POOR:
        spread = _fits_from_spread_starts(short, vector, free)
        better = [fit for fit in spread if fit.cost < _BETTER * grown.cost]
        ends += side_by_side(lambda fit: _over_long(problem, fit, free), better)
    best = min(ends, key=lambda fit: fit.cost)
    watch(best.vector)
    agreed = sum(fit.cost < (1.0 + _SAME) * best.cost for fit in ends)
    return MultistartFit(best, len(ends), agreed)


def _undeclared_first(problem: Problem, vector: FloatArray, free: Sequence[Free]) -> FloatArray:
    """Return a vector in which what was not declared fits with what was.

    A load that is set to nothing is off by kilonewtons, a mass of a data sheet by some percent: a
    fit of both at once bends the mass until it imitates the load.
    """
    own = [item for item in free if item.run and not item.of_log]
    if not own:
        return vector
    fit = levenberg_marquardt(problem, vector, own, iterations=6, refresh=1, tries=_PATIENCE)
    _weigh(problem, fit.vector)
    return fit.vector


def _without_loud(problem: Problem, first: Fit, free: Sequence[Free]) -> Fit:
    """Return a fit that begins without the windows that stand out, or the first where it is better.

    The problem is prepared at the one that is returned.
    """
    calm = problem.without_loud(first.residual)
    if calm is None:
        return first
    near = levenberg_marquardt(calm, first.vector, free, iterations=10, refresh=1)
    problem.prepare(near.vector)
    fit = _over_long(problem, near, free)
    problem.prepare(fit.vector)
    fit = _over_long(problem, fit, free)
    if fit.cost < cost_of(problem, first.vector):
        return fit
    problem.prepare(first.vector)
    return _over_long(problem, first, free)


def _mean_square(problem: Problem, fit: Fit) -> float:
    return fit.cost / (SOFT_MEAN * max(problem.size, 1))


def _fit_growing_windows(
    problem: Problem, vector: FloatArray, free: Sequence[Free]
) -> tuple[Fit, Problem]:
    """Return a fit over windows that grow from the shortest ones, and the last of them."""
    tiny = medium_problem(problem, _SHORTEST)
    fit = _fit_until_settled(tiny, vector, free)
    short = medium_problem(problem, WINDOW)
    return _fit_until_settled(short, fit.vector, free), short


def _fit_until_settled(short: Problem, vector: FloatArray, free: Sequence[Free]) -> Fit:
    """Fit, and weigh start states and outliers again, until neither changes much any more."""
    before = np.inf
    for _ in range(_ROUNDS):
        _weigh(short, vector)
        fit = levenberg_marquardt(short, vector, free, iterations=8, refresh=2, tries=_PATIENCE)
        vector = fit.vector
        # a log of a few samples has none in the shortest windows
        reached = float(np.mean(fit.residual**2)) if fit.residual.size else 0.0
        if reached > _SETTLED * before:
            break
        before = reached
    return fit


def _over_long(problem: Problem, near: Fit, free: Sequence[Free]) -> Fit:
    return levenberg_marquardt(problem, near.vector, free, iterations=6, refresh=1)


def _weigh(problem: Problem, vector: FloatArray) -> None:
    problem.prepare(vector)
    problem.scale_to(problem.residual(vector))


def _fits_from_spread_starts(short: Problem, vector: FloatArray, free: Sequence[Free]) -> list[Fit]:
    """Return fits over short windows from the best of some starts about the declared values."""
    from scipy.stats import qmc

    believed = {item.at: item for item in short.beliefs}
    draws = qmc.LatinHypercube(len(free), rng=np.random.default_rng(0)).random(_SPREAD)
    starts = []
    for draw in 2.0 * draws - 1.0:
        trial = vector.copy()
        for item, place in zip(free, draw, strict=True):
            value = vector[item.at]
            if item.at in believed:
                moved = value + place * believed[item.at].within
            elif item.low >= 0.0 or value != 0.0:
                moved = (value or item.scale) * _FACTOR ** float(place)
            else:
                moved = value + place * item.scale
            trial[item.at] = min(max(moved, item.low), item.high)
        starts.append(trial)
    costs = side_by_side(lambda trial: cost_of(short, trial), starts)
    order = np.argsort(costs, kind="stable")[:_FITTED]
    return side_by_side(
        lambda k: levenberg_marquardt(
            short, starts[int(k)], free, iterations=8, refresh=2, tries=_PATIENCE
        ),
        list(order),
    )
