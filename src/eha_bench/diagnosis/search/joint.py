"""Looks for two effects at once, where one after the other has not explained what is there.

The first of two is fitted while the second is missing, so what fits best then may be neither of
them, and with it the right ones are not found. Over short windows a fit takes a fraction of a
second. There the best few first ones are each taken for given, everything else is screened again
with them, and the best pairs are fitted: a beam search (Lowerre, The HARPY Speech Recognition
System, 1976), of which a stepwise search is the narrowest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from eha_bench.diagnosis.fit.baseline import COARSE
from eha_bench.diagnosis.fit.candidates import SheetNumber, Start, is_drawn
from eha_bench.diagnosis.fit.evidence import NOT_COMPARED, Improvement, compare, excess
from eha_bench.diagnosis.fit.side_by_side import side_by_side
from eha_bench.diagnosis.fit.start_angles import is_periodic
from eha_bench.diagnosis.search.backward import without
from eha_bench.diagnosis.search.bounds import are_inside
from eha_bench.diagnosis.search.forms import take_best_form
from eha_bench.diagnosis.search.refit import Near, Nearby, is_bent, polish_to_the_bottom
from eha_bench.diagnosis.search.settle import rebase, settle
from eha_bench.diagnosis.search.state import Accepted, Search, accept_nothing, starts_of

_FIRSTS = 4
_SECONDS = 3
_FINALISTS = 4
_STARTS = 3
_PLAUSIBLE = 0.5
"""Share of what the short windows hold that a pair must explain there to be taken further."""
_LARGER = 0.4
"""Share of it that the larger of two must explain alone: half, less what both could."""
_PLAUSIBLE_BENT = 0.25
_LARGER_BENT = 0.05
"""The same two shares where so much is missing that the parameters of short windows imitate it as
well: of a servo's weight and friction, which explain 86 % over whole runs, they held 35 and 8 %."""
_ARRIVING = 0.5
"""Share of what two have to explain in all, that a pair has to explain over long windows before it
is fitted to the end: friction at rest and other forms add to it, but do not double it."""
_MAY_WIN = 0.8
"""Share of what was found that a pair must explain before forms are tried."""
_LEAVES = 2.0
"""Most that two others may leave over short windows, in what was found leaves there: over long ones
they have to leave less."""


def joint(search: Search) -> bool:
    """Replace what was found by two that explain more together; return whether anything was.

    Where nothing was found, one of the two may do, which the other only led out of a place in
    which it had been caught.
    """
    kept = search.snapshot()
    try:
        return _take_pair(search, kept)
    except BaseException:
        # stopped or failed: a pair that has not stood its tests is no finding
        search.restore(kept)
        raise


def _take_pair(search: Search, kept: Search) -> bool:
    """Look for the best pair, and take it or what it led to; return whether anything was taken.

    Args:
        search: as found. kept: a snapshot of that.
    """
    limits = search.thresholds
    accept_nothing(search)
    best = _best(search, kept)
    search.restore(kept)
    if best is None or not _may_win(search, best):
        return False
    search.fit = best.fit
    search.accepted = [Accepted(start, NOT_COMPARED, ()) for start in best.starts]
    search.excess_left = excess(search.problem, search.fit)
    for number in range(len(search.accepted)):
        # each form was chosen before the other effect was there
        take_best_form(search, search.accepted[number])
    least = limits.together * search.excess_base.total
    enough = search.excess_base.total - search.excess_left.total >= least
    found = [_beside(search, item) for item in search.accepted]
    more = search.fit.cost <= kept.fit.cost - limits.gain
    if not (enough and more):
        search.restore(kept)
        return False
    if all(gained is not None for gained in found):
        search.accepted = [
            replace(item, comparison=gained)
            for item, gained in zip(search.accepted, found, strict=True)
            if gained is not None
        ]
    elif kept.effects or not _is_one(search, found, kept.fit.cost):
        search.restore(kept)
        return False
    settle(search)
    rebase(search)
    return True


def _is_one(search: Search, found: Sequence[Improvement | None], before: float) -> bool:
    """Take the one of two that the other only led to; return whether it explains enough alone.

    Args:
        search: with both. found: what each gains over the other, None where that is not enough.
        before: cost of what was found.
    """
    limits, items = search.thresholds, search.accepted
    needed = [item for item, gained in zip(items, found, strict=True) if gained is not None]
    if len(needed) != 1:
        return False
    (item,) = needed
    idle = next(other for other in items if other is not item)
    alone = without(search, idle)
    missing = search.excess_base
    gained = compare(search.base, alone, search.groups, missing.total)
    clear = limits.allow(gained) and limits.is_enough(gained, missing, 0)
    if not (clear and alone.cost <= before - limits.gain):
        return False
    search.accepted, search.fit = [replace(item, comparison=gained)], alone
    search.excess_left = excess(search.problem, alone)
    return True


