"""The shortest experiment that brings the widest interval of a parameter under what is asked."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from eha_bench.core.arrays import FloatArray
from eha_bench.experiment.candidates import Experiment
from eha_bench.experiment.decision import posterior_after
from eha_bench.experiment.hypothesis import Hypothesis
from eha_bench.experiment.rival_simulator import (
    RivalSimulator,
    SimulatedExperiment,
    one_after_the_other,
    sums_of,
)

_COMBINED = 4
"""Experiments that are tried together."""


@dataclass(frozen=True)
class Narrowed:
    """The shortest experiments, and half of the widest 95 % interval after them, relative."""

    experiments: list[Experiment]
    worst: float


def narrowest(
    simulator: RivalSimulator, screened: Sequence[SimulatedExperiment], budget: float, within: float
) -> Narrowed:
    """Return the shortest experiment that suffices, or the one that comes nearest.

    Args:
        simulator: of one rival. screened: the best experiments, the cheapest first; at least one.
        budget: bench time allowed, s. within: half of a 95 % interval that is asked for, relative.
    """
    best: tuple[tuple[float, float], Narrowed] | None = None
    rate, rival = simulator.bench.rate, simulator.rivals[0]
    for items in sums_of(screened, _COMBINED):
        *first, last = items
        gone = sum(item.ticks[-1] / rate for item in first)
        grams = one_after_the_other(items)
        for block, gram in enumerate(grams[len(grams) - len(last.ticks) :]):
            seconds = gone + last.ticks[block] / rate
            if seconds > budget + 0.5 / rate:
                break
            worst = worst_width(rival, posterior_after(rival, simulator.layout, gram, 0))
            order = (max(worst - within, 0.0), seconds)
            if best is None or order < best[0]:
                cut = [*(item.experiment for item in first), last.cut_after(block, rate)]
                best = order, Narrowed(cut, worst)
    assert best is not None
    return best[1]


def counted_parameters(widths: Iterable[str]) -> list[str]:
    """Return parameters whose interval counts: no curve's knots, no friction at rest."""
    return [key for key in widths if "[" not in key and not key.endswith("creep_speed")]


def worst_width(rival: Hypothesis, covariance: FloatArray) -> float:
    """Return half of the widest 95 % interval, as a share of its parameter."""
    own = rival.relative_half_widths(covariance)
    return max((own[name] for name in counted_parameters(own)), default=0.0)
