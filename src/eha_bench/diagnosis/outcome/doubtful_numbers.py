"""Numbers of a drawing, and scales, that are wrong and that readings hardly tell from right ones.

A piston area that is declared too small is made up for by a mass, a friction and a leak that are
each too small: nothing is missing, but what is believed of these is contradicted. So each number
that nobody calibrates, and the scale of each channel, is fitted beside what is calibrated, to
readings and beliefs (`followed_doubt`), and what makes all as it is believed is named. Where one
does that with a factor that any healthy machine may have, nothing is named: no more than that need
be wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from eha_bench.diagnosis.fit.beliefs import Belief, contradicted
from eha_bench.diagnosis.fit.finish import lowest_fit
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.problem import Problem, cost_of
from eha_bench.diagnosis.outcome.doubt import Doubt, doubts_of
from eha_bench.diagnosis.outcome.followed_doubt import Followed, followed, promised
from eha_bench.diagnosis.search.state import Search

_SEVERAL = 2
"""Values further off than is believed from which one cause of all of them is looked for."""
_AGREES = 1.5
"""Multiple of what is given under `within` up to which a value is as believed."""
_FOLLOWED = 3
"""Doubts that are followed, the most promising ones."""
_HOPEFUL = 0.5
"""Share of the most promising one's fall of the cost that another one promises at least."""


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
    limits = search.thresholds
    clear = limits.behind
    found = [followed(problem, fit, doubt) for doubt in _promising(problem, fit, search.keys)]
    helping = [
        item
        for item in found
        if _agrees(problem.beliefs, item, len(off)) and fit.cost - item.cost > clear
    ]
    if not helping:
        return None
    least = min(item.cost for item in helping)
    alike = [item for item in helping if item.cost - least < clear]
    if not all(item.doubt.is_material(problem, item.factor, limits.declared) for item in alike):
        return None
    alike.sort(key=lambda item: item.cost)
    words = tuple(item.doubt.said(item.factor) for item in alike)
    note = (
        f"CAUTION: nothing is missing, but {', '.join(item.key for item in off)} are outside "
        f"their `within`; all would be as believed with {', or '.join(words)}: check it"
    )
    return DoubtfulNumbers(words, note)


def _promising(problem: Problem, fit: Fit, calibrated: tuple[str, ...]) -> Sequence[Doubt]:
    """Return the doubts that promise most by the slopes at what is declared."""
    found = promised(problem, fit, doubts_of(problem, fit.vector, calibrated))
    falls = {doubt: item.fall for doubt, item in found.items()}
    least = _HOPEFUL * max(falls.values(), default=0.0)
    order = sorted(falls, key=lambda doubt: -falls[doubt])
    return [doubt for doubt in order if falls[doubt] >= least][:_FOLLOWED]


def _agrees(beliefs: Sequence[Belief], item: Followed, off: int) -> bool:
    """Whether most of what was beyond what is believed comes within, and nothing is far off."""
    within = len(contradicted(beliefs, item.vector)) <= off / 2.0
    return within and not contradicted(beliefs, item.vector, _AGREES)
