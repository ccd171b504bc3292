"""Takes out again what was added: the backward half of a stepwise search.

An effect stays only while it does something that the others cannot do without it.
"""

from __future__ import annotations

import math

from eha_bench.diagnosis.fit.baseline import COARSE
from eha_bench.diagnosis.fit.candidates import SameNumber, Start
from eha_bench.diagnosis.fit.evidence import SOFT_MEAN, compare, excess
from eha_bench.diagnosis.fit.friction_at_rest import sticks
from eha_bench.diagnosis.fit.least_squares import Fit, free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import cost_of
from eha_bench.diagnosis.fit.profile import cost_with
from eha_bench.diagnosis.fit.uncertainty import Spread, spreads
from eha_bench.diagnosis.search.refit import BENT, polish_afresh, polish_at_rest
from eha_bench.diagnosis.search.state import Accepted, Search


def without_idle(search: Search) -> Fit | None:
    """Return the fit without what was added last, if that does nothing; else None.

    Its refit only led the others to a better place.

    What little of it is left may only balance the others, so these follow: as their slopes tell,
    and in a fit without it where it explains no more than a calibration that was caught leaves.
    """
    fit, item = search.fit, search.accepted[-1]
    start = item.start
    vector = start.off(fit.vector)
    least = cost_of(search.problem, vector)
    for free in fit.free:
        # parts of one number are off together
        if free.at == start.strength_at and not isinstance(start, SameNumber):
            least = min(least, cost_with(search.problem, fit, free.key, start.neutral))
    idle = least - fit.cost < search.thresholds.gain
    little = item.comparison.gain < BENT * SOFT_MEAN * search.problem.size
    if not (idle or little):
        return None
    trial = without(search, item)
    return trial if idle or trial.cost - fit.cost < search.thresholds.gain else None


def deviations_off(search: Search, start: Start) -> float:
    """Return how many standard deviations an effect's fitted strength is from none.

    Infinite where its strength was not fitted.
    """
    spread = _strength_spread(search, start)
    if spread is None:
        return math.inf
    size = abs(float(search.fit.vector[start.strength_at]) - start.neutral)
    if spread.deviation > 0.0:
        return size / spread.deviation
    return math.inf if size > 0.0 else 0.0


def is_loose(search: Search, item: Accepted) -> bool:
    """Whether an effect is so few standard deviations large that one without it may fit as well."""
    return deviations_off(search, item.start) <= search.thresholds.loose


def is_within_disagreement(search: Search, item: Accepted, fall: float) -> bool:
    """Whether an effect beside others explains little, and no more than runs disagree by.

    Little beside what the others explain is more likely what their forms leave; of an effect that
    is a large part of what is missing, runs may disagree as long as something else is missing too.

    Args:
        search: with it. item: of its effects. fall: of the cost by it, the others refitted.
    """
    spread = _strength_spread(search, item.start)
    little = fall < search.thresholds.little * search.excess_base.total
    return spread is not None and little and fall < spread.least_fall


def _strength_spread(search: Search, start: Start) -> Spread | None:
    keys = {free.at: free.key for free in search.fit.free}
    key = keys.get(start.strength_at)
    return spreads(search.fit, search.groups)[key] if key is not None else None


def drop(search: Search, item: Accepted, fit: Fit) -> None:
    """Take out what was added, and keep the better place that a fit without it has."""
    search.accepted = _others(search, item)
    search.fit = fit if search.accepted else _at_rest(search, fit)
    search.excess_left = excess(search.problem, search.fit)
    if not search.accepted:
        search.base, search.excess_base = search.fit, search.excess_left


def _at_rest(search: Search, fit: Fit) -> Fit:
    """Return a fit without anything added with friction at rest as the data ask for.

    What was taken out may have stood for how friction rests.
    """
    rested = polish_at_rest(search, fit, [])
    if rested.cost < cost_of(search.problem, fit.vector):
        return rested
    search.problem.prepare(fit.vector)
    return fit


def review(search: Search) -> None:
    """Take out what a later addition has made needless."""
    limits = search.thresholds
    for item in list(search.accepted[:-1]):
        trial = without(search, item)
        left = excess(search.problem, trial)
        found = compare(trial, search.fit, search.groups, left.total)
        if found.gain_out < limits.gain / 2 or not limits.is_sure(found):
            drop(search, item, trial)


def release(search: Search) -> None:
    """Take out effects whose size may as well be nothing, and which nothing is lost without.

    One that led the others out of a poor place is left over where they could not get there alone.
    """
    for item in reversed(search.effects):
        if not is_loose(search, item):
            continue
        trial = without(search, item)
        if trial.cost - search.fit.cost < search.thresholds.gain:
            drop(search, item, trial)


def _others(search: Search, item: Accepted) -> list[Accepted]:
    return [other for other in search.accepted if other is not item]


def without(search: Search, item: Accepted) -> Fit:
    """Return the search's fit without one of what was added, the others fitted again."""
    kept = _others(search, item)
    vector = item.start.off(search.fit.vector)
    places = search.problem.places
    keys = [key for key in search.keys if not sticks(key, vector[places.index[key]])]
    for other in kept:
        keys += [key for key in other.start.keys if key not in keys]
    free = free_parameters(places, keys, vector)
    coarse = search.problem.at_step(COARSE)
    rough = levenberg_marquardt(coarse, vector, free, iterations=5, refresh=0)
    before, search.accepted = search.accepted, kept
    try:
        fit = polish_afresh(search, rough, [])
    finally:
        search.accepted = before
    if fit.cost > cost_of(search.problem, vector):
        # a coarse step led to a worse place than that of what hardly did anything
        fit = levenberg_marquardt(search.problem, vector, free, iterations=4, refresh=0)
    return fit
