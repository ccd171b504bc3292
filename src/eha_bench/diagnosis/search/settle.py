"""Brings a search to rest after what it fits has changed: step, noise, start states, fit.

What a fit has not reached yet, and what a step of integration makes, would be taken for something
that is missing.
"""

from __future__ import annotations

from dataclasses import replace

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.baseline import STEP
from eha_bench.diagnosis.fit.evidence import excess, refined_noise
from eha_bench.diagnosis.fit.finish import fine_enough, lowest_fit
from eha_bench.diagnosis.fit.least_squares import Fit, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem, soften
from eha_bench.diagnosis.fit.start_angles import with_refined_angles
from eha_bench.diagnosis.search.refit import polish, polish_at_rest
from eha_bench.diagnosis.search.state import Search

_ROUNDS = 4
_SETTLED = 0.002


def settle(search: Search) -> None:
    """Fit, and weigh again by what is left, until neither changes much any more."""
    for number in range(_ROUNDS):
        refine(search, search.fit.vector)
        search.problem = with_refined_angles(search.problem, search.fit.vector)
        residual = _reweight(search, search.fit.vector)
        here = _leaving(search.problem, search.fit, residual)
        # friction at rest is asked for once: later rounds change less than tells its forms apart
        again = polish_at_rest if number == 0 else polish
        search.fit = again(search, here, [])
        if here.cost - search.fit.cost < _SETTLED * here.cost:
            break
    search.excess_left = excess(search.problem, search.fit)


def lower(search: Search) -> None:
    """Follow the fit's valley to its bottom.

    What a fit that stopped in a flat valley leaves would be taken for another cause.
    """
    search.fit = lowest_fit(search.problem, search.fit)
    search.excess_left = excess(search.problem, search.fit)


def rebase(search: Search) -> None:
    """Fit what is there without any effect again, in the problem that these have changed."""
    search.base = levenberg_marquardt(
        # what is bent this far needs no finer step
        search.problem.at_step(max(search.problem.step, STEP)),
        search.base.vector,
        search.base.free,
        known=search.base.columns,
        refresh=0,
    )
    search.excess_base = excess(search.problem, search.base)


def refine(search: Search, vector: FloatArray) -> None:
    """Integrate as finely as a vector asks for, with the search's fit as it is there."""
    problem = fine_enough(search.problem, vector)
    if problem.longest_step == search.problem.longest_step:
        return
    search.problem = problem
    search.fit = weighed_again(problem, search.fit)
    search.excess_left = excess(problem, search.fit)


def weighed_again(problem: Problem, fit: Fit) -> Fit:
    """Return a fit with what it leaves in another problem."""
    return _leaving(problem, fit, problem.residual(fit.vector))


def _leaving(problem: Problem, fit: Fit, residual: FloatArray) -> Fit:
    """Return a fit that leaves a residual in a problem."""
    soft, _ = soften(residual, problem.soft)
    return replace(fit, residual=residual, cost=float(soft @ soft))


def _reweight(search: Search, vector: FloatArray) -> FloatArray:
    """Take noise, outliers and start states from a better fit, and return its residual.

    What an effect leaves in a residual reads as noise and as outliers until the effect is there.
    """
    problem = search.problem
    problem.prepare(vector)
    noise = refined_noise(problem, problem.residual(vector), problem.noise)
    search.problem = problem.with_noise(noise)
    search.problem.prepare(vector)
    residual = search.problem.residual(vector)
    search.problem.scale_to(residual)
    return residual
