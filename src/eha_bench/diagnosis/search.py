"""Finds what is missing, one effect after the other, with another look at those already found.

Everything that is mundane (calibrated parameters, start states, noise, friction at rest) is fitted
with every candidate; a candidate is credited only with what these cannot do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eha_bench.diagnosis.baseline import COARSE, FRICTION_AT_REST, SCREENING, friction_at_rest
from eha_bench.diagnosis.candidates import Start, all_starts
from eha_bench.diagnosis.evidence import (
    SOFT_MEAN,
    Comparison,
    Groups,
    compare,
    excess,
    refined_noise,
)
from eha_bench.diagnosis.fit import Fit, Free, free_parameters, levenberg_marquardt
from eha_bench.diagnosis.periodic import is_periodic, scan, short_problem
from eha_bench.diagnosis.problem import Problem, soften
from eha_bench.diagnosis.screen import Screen, Screened
from eha_bench.diagnosis.search_state import (
    Accepted,
    Ranked,
    Search,
    Thresholds,
    Trial,
    begin,
)
from eha_bench.diagnosis.unknown import medium_problem

FloatArray = NDArray[np.float64]
Progress = Callable[[str, float], None]

__all__ = ["Search", "begin", "equivalents", "look", "run"]

MOST_EFFECTS = 4
_SHORTLIST = 5
_FINALISTS = 3
_POOR = 1.02
"""A fit this much above the noise may be caught in another minimum."""
_LEAST = 5.0
"""Least predicted fall of the cost that is worth a refit, which gains several times as much."""


def run(search: Search, progress: Progress, *, thresholds: Thresholds | None = None) -> None:
    """Add effects to the search until nothing more is found."""
    limits = thresholds or Thresholds()
    for number in range(MOST_EFFECTS):
        progress("search", number / MOST_EFFECTS)
        if number > 0 and not _worth_a_look(search):
            break
        trials = look(search, first=number == 0)
        search.looks.append(trials)
        chosen = _choose(trials, limits)
        if chosen is None:
            break
        _add(search, chosen, trials)
        if _idle(search, limits):
            _drop_last(search)
            continue
        _review(search, limits)
    progress("search", 1.0)


def _idle(search: Search, limits: Thresholds) -> bool:
    """Whether what was added last does nothing: its refit only led the others to a better place."""
    vector = search.fit.vector.copy()
    start = search.accepted[-1].start
    vector[start.strength_at] = start.neutral
    soft, _ = soften(search.problem.residual(vector), search.problem.soft)
    return float(soft @ soft) - search.fit.cost < limits.gain


def _drop_last(search: Search) -> None:
    """Take out what was added last, and keep the better place."""
    item, kept = search.accepted[-1], search.accepted[:-1]
    search.fit = _without(search, item, kept)
    search.accepted = kept
    search.excess_left = excess(search.problem, search.fit)


def _worth_a_look(search: Search) -> bool:
    """Whether anything is left beyond what the noise's own estimate is uncertain by."""
    left = search.excess_left
    return left.total > 0.01 * left.size or left.significance > 4.0


def look(search: Search, *, first: bool) -> list[Trial]:
    """Screen everything, refit the most promising, and return these, the best first."""
    layout = search.problem.plant.layout
    used = [item.start.candidate for item in search.accepted]
    starts = [
        start
        for start in all_starts(layout, search.fit.vector, [*search.declared, *used], search.keys)
        if start.candidate not in used
    ]
    # screening and first refits only compare candidates, so a coarser step is enough
    coarse = search.problem.at_step(COARSE)
    screen = Screen(search.problem.at_step(SCREENING), search.fit)
    turning = [effect.id for effect in layout.effects if is_periodic(effect)]
    screened = screen.all([start for start in starts if start.candidate not in turning])
    finals = _confirm(search, coarse, screened)
    reached = min((item.fit.cost for item in finals), default=search.fit.cost)
    floor = search.fit.cost - search.excess_left.total
    if _worth_a_look(search) and reached > floor + max(0.02 * search.excess_left.total, 30.0):
        own = [start for start in starts if start.candidate in turning]
        more = screen.all(_periodic(search, turning, own))
        screened = sorted([*screened, *more], key=lambda item: -item.gain)
        finals += _confirm(search, coarse, more)
    best: dict[str, Screened] = {}
    for item in screened:
        best.setdefault(item.start.candidate, item)
    finals = [_compared(search, item) for item in finals]
    finals.sort(key=lambda item: item.fit.cost)
    if first:
        search.ranking = _ranking(best, finals, search)
    return finals


