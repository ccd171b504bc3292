"""Distinguishes over whole runs what windows do not.

Each window has a start state of its own, which takes what is slow: a weight and a friction that is
larger one way may leave the same in windows, and part over a run. A whole run adds every error up.
So it says more where a model holds over it, down to white noise, and a likelihood ratio counts
there: what it speaks against is out, and what it does not tell apart is equivalent, also where
windows, whose start states are read off, prefer one. Where none does, it only says that every form
is a little off, and what windows say stands.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.windows import cut_windows, runs_of
from eha_bench.diagnosis.fit.baseline import COARSE
from eha_bench.diagnosis.fit.candidates import Start, one_of_each_form
from eha_bench.diagnosis.fit.evidence import NOT_COMPARED, SOFT_MEAN, compare, excess, groups_of
from eha_bench.diagnosis.fit.least_squares import Fit, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.side_by_side import side_by_side
from eha_bench.diagnosis.search.equivalent import is_far_above_noise
from eha_bench.diagnosis.search.exchange import CLOSE, compared, put_in_place
from eha_bench.diagnosis.search.refit import free_of
from eha_bench.diagnosis.search.state import Accepted, Refit, Search, starts_of
from eha_bench.diagnosis.search.yielding import yields_to

_UNCUT = float("inf")
_ITERATIONS = 8
_RIVALS = 3
_LITTLE_MORE = 1.1
"""Cost over that of the effect up to which a rival may only have been caught over windows."""


def compare_over_whole_runs(search: Search) -> None:
    """Let whole runs say what is equivalent; a rival that they speak for is exchanged."""
    if search.thresholds.has_structure(search.excess_left) and is_far_above_noise(search.fit):
        # what leaves as much in windows leaves more over whole runs, and these decide nothing
        return
    if _contested(search) and (problem := _over_whole_runs(search.problem)) is not None:
        compare_over(search, problem)


def compare_over(search: Search, problem: Problem) -> None:
    """Decide between each effect and its rivals where they fit other windows of the same runs.

    Args:
        search: at its end; an effect, what is equivalent and the fit may become others.
        problem: the same runs, cut otherwise.
    """
    problem.prepare(search.fit.vector)
    for item in _contested(search):
        _compare(search, problem, item)


def _contested(search: Search) -> list[Accepted]:
    """Return effects that have rivals."""
    return [item for item in search.effects if len(_names(search, item)) > 1]


def _over_whole_runs(problem: Problem) -> Problem | None:
    """Return the problem over whole runs; None where no run is cut, or each has to be."""
    windows = [
        window
        for measured in runs_of(problem.windows)
        for window in cut_windows(measured, problem.noise, _UNCUT)
    ]
    return problem.over(windows) if len(windows) < len(problem.windows) else None


def _compare(search: Search, problem: Problem, item: Accepted) -> None:
    """Decide over whole runs between an effect and its rivals."""
    others = [other for other in search.accepted if other is not item]
    within = replace(search.snapshot(), problem=problem, groups=groups_of(problem))
    within.accepted = others
    own = item.start.candidate
    fits = {name: _best(within, begun) for name, begun in _begun(search, item)}
    # what describes the same with more numbers may stand beside it, not in its place
    able = [one for name, one in fits.items() if yields_to(search, name, one.fit.vector) != own]
    best = min(able, key=lambda one: one.fit.cost)
    if excess(problem, best.fit).significance > search.thresholds.white:
        return
    equal = [
        name
        for name, one in sorted(fits.items(), key=lambda pair: pair[1].fit.cost)
        if not _is_behind(within, one.fit, best.fit)
    ]
    if own in equal:
        equivalent = tuple(name for name in equal if name != own)
        search.accepted[search.accepted.index(item)] = replace(item, equivalent=equivalent)
        return
    equivalent = tuple(name for name in equal if name != best.start.candidate)
    within = replace(search.snapshot(), accepted=others)
    free = free_of(within, best.fit.vector, [best.start])
    fit = levenberg_marquardt(search.problem, best.fit.vector, free, refresh=1)
    found = compared(search, item, fit)
    put_in_place(search, item, Accepted(best.start, found, equivalent), fit)


def _is_behind(within: Search, other: Fit, best: Fit) -> bool:
    """Whether a fit is worse than the best by more than white noise makes, however loud that is."""
    limits = within.thresholds
    loudness = max(1.0, best.cost / (SOFT_MEAN * best.residual.size))
    seen = compare(other, best, within.groups, 1.0)
    return seen.gain >= limits.behind * loudness and seen.p_value <= limits.chance


def _names(search: Search, item: Accepted) -> list[str]:
    """Return an effect and its rivals: equivalents, and those that left little more."""
    look = search.look_of(item)
    own = next((trial for trial in look if trial.candidate == item.start.candidate), None)
    taken = {other.start.candidate for other in search.accepted}
    close = [
        trial.candidate
        for trial in look
        if own is not None
        and trial.candidate not in taken
        and not trial.start.is_parameter
        and trial.comparison.gain > CLOSE * own.comparison.gain
        and trial.fit.cost < _LITTLE_MORE * own.fit.cost
    ]
    return [*dict.fromkeys([item.start.candidate, *item.equivalent, *close[:_RIVALS]])]


def _begun(search: Search, item: Accepted) -> Iterator[tuple[str, list[tuple[Start, FloatArray]]]]:
    """Yield candidates with where their fits begin, (size,) each.

    That is where a candidate was fitted in a look, and its other forms.
    """
    layout = search.problem.plant.layout
    look = search.look_of(item)
    taken = [other.start.candidate for other in search.accepted if other is not item]
    every = starts_of(search, taken)
    off = item.start.off(search.fit.vector)
    for name in _names(search, item):
        fitted = [(trial.start, trial.fit) for trial in look if trial.candidate == name]
        if name == item.start.candidate:
            fitted = [(item.start, search.fit)]
        begun = [(start, start.as_in(fit.vector, off)) for start, fit in fitted]
        forms = one_of_each_form(layout, [start for start in every if start.candidate == name])
        yield name, [*begun, *((start, start.apply(off)) for start in forms)]


def _best(within: Search, begun: Sequence[tuple[Start, FloatArray]]) -> Refit:
    """Return the best fit over whole runs of some starts in an item's place."""
    coarse = within.problem.at_step(max(within.problem.step, COARSE))

    def rough(pair: tuple[Start, FloatArray]) -> Refit:
        start, vector = pair
        free = free_of(within, vector, [start])
        fit = levenberg_marquardt(coarse, vector, free, iterations=_ITERATIONS, refresh=1)
        return Refit(start, fit, NOT_COMPARED)

    best = min(side_by_side(rough, begun), key=lambda one: one.fit.cost)
    fit = levenberg_marquardt(within.problem, best.fit.vector, best.fit.free, refresh=1)
    return replace(best, fit=fit)
