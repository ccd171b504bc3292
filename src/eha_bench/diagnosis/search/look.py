"""One look at everything that may be missing: screened, refitted, compared on runs left out.

Nuisance parameters (calibrated ones, start states, noise, friction at rest) are fitted with every
candidate; a candidate is credited only with what these cannot do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from eha_bench.diagnosis.fit.baseline import COARSE, SCREENING
from eha_bench.diagnosis.fit.convergence import left_to_gain
from eha_bench.diagnosis.fit.evidence import compare
from eha_bench.diagnosis.fit.least_squares import levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.side_by_side import side_by_side
from eha_bench.diagnosis.fit.start_angles import is_periodic
from eha_bench.diagnosis.search.equivalent import is_far_above_noise
from eha_bench.diagnosis.search.exchange import CLOSE
from eha_bench.diagnosis.search.hidden_starts import with_hidden_starts
from eha_bench.diagnosis.search.refit import (
    Near,
    at_the_bottom,
    free_of,
    is_bent,
    polish_afresh,
    polish_at_rest,
    polish_to_the_bottom,
    refit,
)
from eha_bench.diagnosis.search.screen import Screen, Screened
from eha_bench.diagnosis.search.settle import refine
from eha_bench.diagnosis.search.start_angles import with_own_angles
from eha_bench.diagnosis.search.state import (
    RankedCandidate,
    Refit,
    Search,
    rival_share,
    starts_of,
)
from eha_bench.diagnosis.search.swing import with_periods
from eha_bench.plants.layout import Layout

_SHORTLIST = 5
_NEAREST = 4
_FINALISTS = 3
_TURNING = 3
_PROMISING = 3
_FORMS = 3
"""Starts of a promising candidate whose settings are moved."""
_MOSTLY = 0.3
"""Share of the excess that may be left before effects of the shaft's angle are worth a scan."""
_WORST = -1.0
"""Least share that is told of what makes the error larger."""
_LEAST_EXCESS = 30.0
"""Least excess, in cost, that is."""
_HALF, _NEARLY_ALL = 0.5, 0.98
"""Shares of what is missing between which a candidate's shape may be off."""
_FORESEEN = 5.0
"""Multiple of what one more step is predicted to gain that a fit in a long valley may gain."""
_SHORT = 0.3
"""Share of what is enough to be added, from which a rough refit may come to it in the end."""
_ARRIVED = 0.8
"""Share of what is enough to be added that a refit has which may come to it by its last steps."""
_LEAST = 5.0
"""Least predicted fall of the cost that is worth a refit, which gains several times as much."""


def look(search: Search, *, first: bool) -> list[Refit]:
    """Screen everything, refit the most promising, and return these, the best first."""
    layout = search.problem.plant.layout
    used = [item.start.candidate for item in search.accepted]
    starts = [start for start in starts_of(search, used) if start.candidate not in used]
    turning = [effect.id for effect in layout.effects if is_periodic(effect)]
    still = [start for start in starts if start.candidate not in turning]
    # screening and first refits only compare candidates, so a coarser step is enough
    coarse = search.problem.coarser(COARSE, search.fit.vector, search.fit.residual)
    # what is small must not drown in the instants of sticking that a coarser step shifts
    much = is_bent(search.excess_left)
    near = Near.of(search, coarse) if much else None
    still = with_periods(search, still, near.fit.vector if near else search.fit.vector)
    if near is not None:
        # over long windows only what promised most over short ones
        still = near.promising(still, _PROMISING)
    screen = Screen(search.problem.at_step(SCREENING) if much else coarse, search.fit)
    screened = screen.all(still)
    if near is None:
        screened = _refine_promising(screen, screened, layout)
    finals = _confirm(search, coarse, screened, near)
    if _much_stays(search, finals):
        own = [start for start in starts if start.candidate in turning]
        if own:
            near = with_own_angles(search, near or Near.of(search, coarse), own)
            turned = _best_of_each(near.turning(own, _TURNING))
            finals += _refit_promising(search, turned, {}, afresh=False)
    best: dict[str, Screened] = {}
    for item in screened:
        best.setdefault(item.start.candidate, item)
    if not search.is_all_but_a_form:
        finals = with_hidden_starts(search, finals)
    finals = [_with_comparison(search, item) for item in _fit_rivals_further(search, finals)]
    finals.sort(key=lambda item: item.fit.cost)
    if first:
        search.ranking = _ranking(best, finals, search)
    return finals


def is_worth_a_look(search: Search) -> bool:
    """Whether enough is left to distinguish another cause from what a fit leaves over."""
    return search.thresholds.is_worth_a_look(search.excess_left)


def _much_stays(search: Search, finals: Sequence[Refit]) -> bool:
    """Whether the best of those refitted leaves so much that a scan of angles is worth its time.

    Where the noise was taken too large there is hardly an excess to leave; a structure in time asks
    for a cause all the same.
    """
    left = search.excess_left
    if not is_worth_a_look(search):
        return search.thresholds.has_structure(left)
    reached = min((item.fit.cost for item in finals), default=search.fit.cost)
    floor = search.fit.cost - left.total
    return reached > floor + max(_MOSTLY * left.total, _LEAST_EXCESS)


