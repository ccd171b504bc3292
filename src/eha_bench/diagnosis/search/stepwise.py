"""Finds what is missing, one effect after the other, with another look at those already found."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from eha_bench.core.progress import ProgressHook
from eha_bench.diagnosis.fit.evidence import Improvement
from eha_bench.diagnosis.search.backward import drop, release, review, without_idle
from eha_bench.diagnosis.search.choice import choose, equivalents
from eha_bench.diagnosis.search.exchange import exchange, take_better_equivalents
from eha_bench.diagnosis.search.forms import take_best_form
from eha_bench.diagnosis.search.joint import joint
from eha_bench.diagnosis.search.look import is_worth_a_look, look
from eha_bench.diagnosis.search.refit import is_bent
from eha_bench.diagnosis.search.settle import lower, rebase, settle
from eha_bench.diagnosis.search.state import Accepted, Refit, Search
from eha_bench.diagnosis.search.whole_runs import compare_over_whole_runs

MOST_EFFECTS = 4
_MOST_ADDED = 6
"""Effects, and numbers that may be declared wrongly beside them."""
_NEARLY = 0.1
"""Share of what was missing that is left where it is nearly explained."""
_MOVED = 0.1
"""Share of what is left by which an exchange lowers it where another look is worth its time."""


def run(search: Search, progress: ProgressHook) -> None:
    """Add effects to the search until nothing more is found, and look at them again together."""
    progress("search", 0.0)
    before = search.excess_base
    little = search.thresholds.is_unexplained(before) and not is_bent(before)
    if little and not search.accepted:
        # so little may also be what a calibration that stopped early leaves over
        settle(search)
        search.base, search.excess_base = search.fit, search.excess_left
    _grow(search, progress)
    if search.effects and search.is_unexplained:
        progress("search", 0.8)
        as_found = search.snapshot()
        if exchange(search):
            review(search)
            if _is_elsewhere(search, as_found):
                _grow(search, progress)
    if search.is_unexplained and not (_are_all_but_their_forms(search) or search.pairs_tried):
        progress("search", 0.9)
        search.pairs_tried = True
        kept = search.snapshot()
        if joint(search):
            if (idle := without_idle(search)) is not None:
                drop(search, search.accepted[-1], idle)
            if search.is_unexplained:
                exchange(search)
            review(search)
            _grow(search, progress)
            if search.excess_left.relative > kept.excess_left.relative:
                search.restore(kept)
    release(search)
    take_better_equivalents(search)
    compare_over_whole_runs(search)
    progress("search", 1.0)


def _grow(search: Search, progress: ProgressHook) -> None:
    """Add one effect after the other until nothing more is found."""
    while len(search.effects) < MOST_EFFECTS and len(search.accepted) < _MOST_ADDED:
        if search.looks and not (is_worth_a_look(search) or _refused_for_its_share(search)):
            return
        progress("search", len(search.accepted) / (_MOST_ADDED + 1))
        trials = _latest_look(search)
        chosen = choose(search, trials)
        if chosen is None:
            return
        _add(search, chosen, trials)
        if (idle := without_idle(search)) is not None:
            drop(search, search.accepted[-1], idle)
            continue
        if is_worth_a_look(search) and take_best_form(search, search.accepted[-1]):
            settle(search)
            rebase(search)
        review(search)
        if search.is_unexplained:
            lower(search)
        if _is_nearly_explained(search):
            # what is left of what was nearly explained is more likely a wrong form than a new cause
            exchange(search)


def _are_all_but_their_forms(search: Search) -> bool:
    """Whether no other two effects are worth looking for: what is left is more likely a form.

    Two that were found one after the other leave more of it than one does.
    """
    several = len(search.effects) > 1 and search.share_left < search.thresholds.little
    return several or search.is_all_but_a_form


def _is_elsewhere(search: Search, before: Search) -> bool:
    """Whether another look may find what the one before an exchange did not."""
    added, earlier = ([item.start.candidate for item in one.accepted] for one in (search, before))
    much = search.excess_left.total < (1.0 - _MOVED) * before.excess_left.total
    return much or added != earlier


def _is_nearly_explained(search: Search) -> bool:
    """Whether what was found explains nearly everything, but not all of it."""
    nearly = search.excess_left.total < _NEARLY * search.excess_base.total
    return nearly and is_worth_a_look(search) and len(search.accepted) > 0


def _refused_for_its_share(search: Search) -> bool:
    """Whether something was sure in the last look, and enough of what is missing by other noise."""
    if search.looked_from is not None:
        return False
    added = {item.start.candidate for item in search.accepted}
    return any(
        search.thresholds.allow(item.comparison) and _is_enough_now(search, item.comparison)
        for item in search.looks[-1]
        if not item.start.is_parameter and item.candidate not in added
    )


def _is_enough_now(search: Search, found: Improvement) -> bool:
    """Whether a gain would be enough of the excess as it is told now."""
    missing = search.excess_left
    now = found.gain / found.share / missing.total if found.share * missing.total else math.inf
    again = replace(found, share=found.share * now, share_out=found.share_out * now)
    return search.thresholds.is_enough(again, missing, len(search.effects))


def _latest_look(search: Search) -> list[Refit]:
    """Return a look from where the search is, or the last one where nothing has changed since."""
    if search.looks and search.looked_from is search.fit:
        return search.looks[-1]
    search.looks.append(look(search, first=not search.looks))
    search.looked_from = search.fit
    return search.looks[-1]


def _add(search: Search, chosen: Refit, trials: Sequence[Refit]) -> None:
    # the fit first: interrupted in what follows, the two still belong together
    search.fit = chosen.fit
    search.accepted.append(
        Accepted(chosen.start, chosen.comparison, equivalents(search, chosen, trials))
    )
    settle(search)
    rebase(search)
