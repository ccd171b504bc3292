"""Fits made again where their end asks for it: other starts, or friction that sticks.

Where a window oscillates, its start and what starts do to it hold near one model only (`problem`).
Another model that is fitted with them stops where it needs other starts, however right it is.
"""

from __future__ import annotations

from collections.abc import Callable

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.friction_at_rest import sticks
from eha_bench.diagnosis.fit.least_squares import Fit, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem, cost_of

_ROUNDS = 4
"""Times that a fit is made again."""
_SETTLED = 4.0
"""Fall of the cost, two standard deviations, from which it is worth another time."""


def settled_fit(
    problem: Problem, fit: Fit, watch: Callable[[FloatArray], None] | None = None
) -> Fit:
    """Return a fit whose windows ask for no other start, and that no friction at rest holds up.

    Friction that has come back to sticking stays there: a slope from there leads nowhere, and
    would keep all others where they are.

    Args:
        problem: what was fitted; where starts were moved, they follow the fit. fit: its end.
        watch: given every vector that is better than all before.
    """
    for _ in range(_ROUNDS):
        free = tuple(item for item in fit.free if not sticks(item.key, fit.vector[item.at]))
        if not problem.has_moved_starts and len(free) == len(fit.free):
            break
        if problem.has_moved_starts:
            problem.prepare(fit.vector)
        before = cost_of(problem, fit.vector)
        fit = levenberg_marquardt(problem, fit.vector, free, refresh=1, watch=watch)
        if fit.cost > before - _SETTLED:
            break
    return fit


def settled_fit_of_one(problem: Problem, fit: Fit) -> Fit:
    """Return the same for one model of several: the problem's own starts stay."""
    return settled_fit(problem.apart() if problem.has_moved_starts else problem, fit)