def _confirm(search: Search, coarse: Problem, screened: Sequence[Screened]) -> list[Trial]:
    """Refit the most promising roughly, and to the end those that may win."""
    best: dict[str, Screened] = {}
    second: dict[str, Screened] = {}
    for item in screened:
        if item.start.candidate not in best:
            best[item.start.candidate] = item
        elif item.start.candidate not in second:
            second[item.start.candidate] = item
    least = max(_LEAST, 0.01 * search.excess_left.total)
    order = [name for name in best if best[name].gain > least]
    shortlist = [best[name] for name in order[:_SHORTLIST]]
    shortlist += [second[name] for name in order[:2] if name in second and second[name].gain > 0]
    trials = _best_of_each([_refit(search, coarse, item) for item in shortlist])
    done: list[Trial] = []
    top = 0.0
    for number, trial in enumerate(trials):
        rough_gain = search.fit.cost - trial.fit.cost
        if rough_gain <= 0.0 or (number > 0 and (number >= _FINALISTS or rough_gain < 0.5 * top)):
            done.append(trial)
            continue
        # where a rival has reached the noise already, a better place cannot beat it
        again = top < 0.95 * search.excess_left.total
        done.append(replace(trial, fit=_polish(search, trial.fit, [trial.start], afresh=again)))
        top = max(top, search.fit.cost - done[-1].fit.cost)
    return done


def _periodic(search: Search, names: Sequence[str], starts: Sequence[Start]) -> list[Start]:
    """Return starts of effects periodic in the shaft's angle, as a scan of the count finds them."""
    short = short_problem(search.problem, search.problem.noise) if starts else None
    if short is None:
        return []
    layout = search.problem.plant.layout
    keys = [item.key for item in search.fit.free if "[" not in item.key]
    out: list[Start] = []
    for name in names:
        own = [start for start in starts if start.candidate == name]
        out += scan(short.at_step(COARSE), search.fit.vector, keys, layout, own)
    return out


def _ranking(best: dict[str, Screened], finals: Sequence[Trial], search: Search) -> list[Ranked]:
    lines = [
        Ranked(
            item.candidate,
            min(item.comparison.share, item.comparison.share_out),
            item.comparison.p_value,
            item.fit.cost,
            best[item.candidate].gain,
            True,
        )
        for item in finals
    ]
    done = {item.candidate for item in finals}
    # where there is hardly any excess, shares of it mean nothing
    scale = max(search.excess_left.total, 300.0)
    lines += [
        Ranked(name, item.gain / scale, float("nan"), search.fit.cost - item.gain, item.gain, False)
        for name, item in best.items()
        if name not in done
    ]
    return lines


def _free(search: Search, vector: FloatArray, extra: Sequence[Start]) -> tuple[Free, ...]:
    layout = search.problem.plant.layout
    keys = [key for key in search.keys if not _sticks(key, vector[layout.index[key]])]
    for start in [*(item.start for item in search.accepted), *extra]:
        keys += [key for key in start.keys if key not in keys]
    return free_parameters(layout, keys, vector)


def _sticks(key: str, value: float) -> bool:
    """Whether friction at rest has come back to sticking: free there, it spoils a Jacobian."""
    return key in FRICTION_AT_REST and value == 0.0


def _refit(search: Search, coarse: Problem, item: Screened) -> Trial:
    size = item.amplitude
    # a predicted amplitude is a fraction of the real one; never start from nothing
    size = float(np.sign(size) or 1.0) * max(abs(size), 1e-3)
    vector = item.start.apply(search.fit.vector, size)
    vector[item.start.strength_at] = np.clip(
        vector[item.start.strength_at], item.start.low, item.start.high
    )
    free = _free(search, vector, [item.start])
    known = {f.key: search.fit.jacobian[:, k] for k, f in enumerate(search.fit.free)}
    fit = levenberg_marquardt(coarse, vector, free, iterations=4, known=known, refresh=0)
    return Trial(item.start, fit, Comparison(0, 0, 0, 0, 1, 0))


def _polish(search: Search, rough: Fit, extra: Sequence[Start], *, afresh: bool = True) -> Fit:
    """Fit to the end, from where the rough fit is and, if that is poor, from declared values."""
    problem = search.problem
    vector = rough.vector
    known = {f.key: rough.jacobian[:, k] for k, f in enumerate(rough.free)}
    if afresh and rough.cost > _POOR * SOFT_MEAN * problem.size:
        other = _afresh(search, vector, extra)
        if other.cost < rough.cost:
            vector = other.vector
            known = {f.key: other.jacobian[:, k] for k, f in enumerate(other.free)}
    return levenberg_marquardt(
        problem, vector, _free(search, vector, extra), known=known, refresh=1
    )


