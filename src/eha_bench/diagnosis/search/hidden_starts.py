"""What a candidate hides of each window's start, left open for it and for all others alike.

Nothing read says how a soft joint is bent in the midst of a motion, how far a supply had fallen, or
which way long bristles lie. Where a window begins with these at rest, the right cause fits no
better than a wrong one. So of candidates that hide something each is fitted with it open, and held
against the fit without it where the same is open: nothing is believed only because more is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.baseline import COARSE
from eha_bench.diagnosis.fit.candidates import Start
from eha_bench.diagnosis.fit.evidence import excess
from eha_bench.diagnosis.fit.least_squares import levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem, cost_of
from eha_bench.diagnosis.fit.side_by_side import side_by_side
from eha_bench.diagnosis.search.refit import free_of, polish_at_rest
from eha_bench.diagnosis.search.settle import weighed_again
from eha_bench.diagnosis.search.state import Refit, Search, starts_of

_ENOUGH = 0.9
"""Share of what is missing that leaves nothing for a candidate that hides something."""
_BETTER = 0.8
"""Share of what the best one leaves that such a candidate has to leave at most."""
_ROUNDS = 4
_SETTLED = 0.02
"""Share of the cost by which a round has to lower it to be followed by another."""
_FIRST, _ROUGH = 2, 6
"""Iterations of a fit that chooses starts, and of one that compares those chosen."""
_CHOSEN = 3
"""Starts that are compared, beside where the candidate has ended."""


@dataclass(frozen=True, eq=False)
class _Opened:
    """A candidate with what it hides open.

    Attributes:
        item: the candidate, fitted roughly with that open in every window.
        left: what it leaves of what is missing there, and `share`: the part that it takes.
    """

    item: Refit
    left: float
    share: float


def with_hidden_starts(search: Search, finals: Sequence[Refit]) -> list[Refit]:
    """Leave open what the best candidate hides of each window's start, for it and for all others.

    Args:
        search: its problem is replaced where something is opened. finals: candidates, refitted.
    """
    best = min(finals, key=lambda item: item.fit.cost, default=None)
    if best is None:
        return [*finals]
    opened = _best_opened(search, finals, best)
    if opened is None and not search.problem.hides_more(best.fit.vector):
        return [*finals]
    hiding = best if opened is None else opened.item
    problem = _prepared(search.problem, hiding.fit.vector)
    search.problem = problem
    search.fit = weighed_again(problem, search.fit)
    search.excess_left = excess(problem, search.fit)
    found = [replace(item, fit=weighed_again(problem, item.fit)) for item in finals]
    if opened is None:
        return found
    done = replace(hiding, fit=polish_at_rest(search, hiding.fit, [hiding.start]))
    return [done, *(item for item in found if item.candidate != hiding.candidate)]


def _best_opened(search: Search, finals: Sequence[Refit], best: Refit) -> _Opened | None:
    """Return the candidate that explains most with what it hides open; None if none does better."""
    missing = search.excess_left.total
    left = missing - (search.fit.cost - best.fit.cost)
    if left <= (1.0 - _ENOUGH) * missing:
        return None
    starts = starts_of(search, [item.start.candidate for item in search.accepted])
    tried: list[_Opened] = []
    for item in finals:
        own = [start for start in starts if start.candidate == item.candidate]
        if any(search.problem.hides_more(start.apply(search.fit.vector)) for start in own):
            tried.append(_opened(search, item, own))
    found = min(tried, key=lambda opened: opened.left, default=None)
    if found is None or found.left > _BETTER * left or found.share <= 1.0 - left / missing:
        return None
    return found


def _opened(search: Search, item: Refit, starts: Sequence[Start]) -> _Opened:
    """Fit a candidate with what it hides open, from each of its starts and where it has ended."""
    begin = [(start, start.apply(search.fit.vector)) for start in starts]
    problem = _prepared(search.problem, begin[0][1]).at_step(COARSE)

    def first(pair: tuple[Start, FloatArray]) -> Refit:
        start, vector = pair
        free = free_of(search, vector, [start])
        fit = levenberg_marquardt(
            problem, vector, free, iterations=_FIRST, known=search.fit.columns, refresh=0
        )
        return replace(item, start=start, fit=fit)

    def further(trial: Refit) -> Refit:
        fit = levenberg_marquardt(
            problem, trial.fit.vector, trial.fit.free, iterations=_ROUGH, refresh=1
        )
        return replace(trial, fit=fit)

    *begun, ended = side_by_side(first, [*begin, (item.start, item.fit.vector)])
    begun.sort(key=lambda trial: trial.fit.cost)
    best = min(side_by_side(further, [*begun[:_CHOSEN], ended]), key=lambda end: end.fit.cost)
    for _ in range(_ROUNDS):
        # what is open changes with the sizes that were found
        problem = _prepared(search.problem, best.fit.vector).at_step(COARSE)
        free = free_of(search, best.fit.vector, [best.start])
        fit = levenberg_marquardt(problem, best.fit.vector, free, refresh=1)
        before, best = cost_of(problem, best.fit.vector), replace(best, fit=fit)
        if before - fit.cost < _SETTLED * before:
            break
    without = weighed_again(problem, search.fit)
    missing = excess(problem, without).total
    left = missing - (without.cost - best.fit.cost)
    return _Opened(best, left, 1.0 - left / max(missing, 1.0))


def _prepared(problem: Problem, vector: FloatArray) -> Problem:
    """Return a problem of its own whose windows leave open what some parameters hide."""
    other = problem.apart()
    other.prepare_starts(vector)
    return other
