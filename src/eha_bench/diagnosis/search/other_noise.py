"""The same search where the sensors' noise is another one: what was found has to stand there."""

from __future__ import annotations

from dataclasses import replace

from eha_bench.diagnosis.fit.evidence import compare, excess, groups_of
from eha_bench.diagnosis.fit.least_squares import Fit, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.search.backward import drop, without
from eha_bench.diagnosis.search.state import Search


def refitted_search(search: Search, problem: Problem, fit: Fit) -> Search:
    """Return a search with what was found fitted again, less what is not believed there.

    Args:
        search: finished. problem: the same windows, with other noise. fit: what was found, there.
    """
    base = fit
    if search.accepted:
        base = levenberg_marquardt(problem, search.base.vector, search.base.free, refresh=1)
    found = replace(
        search.snapshot(),
        problem=problem,
        fit=fit,
        base=base,
        groups=groups_of(problem),
        excess_base=excess(problem, base),
        excess_left=excess(problem, fit),
        looked_from=None,
        exchanged_from=None,
        near=None,
    )
    for item in list(found.effects):
        trial = without(found, item)
        seen = compare(trial, found.fit, found.groups, excess(problem, trial).total)
        if search.thresholds.still_allow(seen, item.comparison):
            found.accepted = [
                replace(own, comparison=seen) if own is item else own for own in found.accepted
            ]
        else:
            drop(found, item, trial)
    return found
