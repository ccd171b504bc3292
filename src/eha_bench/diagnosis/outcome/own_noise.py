"""Whether a little that is left is the sensors' own: noise of another size, colour, or zero.

Noise is told first from stretches in which nothing moves. They are few: a colour shows in them to a
tenth, a zero that wanders not at all. Both have structure in time, on which a verdict rests. What a
fitted model leaves tells them better, once it leaves hardly more than noise; then what was found
has to stand out of that noise, and what is left is looked at again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from eha_bench.diagnosis.data.wander import Wander
from eha_bench.diagnosis.fit.baseline import Baseline, colour_notes
from eha_bench.diagnosis.fit.evidence import excess
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.wandering import (
    refit_with_noise,
    wandering,
    with_noise_of_residual,
    with_wander,
)
from eha_bench.diagnosis.outcome.decide import Decision
from eha_bench.diagnosis.outcome.diagnosis import Verdict
from eha_bench.diagnosis.search.other_noise import refitted_search
from eha_bench.diagnosis.search.state import Search

_LITTLE = 0.2
"""Excess in the noise's cost: zeros that wander by 0.4 of the noise leave about as much."""
_MUCH = 4.0
"""Excess in the noise's cost of a filter's noise, whose differences hold a fifth of its power: it
then remembers for four samples."""
_WRONG = 0.2
"""Excess without structure from which the noise is taken again: a model that lacked what has been
found left it a memory that it does not have, and white noise then counts more than twice."""
_FOLLOWED = 0.15
"""Share of it from which a curve follows something: noise follows nothing."""
_LEFT = 0.5
"""Share of its structure in time that may be left to a model whose sensors wander."""


def with_own_noise(base: Baseline, search: Search) -> tuple[Baseline, Search] | None:
    """Return baseline and search with noise as the search's fit leaves it, or None.

    Levels and colours come from short stretches, in which nothing slow counts. Zeros that wander
    are asked for with effects only, and only if they leave nothing that is unexplained: without
    an effect something slow may be what is missing.

    Args:
        base: as calibrated. search: finished.
    """
    rest, limits = search.excess_left, search.thresholds
    structured = limits.has_structure(rest)
    # a fit that leaves less than the noise says that the noise was taken too large; one that leaves
    # more, without structure, that it was taken from what the model without the effects left
    another = rest.relative < -limits.rest or (bool(search.effects) and rest.relative > _WRONG)
    if rest.relative > _MUCH or not (structured or another):
        return None
    search.problem.prepare(search.fit.vector)
    problem = with_noise_of_residual(search.problem, search.fit.vector)
    fit = refit_with_noise(problem, search.fit)
    wander: Mapping[str, Wander] = {}
    if search.effects and limits.has_structure(excess(problem, fit)):
        wander = wandering(problem, fit)
    if wander:
        wandered = with_wander(problem, wander)
        beside = refit_with_noise(wandered, fit)
        if limits.has_structure(excess(wandered, beside)):
            wander = {}
        else:
            problem, fit = wandered, beside
    found = refitted_search(search, problem, fit)
    return _with_noise(replace(base, fit=found.base), problem, wander), found


def with_slow_noise(base: Baseline, search: Search, decision: Decision) -> Baseline | None:
    """Return the calibrated model with zeros that wander, or None where these explain nothing.

    Args:
        base: as calibrated. search: finished, without any effect. decision: on it.
    """
    much = search.excess_base.relative > _LITTLE
    if decision.verdict is not Verdict.UNKNOWN or search.effects or much:
        return None
    if decision.unknown is not None and decision.unknown.share > _FOLLOWED:
        return None
    search.problem.prepare(search.base.vector)
    problem = with_noise_of_residual(search.problem, search.base.vector)
    fit = refit_with_noise(problem, search.base)
    wander = wandering(problem, fit)
    if not wander:
        return None
    problem = with_wander(problem, wander)
    fit = refit_with_noise(problem, fit)
    left = excess(problem, fit)
    much = left.significance > _LEFT * search.excess_base.significance
    if much and search.thresholds.is_unexplained(left):
        return None
    return _with_noise(replace(base, fit=fit), problem, wander)


def _with_noise(base: Baseline, problem: Problem, wander: Mapping[str, Wander]) -> Baseline:
    runs = {window.measured.run.name: window.measured for window in problem.windows}
    measured = tuple(runs.get(item.run.name, item) for item in base.measured)
    before, now = (tuple(colour_notes(items)) for items in (base.measured, measured))
    notes = (*(note for note in base.notes if note not in before), *now)
    if wander:
        sizes = ", ".join(f"{name} {item.size:.2f}" for name, item in sorted(wander.items()))
        note = (
            f"something slow that follows nothing is left, and counts as noise ({sizes} of the "
            "noise): zeros of sensors that drift, or laws of a slightly other form"
        )
        notes = (*notes, note)
    return replace(
        base,
        measured=measured,
        problem=problem,
        notes=notes,
    )
