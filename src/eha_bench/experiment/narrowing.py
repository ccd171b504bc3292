"""The shortest experiment that brings the widest interval of a parameter under what is asked.

It is found by slopes at the fitted values. Where a parameter is hardly known, these hold for little
of its posterior: so the widths are worked out again about draws of it, the median of them counts,
and the experiment is made longer until they are narrow enough, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.friction_at_rest import is_friction_at_rest
from eha_bench.experiment.candidates import Experiment
from eha_bench.experiment.decision import posterior_after
from eha_bench.experiment.hypothesis import Hypothesis
from eha_bench.experiment.lengthening import SHORTEST, longer
from eha_bench.experiment.rival_simulator import (
    RivalSimulator,
    SimulatedExperiment,
    one_after_the_other,
    sums_of,
)

_COMBINED = 4
"""Experiments that are tried together."""
_DRAWS = 8
"""Draws about which widths are worked out."""
_LONGER = 4
"""Most times that an experiment is made longer."""


@dataclass(frozen=True)
class Narrowed:
    """The shortest experiments, and half of each 95 % interval after them, relative."""

    experiments: list[Experiment]
    widths: Mapping[str, float]

    @property
    def worst(self) -> float:
        """Half of the widest interval, as a share of its parameter."""
        return max((self.widths[key] for key in counted_parameters(self.widths)), default=0.0)


def narrowest(
    simulator: RivalSimulator, screened: Sequence[SimulatedExperiment], budget: float, within: float
) -> Narrowed:
    """Return the shortest experiment that suffices, or the one that comes nearest.

    Args:
        simulator: of one rival. screened: the best experiments, the cheapest first; at least one.
        budget: bench time allowed, s. within: half of a 95 % interval that is asked for, relative.
    """
    chosen = _shortest(simulator, screened, budget, within)
    best: Narrowed | None = None
    for _ in range(_LONGER):
        found = Narrowed(chosen, widths_after(simulator, chosen))
        if best is None or found.worst < best.worst:
            best = found
        further = longer(chosen, budget)
        if found.worst <= within or further is None:
            break
        chosen = further
    assert best is not None
    return best


def widths_after(
    simulator: RivalSimulator, experiments: Sequence[Experiment]
) -> Mapping[str, float]:
    """Return half of each 95 % interval after experiments, relative: the median over draws.

    Args:
        simulator: of one rival. experiments: one after the other.
    """
    rival = simulator.rivals[0]
    rng = np.random.default_rng([simulator.seed, 5])
    found: list[Mapping[str, float]] = []
    for z in rng.standard_normal((_DRAWS, len(rival.keys))):
        there = rival.drawn(z)
        own = replace(simulator, rivals=(there,))
        parts = [
            own.simulated(item, own.respond(item, own.layout), own.layout, 90 + number)
            for number, item in enumerate(experiments)
        ]
        gram = one_after_the_other(parts)[-1]
        found.append(there.relative_half_widths(posterior_after(there, own.layout, gram, 0)))
    keys = [key for key in found[0] if all(key in own for own in found)]
    return {key: float(np.median([own[key] for own in found])) for key in keys}


def _shortest(
    simulator: RivalSimulator, screened: Sequence[SimulatedExperiment], budget: float, within: float
) -> list[Experiment]:
    """Return the shortest experiment that suffices by slopes at the fitted values."""
    best: tuple[tuple[float, float], list[Experiment]] | None = None
    rate, rival = simulator.bench.rate, simulator.rivals[0]
    for items in sums_of(screened, _COMBINED):
        *first, last = items
        gone = sum(item.ticks[-1] / rate for item in first)
        grams = one_after_the_other(items)
        for block, gram in enumerate(grams[len(grams) - len(last.ticks) :]):
            seconds = gone + last.ticks[block] / rate
            if seconds > budget + 0.5 / rate:
                break
            if last.ticks[block] < min(SHORTEST * rate, last.ticks[-1]):
                continue
            worst = worst_width(rival, posterior_after(rival, simulator.layout, gram, 0))
            order = (max(worst - within, 0.0), seconds)
            if best is None or order < best[0]:
                cut = [*(item.experiment for item in first), last.cut_after(block, rate)]
                best = order, cut
    assert best is not None
    return best[1]


def counted_parameters(widths: Iterable[str]) -> list[str]:
    """Return parameters whose interval counts: no curve's knots, no friction at rest."""
    return [key for key in widths if "[" not in key and not is_friction_at_rest(key)]


def worst_width(rival: Hypothesis, covariance: FloatArray) -> float:
    """Return half of the widest 95 % interval, as a share of its parameter."""
    own = rival.relative_half_widths(covariance)
    return max((own[name] for name in counted_parameters(own)), default=0.0)
