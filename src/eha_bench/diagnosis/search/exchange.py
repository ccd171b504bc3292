"""Takes another look at what was added, once everything is there.

What is added first is fitted while the rest is still missing, so it may be a look-alike of two
effects together, or the right effect in the wrong form. Each of what was added is therefore taken
out in turn, with the others kept, and its rivals (the closest of its own look, and its own other
forms) are fitted in its place; the better one stays. This is the backward half of stepwise
selection (Miller, Subset Selection in Regression, 2nd ed. 2002, section 3.4: sequential
replacement).
"""

from __future__ import annotations

from dataclasses import replace

from eha_bench.diagnosis.fit.baseline import COARSE
from eha_bench.diagnosis.fit.candidates import Start
from eha_bench.diagnosis.fit.evidence import Improvement, compare, excess
from eha_bench.diagnosis.fit.least_squares import Fit, levenberg_marquardt
from eha_bench.diagnosis.fit.start_angles import is_periodic
from eha_bench.diagnosis.search.bounds import are_inside
from eha_bench.diagnosis.search.equivalent import is_as_good
from eha_bench.diagnosis.search.refit import Near, at_the_bottom, free_of, polish_to_the_bottom
from eha_bench.diagnosis.search.state import Accepted, Refit, Search, starts_of
from eha_bench.diagnosis.search.yielding import yields_to

_RIVALS = 3
CLOSE = 0.4
"""Share of the best one's gain from which a rival may still overtake it."""
_TRIED = 3
_ROUNDING = 1.0
"""Fall of the cost that is none: a fit ends where less is to be gained."""


def exchange(search: Search) -> bool:
    """Replace what was added by what fits better in its place; return whether anything changed."""
    if search.exchanged_from is search.fit:
        return False
    changed = False
    for item in list(search.accepted):
        starts = _rivals(search, item)
        if item.start.is_parameter or not starts:
            continue
        others = [other for other in search.accepted if other is not item]
        best = _best(search, item, others, starts)
        least = search.thresholds.least_gain(search.excess_left)
        if best is None or best.fit.cost > search.fit.cost - least:
            continue
        found = compared(search, item, best.fit)
        equal = tuple(name for name in item.equivalent if name != best.candidate)
        old = item.start.candidate
        if old != best.candidate and is_as_good(search, search.fit, best.fit, found.gain):
            equal = (old, *equal)
        put_in_place(search, item, Accepted(best.start, found, equal), best.fit)
        changed = True
    # beside nothing else, the same would be found again
    search.exchanged_from = None if changed and len(search.accepted) > 1 else search.fit
    return changed


def take_better_equivalents(search: Search) -> None:
    """Let an equivalent take an effect's place where it fits better in the end.

    In a look each is refitted for so long only; fitted on, one may leave the other behind. One that
    has more parameters has to do so clearly; of two that have as many, the likelier comes first.
    One that is no longer as good beside what was found since is no equivalent.
    """
    for item in list(search.effects):
        ends = _equivalents_in_place(search, item)
        if not ends:
            continue
        best, fit = min(ends, key=lambda end: end[1].cost)
        if (
            not _is_likelier(search, item, best, fit)
            or not _stands_inside(search, item, best, fit)
            or yields_to(search, best.candidate, fit.vector) == item.start.candidate
        ):
            gain = item.comparison.gain
            behind = {
                t.candidate for t, end in ends if not is_as_good(search, end, search.fit, gain)
            }
            equal = tuple(name for name in item.equivalent if name not in behind)
            put_in_place(search, item, replace(item, equivalent=equal), search.fit)
            continue
        found = compared(search, item, fit)
        equal = tuple(
            trial.candidate
            for trial, end in ends
            if trial is not best and is_as_good(search, end, fit, found.gain)
        )
        if is_as_good(search, search.fit, fit, found.gain):
            equal = (item.start.candidate, *equal)
        put_in_place(search, item, Accepted(best.start, found, equal), fit)


def take_equivalent(search: Search, item: Accepted) -> bool:
    """Let the best equivalent take the place of an effect that does not stand, where there is one.

    What speaks against one of two that windows cannot tell apart need not speak against the other:
    over a whole run of another kind they part.
    """
    gain, added = item.comparison.gain, {other.start.candidate for other in search.accepted}
    ends = [
        (trial, fit)
        for trial, fit in _equivalents_in_place(search, item)
        if trial.candidate not in added
        and is_as_good(search, fit, search.fit, gain)
        and _stands_inside(search, item, trial, fit)
        and yields_to(search, trial.candidate, fit.vector) != item.start.candidate
    ]
    if not ends:
        return False
    best, fit = min(ends, key=lambda end: end[1].cost)
    equal = tuple(trial.candidate for trial, _ in ends if trial is not best)
    put_in_place(search, item, Accepted(best.start, compared(search, item, fit), equal), fit)
    return True