def _refine_promising(
    screen: Screen, screened: Sequence[Screened], layout: Layout
) -> list[Screened]:
    """Return the same, the most promising ones at better settings, the best first."""
    by_name: dict[str, list[Screened]] = {}
    for item in screened:
        if item.gain > _LEAST:
            by_name.setdefault(item.start.candidate, []).append(item)
    chosen = [item for own in [*by_name.values()][:_PROMISING] for item in own[:_FORMS]]
    better = side_by_side(lambda item: screen.refined(item, layout), chosen)
    left = [item for item in screened if all(item is not other for other in chosen)]
    return sorted([*better, *left], key=lambda item: -item.gain)


def _confirm(
    search: Search, coarse: Problem, screened: Sequence[Screened], near: Near | None
) -> list[Refit]:
    """Refit the most promising roughly, and to the end those that may win.

    Args:
        search: so far. coarse: its problem at a coarse step. screened: the best first.
        near: the same over short windows, where the search's parameters are bent; or None.
    """
    best: dict[str, Screened] = {}
    second: dict[str, Screened] = {}
    for item in screened:
        if item.start.candidate not in best:
            best[item.start.candidate] = item
        elif item.start.candidate not in second:
            second[item.start.candidate] = item
    least = max(_LEAST, 0.01 * search.excess_left.total)
    order = [name for name in best if best[name].gain > least]
    trials = []
    if near is not None:
        trials = near.trials(_NEAREST)
        # without the candidate the fit is there already: what ends worse than that was caught
        caught = {item.candidate for item in trials if item.fit.cost >= search.fit.cost}
        done = {item.candidate for item in trials} - caught
        trials += [refit(search, coarse, best[name]) for name in order if name in caught]
        order = [name for name in order if name not in done | caught]
    shortlist = [best[name] for name in order[: _SHORTLIST - len(trials)]]
    shortlist += [second[name] for name in order[:2] if name in second and second[name].gain > 0]
    refits = side_by_side(lambda item: refit(search, coarse, item), shortlist)
    trials = _best_of_each([*trials, *refits])
    promised = {name: item.gain for name, item in best.items()} if near is None else {}
    found = _refit_promising(search, trials, promised, afresh=near is None)
    reached = max((search.fit.cost - item.fit.cost for item in found), default=0.0)
    reached = max(reached, _least_of_hopeful(search))
    tried = {item.candidate for item in found}
    # a prediction is less than a refit gains: what promises more than was reached may yet win
    left = [best[name] for name in order if name not in tried and best[name].gain > reached]
    more = side_by_side(lambda item: refit(search, coarse, item), left[:_SHORTLIST])
    return [*found, *_refit_promising(search, _best_of_each(more), promised, afresh=near is None)]


def _refit_promising(
    search: Search, trials: Sequence[Refit], promised: Mapping[str, float], *, afresh: bool
) -> list[Refit]:
    """Refit those to the end that may win, the best first.

    Args:
        search: so far. trials: refitted roughly. promised: candidate -> gain that was predicted: a
            rough refit that gains less has not arrived. afresh: a fit may begin elsewhere.
    """
    gains = {item.candidate: search.fit.cost - item.fit.cost for item in trials}
    hopes = {name: max(gain, promised.get(name, 0.0)) for name, gain in gains.items()}
    enough = _least_of_hopeful(search)
    done: list[Refit] = []
    top = 0.0
    for number, trial in enumerate(sorted(trials, key=lambda item: -hopes[item.candidate])):
        least = rival_share(0.5, top, search.excess_left.total) * top
        hope = hopes[trial.candidate]
        behind = number > 0 and (number >= _FINALISTS or hope < least)
        if gains[trial.candidate] <= 0.0 or behind or hope < enough:
            done.append(trial)
            continue
        # where a rival has reached the noise already, a better place cannot beat it
        again = afresh and top < 0.95 * search.excess_left.total
        to_the_end = polish_afresh if again else polish_at_rest
        done.append(replace(trial, fit=to_the_end(search, trial.fit, [trial.start])))
        top = max(top, search.fit.cost - done[-1].fit.cost)
    return done


def _fit_rivals_further(search: Search, finals: Sequence[Refit]) -> list[Refit]:
    """Fit close rivals further: which comes first must not depend on which fit stopped earlier."""
    order = _arrived(search, finals)
    if not order or not _may_be_enough(search, order[0]):
        return order
    least = _least_of_close(search, order)
    close = [t for t in order[:_FINALISTS] if search.fit.cost - t.fit.cost > least > 0.0]
    close = [t for t in close if t is order[0] or not _is_beaten(search, t, order[0])]
    if len(close) < 2:
        return [_with_its_shape(search, order[0]), *order[1:]]
    # nor on what a coarse step leaves
    refine(search, close[0].fit.vector)
    done = [replace(t, fit=polish_to_the_bottom(search, t.fit, [t.start])) for t in close]
    return [*done, *(item for item in order if all(item is not other for other in close))]