def _afresh(search: Search, vector: FloatArray, extra: Sequence[Start]) -> Fit:
    """Fit from declared values, over short windows first and then over long ones.

    Without an effect the parameters had been bent to imitate it, and over long windows they may
    stay caught there; short windows have hardly any other minimum.
    """
    problem = search.problem
    layout = problem.plant.layout
    again = vector.copy()
    for key in search.keys:
        again[layout.index[key]] = search.declared_vector[layout.index[key]]
    coarse = problem.at_step(COARSE)
    short = medium_problem(coarse)
    short.prepare(again)
    short.scale_to(short.residual(again))
    free = [item for item in _free(search, again, extra) if item.key not in FRICTION_AT_REST]
    near = levenberg_marquardt(short, again, free, iterations=8, refresh=1)
    other = levenberg_marquardt(coarse, near.vector, free, iterations=4, refresh=0)
    names = [item.key for item in free if "[" not in item.key]
    return friction_at_rest(coarse, other, tuple(names))[0]


def _best_of_each(trials: Sequence[Trial]) -> list[Trial]:
    best: dict[str, Trial] = {}
    for item in trials:
        if item.candidate not in best or item.fit.cost < best[item.candidate].fit.cost:
            best[item.candidate] = item
    return sorted(best.values(), key=lambda item: item.fit.cost)


def _compared(search: Search, trial: Trial) -> Trial:
    found = compare(search.fit, trial.fit, search.groups, search.excess_left.total)
    return replace(trial, comparison=found)


def _choose(trials: Sequence[Trial], limits: Thresholds) -> Trial | None:
    good = [item for item in trials if _believed(item, limits)]
    if not good:
        return None
    chosen = good[0]
    for item in good:
        # what is mundane is preferred where it explains as much
        behind = item.fit.cost - chosen.fit.cost
        if item.start.mundane and behind < 0.02 * chosen.comparison.gain:
            return item
    return chosen


def _believed(item: Trial, limits: Thresholds) -> bool:
    found = item.comparison
    return (
        found.gain > limits.gain
        and found.gain_out > limits.gain / 2
        and min(found.share, found.share_out) > limits.share
        and found.p_value < limits.p_value
        and found.runs_better >= limits.runs_better
    )


def equivalents(chosen: Trial, trials: Sequence[Trial], groups: Groups) -> tuple[str, ...]:
    """Return candidates whose fit is not worse than the chosen one's beyond resampling noise."""
    found = []
    for item in trials:
        if item.candidate == chosen.candidate or item.start.mundane:
            continue
        if item.comparison.gain < 0.5 * chosen.comparison.gain:
            continue
        behind = compare(item.fit, chosen.fit, groups, 1.0)
        # down at the noise the likelihood ratio holds; above it only resampling does
        at_noise = chosen.fit.cost < 1.01 * SOFT_MEAN * chosen.fit.residual.size
        little = behind.gain < 0.05 * chosen.comparison.gain
        if behind.gain < 12.0 or (not at_noise and little and behind.p_value > 0.02):
            found.append(item.candidate)
    return tuple(found)


def _add(search: Search, chosen: Trial, trials: Sequence[Trial]) -> None:
    # the fit first: interrupted in what follows, the two still belong together
    search.fit = chosen.fit
    search.accepted.append(
        Accepted(chosen.start, chosen.comparison, equivalents(chosen, trials, search.groups))
    )
    residual = _reweighted(search, chosen.fit.vector)
    soft, _ = soften(residual, search.problem.soft)
    search.fit = _polish(
        search, replace(chosen.fit, residual=residual, cost=float(soft @ soft)), [], afresh=False
    )
    search.base = levenberg_marquardt(
        search.problem,
        search.base.vector,
        search.base.free,
        known={f.key: search.base.jacobian[:, k] for k, f in enumerate(search.base.free)},
        refresh=0,
    )
    search.excess_left = excess(search.problem, search.fit)
    search.excess_base = excess(search.problem, search.base)


def _reweighted(search: Search, vector: FloatArray) -> FloatArray:
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


def _review(search: Search, limits: Thresholds) -> None:
    """Take out what a later addition has made needless."""
    for item in list(search.accepted[:-1]):
        kept = [other for other in search.accepted if other is not item]
        trial = _without(search, item, kept)
        found = compare(trial, search.fit, search.groups, search.excess_base.total)
        if found.gain_out < limits.gain / 2 or found.p_value > limits.p_value:
            search.accepted = kept
            search.fit = trial
            search.excess_left = excess(search.problem, trial)


def _without(search: Search, item: Accepted, kept: Sequence[Accepted]) -> Fit:
    vector = search.fit.vector.copy()
    vector[item.start.strength_at] = item.start.neutral
    layout = search.problem.plant.layout
    keys = [key for key in search.keys if not _sticks(key, vector[layout.index[key]])]
    for other in kept:
        keys += [key for key in other.start.keys if key not in keys]
    free = free_parameters(layout, keys, vector)
    coarse = search.problem.at_step(COARSE)
    rough = levenberg_marquardt(coarse, vector, free, iterations=5, refresh=0)
    before, search.accepted = search.accepted, list(kept)
    try:
        return _polish(search, rough, [])
    finally:
        search.accepted = before
