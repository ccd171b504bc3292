"""Whether a little that stays unknown is the sensors' own: zeros that wander.

A verdict of unknown rests on a residual with structure in time, and noise that is slow has that,
too. Where little is left, no curve follows it and no effect explains it, zeros that wander are
asked for; where they leave much less, they are noise, and everything is searched for again.
"""

from __future__ import annotations

from dataclasses import replace

from eha_bench.diagnosis.fit.baseline import Baseline
from eha_bench.diagnosis.fit.evidence import excess
from eha_bench.diagnosis.fit.wandering import (
    refitted,
    wandering,
    with_noise_of_residual,
    with_wander,
)
from eha_bench.diagnosis.outcome.decide import Decision
from eha_bench.diagnosis.outcome.diagnosis import Verdict
from eha_bench.diagnosis.search.state import Search

_LITTLE = 0.2
"""Excess in the noise's cost: zeros that wander by 0.4 of the noise leave about as much."""
_FOLLOWED = 0.15
"""Share of it from which a curve follows something: noise follows nothing."""
_LEFT = 0.5
"""Share of its structure in time that may be left to a model whose sensors wander."""


def with_slow_noise(base: Baseline, search: Search, decision: Decision) -> Baseline | None:
    """Return the calibrated model with zeros that wander, or None where these explain nothing.

    Args:
        base: as calibrated. search: finished, without any effect. decision: on it.
    """
    much = search.excess_base.relative > _LITTLE
    if decision.verdict is not Verdict.UNKNOWN or search.accepted or much:
        return None
    if decision.unknown is not None and decision.unknown.share > _FOLLOWED:
        return None
    search.problem.prepare(search.base.vector)
    problem = with_noise_of_residual(search.problem, search.base.vector)
    fit = refitted(problem, search.base)
    wander = wandering(problem, fit)
    if not wander:
        return None
    problem = with_wander(problem, wander)
    fit = refitted(problem, fit)
    if excess(problem, fit).significance > _LEFT * search.excess_base.significance:
        return None
    runs = {window.measured.run.name: window.measured for window in problem.windows}
    sizes = ", ".join(f"{name} {item.size:.2f}" for name, item in sorted(wander.items()))
    note = f"the zero of some sensors drifts slowly, which counts as noise ({sizes} of the noise)"
    return replace(
        base,
        measured=tuple(runs.get(item.run.name, item) for item in base.measured),
        problem=problem,
        fit=fit,
        notes=(*base.notes, note),
    )