def _equivalents_in_place(search: Search, item: Accepted) -> list[tuple[Refit, Fit]]:
    """Return an effect's equivalents, each with its fit in that one's place."""
    trials = [one for one in search.look_of(item) if one.candidate in item.equivalent]
    return [(trial, fit_in_place(search, item, trial)) for trial in trials]


def _stands_inside(search: Search, item: Accepted, trial: Refit, fit: Fit) -> bool:
    """Whether an equivalent in an item's place, and all others beside it, stand at no bound."""
    others = [other.start for other in search.accepted if other is not item]
    return are_inside(search, [trial.start, *others], fit.vector)


def _is_likelier(search: Search, item: Accepted, trial: Refit, fit: Fit) -> bool:
    """Whether an equivalent, fitted to the end in an item's place, is to be named before it."""
    if fit.cost <= search.fit.cost - search.thresholds.least_gain(search.excess_left):
        return True
    if len(trial.start.keys) > len(item.start.keys) or fit.cost >= search.fit.cost - _ROUNDING:
        return False
    return fit.cost < at_the_bottom(search, search.fit).cost - _ROUNDING


def _rivals(search: Search, item: Accepted) -> list[Start]:
    """Return starts of the closest rivals of the look in which an item was added, and its own."""
    trials = search.look_of(item)
    gain = max((trial.comparison.gain for trial in trials), default=0.0)
    taken = {other.start.candidate for other in search.accepted}
    names = [
        trial.candidate
        for trial in trials
        if trial.candidate not in taken and trial.comparison.gain > CLOSE * gain
    ]
    names = [item.start.candidate, *names[:_RIVALS]]
    layout = search.problem.plant.layout
    # a count that a scan has not found would be free to become any
    turning = {effect.id for effect in layout.effects if is_periodic(effect)}
    scanned = [item.start, *(trial.start for trial in trials if trial.candidate in names[1:])]
    kept = [name for name in taken if name != item.start.candidate]
    starts = starts_of(search, kept)
    return [
        *(s for s in starts if s.candidate in set(names) - turning and not s.is_parameter),
        *(s for s in scanned if s.candidate in turning),
    ]


def _best(
    search: Search, item: Accepted, others: list[Accepted], starts: list[Start]
) -> Refit | None:
    """Return the best of some starts in an item's place, refitted to the end."""
    kept = search.snapshot()
    search.accepted = others
    search.fit = fit_with_item_off(search, item)
    search.excess_left = excess(search.problem, search.fit)
    try:
        coarse = search.problem.at_step(COARSE)
        near = Near(search, coarse)
        near.promising(starts, _TRIED)
        trials = near.trials(_TRIED)
        done = [replace(t, fit=polish_to_the_bottom(search, t.fit, [t.start])) for t in trials[:2]]
        kept_too = [other.start for other in others]
        inside = [t for t in done if are_inside(search, [t.start, *kept_too], t.fit.vector)]
        return min(inside, key=lambda trial: trial.fit.cost, default=None)
    finally:
        search.restore(kept)


def put_in_place(search: Search, item: Accepted, other: Accepted, fit: Fit) -> None:
    """Let another one, fitted, take the place of what was added."""
    search.accepted[search.accepted.index(item)] = other
    search.fit, search.excess_left = fit, excess(search.problem, fit)


def fit_in_place(search: Search, item: Accepted, trial: Refit) -> Fit:
    """Return the fit with a candidate in the place of what was added, at the bottom of its cost.

    What was found has been fitted on and on. A rival that stops in a long valley (of mass and bulk
    modulus, whose ratio alone shows) would be behind for that, and be predicted from there.
    """
    vector = trial.start.as_in(trial.fit.vector, item.start.off(search.fit.vector))
    several = search.accepted if item.start.is_parameter else search.effects
    if len(several) == 1 and search.accepted[-1] is item:
        # nothing came after it: its parameters are those of its fit
        vector = trial.fit.vector.copy()
    free = tuple(
        free
        for free in free_of(search, vector, [trial.start])
        if free.key not in item.start.keys or free.key in trial.start.keys
    )
    fit = levenberg_marquardt(search.problem, vector, free, iterations=6, refresh=1)
    return at_the_bottom(search, fit)


def compared(search: Search, item: Accepted, fit: Fit) -> Improvement:
    """Return what another fit of an item gains over the model without it.

    Where it is the only one, that is the calibrated model; the present parameters were fitted with
    it, and without it they are nowhere.
    """
    if len(search.accepted) == 1:
        base = search.base
        before = levenberg_marquardt(search.problem, base.vector, base.free, iterations=0)
    else:
        before = fit_with_item_off(search, item)
    return compare(before, fit, search.groups, search.excess_base.total)


def fit_with_item_off(search: Search, item: Accepted) -> Fit:
    """Return the present fit with one item switched off."""
    vector = item.start.off(search.fit.vector)
    free = tuple(f for f in search.fit.free if f.key not in item.start.keys)
    return levenberg_marquardt(search.problem, vector, free, iterations=0)
