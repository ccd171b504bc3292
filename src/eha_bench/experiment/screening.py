"""Screens permitted experiments: which would decide after the least bench time.

Every kind of signal in every permitted setup is brought to the largest size that keeps the limits,
simulated at the rivals' fitted values and along their posteriors' axes, and ranked by the bench
time after which it reaches what is asked for. The best are varied.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.experiment.candidates import candidates, neighbour_of
from eha_bench.experiment.lengthening import LONGEST
from eha_bench.experiment.rival_simulator import RivalSimulator, SimulatedExperiment

_BEST = 5
_VARIED = 3
_VARIATIONS = 5


def best_experiments(
    simulator: RivalSimulator, budget: float, shares_reached: Callable[[FloatArray], FloatArray]
) -> list[SimulatedExperiment]:
    """Return the best experiments, after variation, the cheapest first.

    Args:
        simulator: of experiments. budget: bench time allowed, s.
        shares_reached: inner products up to the end of each block -> what is reached by then, as a
            share of what is needed, (blocks,).
    """
    rate = simulator.bench.rate

    def price(item: SimulatedExperiment) -> float:
        """Return the bench time after which an experiment would decide, s."""
        reached = shares_reached(item.grams)
        enough = np.flatnonzero(reached >= 1.0)
        if enough.size:
            return item.ticks[int(enough[0])] / rate
        return item.experiment.seconds / max(float(reached[-1]), 1e-9)

    every = list(candidates(simulator.plan, min(budget, LONGEST)))
    found: list[tuple[float, SimulatedExperiment]] = []
    for number, experiment in enumerate(every):
        simulator.progress("candidates", number / len(every))
        if (item := simulator.at_fitted_values(experiment)) is not None:
            found.append((price(item), item))
    rng = np.random.default_rng([simulator.seed, 1])
    for number, best in enumerate(_unlike(found)[:_VARIED]):
        here = best
        for step in range(_VARIATIONS):
            simulator.progress("vary", (number + step / _VARIATIONS) / _VARIED)
            neighbour = neighbour_of(here[1].experiment, rng, simulator.plan)
            if (item := simulator.at_fitted_values(neighbour)) is None:
                continue
            found.append((price(item), item))
            here = min(here, found[-1], key=lambda pair: pair[0])
    return [item for _, item in _unlike(found)]


def _unlike(
    found: Sequence[tuple[float, SimulatedExperiment]],
) -> list[tuple[float, SimulatedExperiment]]:
    """Return the best few by their price, of which no three are of one kind in one setup."""
    kept: list[tuple[float, SimulatedExperiment]] = []
    for cost, item in sorted(found, key=lambda pair: pair[0]):
        own = item.experiment
        alike = [k for _, k in kept if (k.experiment.kind, k.experiment.setup)
                 == (own.kind, own.setup)]  # fmt: skip
        if len(alike) < 2:
            kept.append((cost, item))
        if len(kept) == _BEST:
            break
    return kept
