"""Simulates experiments by every rival, within what is permitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations_with_replacement

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.interruption import checkpoint
from eha_bench.core.progress import ProgressHook
from eha_bench.experiment.candidates import Experiment, ExperimentSettings
from eha_bench.experiment.decision import BLOCK, DrawRows, inner_products, layout_of
from eha_bench.experiment.hypothesis import Hypothesis
from eha_bench.experiment.lengthening import TOGETHER
from eha_bench.experiment.permitted import Permitted
from eha_bench.experiment.response import (
    SMALLEST,
    Bench,
    LimitMargin,
    Responses,
    largest,
    respond,
)
from eha_bench.posterior.covered import Covered


@dataclass(frozen=True)
class SimulatedExperiment:
    """An experiment with the inner products of its simulation, up to the end of each block."""

    experiment: Experiment
    ticks: tuple[int, ...]
    grams: FloatArray

    def cut_after(self, block: int, rate: float) -> Experiment:
        """Return the experiment up to the end of a block, by number; rate in samples a second."""
        return self.experiment.lasting(self.ticks[block] / rate)


def one_after_the_other(items: Sequence[SimulatedExperiment]) -> FloatArray:
    """Return the inner products of several experiments, up to the end of each of their blocks."""
    parts: list[FloatArray] = []
    for item in items:
        parts.append(item.grams + (parts[-1][-1] if parts else 0.0))
    return np.concatenate(parts)


def sums_of(
    items: Sequence[SimulatedExperiment], combined: int
) -> list[tuple[SimulatedExperiment, ...]]:
    """Return each experiment, and sums of up to `TOGETHER` of the first few.

    Args:
        items: the best first. combined: how many of them are added to others.
    """
    return [
        several
        for count in range(1, TOGETHER + 1)
        for several in combinations_with_replacement(
            items[:combined] if count > 1 else items, count
        )
    ]


@dataclass
class RivalSimulator:
    """What every experiment is simulated with.

    Attributes:
        rivals: explanations. covered: where recordings have been. bench: sensors.
        permitted: what the rig may be asked for.
        plan: what all trials have in common. seed: of all draws.
        progress: called with the stage and the fraction of it done.
        layout: the fitted values and the axes of each posterior, without draws.
        tried: how many experiments were simulated. refused: those that break a limit.
    """

    rivals: tuple[Hypothesis, ...]
    covered: Covered
    bench: Bench
    permitted: Permitted
    plan: ExperimentSettings
    seed: int
    progress: ProgressHook
    tried: int = 0
    refused: list[Experiment] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Lay out what is simulated of each rival where nothing is drawn."""
        self.layout = layout_of(self.rivals, 0)

    def draws(self, count: int, *stream: int) -> DrawRows:
        """Return so many draws of each posterior, of a stream of random numbers."""
        return layout_of(self.rivals, count, np.random.default_rng([self.seed, *stream]))

    def respond(self, experiment: Experiment, layout: DrawRows) -> Responses:
        """Return what every rival records of an experiment, and what it leaves of each limit."""
        checkpoint()
        trial = self.plan.trials([experiment], ["t"])[0]
        limits = self.permitted.limits[experiment.setup]
        return respond(self.rivals, layout.points, trial, self.bench, limits, self.plan.commanded)

    def goes_beyond(self, experiment: Experiment, responses: Responses) -> bool:
        """Whether a rival predicts a channel further than the experiment's setup was recorded."""
        piston, bypass = experiment.setup
        setup = self.covered.setup(piston.value, bypass.value)
        if setup is None:
            return True
        return any(
            any(self.covered.beyond(setup, self._extremes(readings)))
            for readings in responses.outputs
        )

    def _extremes(self, readings: FloatArray) -> dict[str, tuple[float, float]]:
        """Return how far each channel goes at the fitted values, which come first."""
        fitted = readings[0]
        return {
            name: (float(fitted[:, k].min()), float(fitted[:, k].max()))
            for k, name in enumerate(self.rivals[0].model.plant.outputs)
        }

    def products(
        self, responses: Responses, layout: DrawRows, ticks: Sequence[int], stream: int
    ) -> FloatArray:
        """Return inner products up to each tick; `stream` numbers the draws of noise."""
        outputs = self.rivals[0].model.plant.outputs
        drawn = [self.seed, stream]
        return inner_products(layout, responses.outputs, outputs, responses.bench, ticks, drawn)

    def ticks(self, experiment: Experiment) -> tuple[int, ...]:
        """Return the tick at the end of each block."""
        count = round(experiment.seconds * self.bench.rate)
        block = max(2, round(BLOCK * self.bench.rate))
        return (*range(block, count, block), count)

    def at_fitted_values(self, experiment: Experiment) -> SimulatedExperiment | None:
        """Simulate at the fitted values and along the posterior's axes; None if that is unsafe.

        The size is the largest that keeps the limits.
        """
        self.tried += 1
        nominal = [np.zeros((1, len(rival.keys))) for rival in self.rivals]
        limits = self.permitted.limits[experiment.setup]
        item = largest(self.rivals, nominal, experiment, self.plan, self.bench, limits)
        found = None if item is None else self._safe(item, self.layout, 0.7, 3)
        if found is None:
            self.refused.append(experiment)
            return None
        return self.simulated(*found, self.layout, 0)

    def tightest_limit(self) -> tuple[LimitMargin, int] | None:
        """Return the limit that most refused experiments break even at their smallest size.

        By the mildest of them, and with how many do; None where none does.
        """
        broken: dict[str, list[LimitMargin]] = {}
        for experiment in self.refused:
            small = experiment.at_size(SMALLEST * experiment.size)
            for room in self.respond(small, self.layout).rooms:
                if room.used > 1.0:
                    broken.setdefault(room.channel, []).append(room)
        if not broken:
            return None
        most = max(broken.values(), key=len)
        return min(most, key=lambda room: room.used), len(most)

    def with_draws(
        self, experiment: Experiment, layout: DrawRows, number: int
    ) -> SimulatedExperiment | None:
        """Simulate with draws of the posteriors, smaller where one of them breaks a limit."""
        found = self._safe(experiment, layout, 0.75, 4)
        return None if found is None else self.simulated(*found, layout, number)

    def simulated(
        self, experiment: Experiment, responses: Responses, layout: DrawRows, stream: int
    ) -> SimulatedExperiment:
        """Return an experiment with the inner products of its responses."""
        ticks = self.ticks(experiment)
        return SimulatedExperiment(
            experiment, ticks, self.products(responses, layout, ticks, stream)
        )

    def safe_responses(
        self, experiment: Experiment, layout: DrawRows
    ) -> tuple[Experiment, Responses] | None:
        """Return an experiment, hardly smaller where it has to be, and its responses."""
        return self._safe(experiment, layout, 0.85, 5)

    def _safe(
        self, item: Experiment, layout: DrawRows, factor: float, times: int
    ) -> tuple[Experiment, Responses] | None:
        """Return an experiment that keeps every limit, smaller by a factor as often as needed."""
        for _ in range(times):
            responses = self.respond(item, layout)
            if responses.safe:
                return item, responses
            item = item.at_size(factor * item.size)
        return None