def _may_win(search: Search, pair: Nearby) -> bool:
    """Whether two may explain more than what was found, once each has its best form.

    What was found has its best form: a second one beside it has to gain from the start.
    """
    if search.accepted and _holds(pair, [item.start for item in search.accepted]):
        return pair.fit.cost < search.fit.cost
    found = search.base.cost - search.fit.cost
    return search.base.cost - pair.fit.cost > _MAY_WIN * found


def _holds(pair: Nearby, starts: Sequence[Start]) -> bool:
    """Whether candidates are all among the two of a pair."""
    return {one.candidate for one in starts} <= {one.candidate for one in pair.starts}


def _beside(search: Search, item: Accepted) -> Improvement | None:
    """Return what one of two gains over the other, refitted alone; None where that is not enough.

    As one effect after the other: a small part of what the other leaves is more likely its form.
    """
    limits, alone = search.thresholds, without(search, item)
    left = excess(search.problem, alone)
    gained = compare(alone, search.fit, search.groups, left.total)
    enough = min(gained.share, gained.share_out) > limits.least_share(left)
    return gained if enough and limits.allow(gained) else None


def _best(search: Search, kept: Search) -> Nearby | None:
    """Return the best pair refitted to the end, None where none is worth it.

    Args:
        search: with nothing added. kept: as found.
    """
    layout = search.problem.plant.layout
    near = Near.of(search, search.problem.at_step(COARSE))
    # a number of a drawing explains nearly all alone, or is only bent by what is missing; one of
    # a sheet is taken alone as well
    starts = [
        start
        for start in starts_of(search)
        if not (is_drawn(layout, start) or isinstance(start, SheetNumber))
    ]
    turning = [effect.id for effect in layout.effects if is_periodic(effect)]
    # effects of the shaft's angle are scanned for at length: only where that was worth it before
    seen = {trial.candidate for trials in search.looks for trial in trials}
    own = [start for start in starts if start.candidate in turning and start.candidate in seen]
    still = near.promising([s for s in starts if s.candidate not in turning], _STARTS)
    turned = {item.starts[-1].candidate: item for item in reversed(near.refit_periodic(own))}
    firsts = sorted([*near.fits(_FIRSTS), *turned.values()], key=_cost)[:_FIRSTS]
    bent = is_bent(search.excess_left)
    larger = _LARGER_BENT if bent else _LARGER
    if not firsts or near.fit.cost - _cost(firsts[0]) < larger * near.excess:
        return None
    pairs: dict[frozenset[str], Nearby] = {}
    for first in firsts:
        others = [s for s in still if s.candidate != first.starts[0].candidate]
        for pair in near.beside(first, others, _SECONDS):
            name = frozenset(start.candidate for start in pair.starts)
            if name not in pairs or _cost(pair) < _cost(pairs[name]):
                pairs[name] = pair
    plausible = (_PLAUSIBLE_BENT if bent else _PLAUSIBLE) * near.excess
    good = [pair for pair in pairs.values() if near.gain(pair) > plausible]
    if not good:
        return None
    found = _over_short_windows(near, kept)
    good = [pair for pair in good if _may_pass(kept, near, pair, found)]
    good = sorted(good, key=_cost)[:_FINALISTS]
    done = side_by_side(lambda pair: Nearby(pair.starts, near.long(pair)), good)
    least = _ARRIVING * search.thresholds.together * search.excess_base.total
    done = [pair for pair in done if search.base.cost - _cost(pair) > least]
    # what polishes prepares the search's own windows: one after the other
    done = [Nearby(p.starts, polish_to_the_bottom(search, p.fit, p.starts)) for p in done]
    inside = [pair for pair in done if are_inside(search, pair.starts, pair.fit.vector)]
    return min(inside, key=_cost, default=None)


def _over_short_windows(near: Near, kept: Search) -> Nearby | None:
    """Return what was found, refitted over the short windows; None where nothing was."""
    if not kept.accepted:
        return None
    starts, vector = tuple(item.start for item in kept.accepted), near.fit.vector
    for start in starts:
        vector = start.as_in(kept.fit.vector, vector)
    return near.fit_together(starts, vector)


def _may_pass(kept: Search, near: Near, pair: Nearby, found: Nearby | None) -> bool:
    """Whether two may explain more than what was found, by what they do over short windows.

    Where one was found that explains nearly all, no two others will do so by chance. A second one
    beside it was looked for, over long windows; over short ones it has to explain as much of what
    the first leaves as it has to in the end.

    Args:
        kept: as found. near: the short windows. pair: two, fitted there. found: what was found,
            fitted there.
    """
    if found is None:
        return True
    gained, missing = near.gain(found), near.excess
    if _holds(pair, found.starts):
        share = kept.thresholds.least_share(kept.excess_left)
        return near.gain(pair) - gained > share * (missing - gained)
    return missing - near.gain(pair) < _LEAVES * (missing - gained)


def _cost(item: Nearby) -> float:
    return item.fit.cost