def _is_beaten(search: Search, trial: Refit, best: Refit) -> bool:
    """Whether a refit can no longer be as good as the best one, which has reached the noise.

    All that may be left to gain of it is counted; what is behind by so much then is no equivalent
    (`is_as_good`), however much further both are fitted.
    """
    missing, gain = search.excess_left, search.fit.cost - best.fit.cost
    reached = gain > _NEARLY_ALL * missing.total and not is_far_above_noise(best.fit)
    if not (reached and is_bent(missing)):
        return False
    foreseen = trial.fit.cost - _FORESEEN * left_to_gain(trial.fit)
    return foreseen - best.fit.cost > search.thresholds.behind_share * gain


def _arrived(search: Search, finals: Sequence[Refit]) -> list[Refit]:
    """Return refits in order, those that may yet be close rivals at the bottom of their cost.

    Steps stop early in long valleys: a natural frequency and a damping that had imitated a delay
    lead back from it in hundreds of them, and a lag that never left would win.
    """
    order = sorted(finals, key=lambda item: item.fit.cost)
    least = _least_of_close(search, order)

    def may_be_close(trial: Refit) -> bool:
        gain, left = search.fit.cost - trial.fit.cost, left_to_gain(trial.fit)
        return gain > 0.0 and left > search.thresholds.behind and gain + _FORESEEN * left > least

    done = [
        replace(t, fit=at_the_bottom(search, t.fit)) if may_be_close(t) else t
        for t in order[:_FINALISTS]
    ]
    return sorted([*done, *order[_FINALISTS:]], key=lambda item: item.fit.cost)


def _least_of_close(search: Search, finals: Sequence[Refit]) -> float:
    """Return the fall of the cost from which a refit is a close rival of the best one."""
    top = max((search.fit.cost - item.fit.cost for item in finals), default=0.0)
    close = rival_share(CLOSE, top, search.excess_left.total) * top
    return max(close, _least_of_hopeful(search))


def _least_of_hopeful(search: Search) -> float:
    """Return the fall of the cost from which a rough refit may yet become enough to be added.

    Where what is clear is enough, a share of what is missing says nothing.
    """
    limits, missing = search.thresholds, search.excess_left
    if not (search.effects or limits.has_structure(missing)):
        return 0.0
    return _SHORT * _needed_share(search) * missing.total


def _may_be_enough(search: Search, best: Refit) -> bool:
    """Whether a refit that has arrived may yet be enough to be added beside what was."""
    needed = _needed_share(search) * search.excess_left.total
    return not search.effects or search.fit.cost - best.fit.cost > _ARRIVED * needed


def _needed_share(search: Search) -> float:
    """Return the share of what is missing that a candidate has to take to be added."""
    limits = search.thresholds
    if search.effects and search.share_left < limits.little:
        # what takes less of so little is the form of what is there
        return limits.beside
    return limits.least_share(search.excess_left)


def _with_its_shape(search: Search, trial: Refit) -> Refit:
    """Fit the best candidate on by slopes of its own, where it may fall short by its shape.

    Size and shape of what acts in few instants (iron that saturates) are nearly one number until
    both are right, and slopes over a large change lead nowhere there.
    """
    gained, missing = search.fit.cost - trial.fit.cost, search.excess_left.total
    if len(trial.start.keys) < 2 or not _HALF * missing < gained < _NEARLY_ALL * missing:
        return trial
    free = free_of(search, trial.fit.vector, [trial.start])
    fit = levenberg_marquardt(search.problem, trial.fit.vector, free, refresh=4)
    return replace(trial, fit=fit) if fit.cost < trial.fit.cost else trial


def _ranking(
    best: dict[str, Screened], finals: Sequence[Refit], search: Search
) -> list[RankedCandidate]:
    lines = [
        RankedCandidate(
            item.candidate,
            # what is far worse has no share
            max(min(item.comparison.share, item.comparison.share_out), _WORST),
            item.comparison.p_value,
            item.fit.cost,
            best[item.candidate].gain if item.candidate in best else item.comparison.gain,
            True,
        )
        for item in finals
    ]
    done = {item.candidate for item in finals}
    # where there is hardly any excess, shares of it mean nothing
    scale = max(search.excess_left.total, 300.0)
    lines += [
        RankedCandidate(
            name, item.gain / scale, float("nan"), search.fit.cost - item.gain, item.gain, False
        )
        for name, item in best.items()
        if name not in done
    ]
    return lines


def _best_of_each(trials: Sequence[Refit]) -> list[Refit]:
    best: dict[str, Refit] = {}
    for item in trials:
        if item.candidate not in best or item.fit.cost < best[item.candidate].fit.cost:
            best[item.candidate] = item
    return sorted(best.values(), key=lambda item: item.fit.cost)


def _with_comparison(search: Search, trial: Refit) -> Refit:
    found = compare(search.fit, trial.fit, search.groups, search.excess_left.total)
    return replace(trial, comparison=found)
