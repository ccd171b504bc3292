"""Experiments planned in other ways, for comparison: by chance, and by D-optimality.

Both are permitted as the proposal is: the same safety file, setups and signals, every extreme
simulated over the rivals' posteriors, and the same bench time. What a proposal states of itself is
stated of them too: they decide less surely, so that stated and happened can be compared down to
probabilities that no proposal would have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.experiment.candidates import (
    Experiment,
    ExperimentSettings,
    candidates,
    neighbour_of,
)
from eha_bench.experiment.commanded import Commanded
from eha_bench.experiment.decision import DrawRows, Odds, inner_products, layout_of, odds
from eha_bench.experiment.hypothesis import Hypothesis, read_question, rivals_to_separate
from eha_bench.experiment.permitted import permitted_ranges
from eha_bench.experiment.response import Bench, largest, respond
from eha_bench.experiment.separating import FRESH
from eha_bench.suites import Suite, load_suite

_DRAWS = 12


@dataclass(frozen=True)
class OtherExperiment:
    """An experiment that was planned in another way, and how surely it decides."""

    suite: Suite
    odds: Odds


class OtherPlanners:
    """Experiments of a given bench time for what a diagnosis leaves open.

    Args:
        diagnosis: its folder. safety: a suite that says what is safe. seconds: bench time.
        seed: of what is drawn.
    """

    def __init__(self, diagnosis: Path, safety: Path, seconds: float, seed: int) -> None:
        question = read_question(diagnosis)
        self.rivals = rivals_to_separate(question.rivals)
        plant, commanded = self.rivals[0].model.plant, Commanded.of(question)
        self.plant = plant
        self.bench = Bench.of(question.covered, plant, commanded.channel)
        self.permitted = permitted_ranges(
            plant, commanded, [rival.vector for rival in self.rivals], question.covered, safety
        )
        command = {key: item for key, item in self.permitted.command.items()
                   if item.high > item.low}  # fmt: skip
        self.plan = ExperimentSettings(
            commanded, command, self.bench.rate, {key: {} for key in command}
        )  # fmt: skip
        self.seconds = seconds
        self.rng = np.random.default_rng([seed, 9])

    def by_chance(self) -> OtherExperiment | None:
        """Return a permitted experiment drawn at random; None where none of many is permitted."""
        every = list(candidates(self.plan, self.seconds))
        for _ in range(40):
            drawn = every[int(self.rng.integers(len(every)))]
            drawn = neighbour_of(drawn, self.rng, self.plan).lasting(self.seconds)
            safe = self._largest(drawn)
            if safe is not None:
                return self._stated(safe.at_size(safe.size * float(self.rng.uniform(0.3, 1.0))))
        return None

    def d_optimal(self) -> OtherExperiment | None:
        """Return the experiment with the largest determinant of the information.

        The information is that of the parameters of the model that fits best, its effects' among
        them, in addition to what the recordings hold (Atkinson, Donev and Tobias, Optimum
        Experimental Designs, with SAS, Oxford 2007, ch. 9).
        """
        best: tuple[float, Experiment] | None = None
        layout = layout_of(self.rivals[:1], 0)
        for item in candidates(self.plan, self.seconds):
            safe = self._largest(item.lasting(self.seconds))
            if safe is None:
                continue
            (gram,) = self._products(safe, self.rivals[:1], layout, 0)
            own = layout.rows()[1][0]
            information = np.eye(layout.sizes[0]) + gram[own, own]
            value = float(np.linalg.slogdet(information)[1])
            if np.isfinite(value) and (best is None or value > best[0]):
                best = value, safe
        return None if best is None else self._stated(best[1])

    def _largest(self, item: Experiment) -> Experiment | None:
        """Return it at the largest size that keeps every limit over the posteriors."""
        draws = layout_of(self.rivals, _DRAWS, np.random.default_rng(5)).draws
        limits = self.permitted.limits[item.setup]
        return largest(self.rivals, draws, item, self.plan, self.bench, limits)

    def _stated(self, item: Experiment) -> OtherExperiment:
        """Return it with its odds over draws of its own."""
        layout = layout_of(self.rivals, FRESH, np.random.default_rng(6))
        (found,) = odds(layout, self._products(item, self.rivals, layout, 1))
        return OtherExperiment(load_suite(self.plan.suite([item], ["part_1"])), found)

    def _products(
        self, item: Experiment, rivals: Sequence[Hypothesis], layout: DrawRows, seed: int
    ) -> FloatArray:
        """Return inner products at its end, (1, rows, rows)."""
        trial = self.plan.trials([item], ["t"])[0]
        found = respond(rivals, layout.points, trial, self.bench, {}, self.plan.commanded)
        ticks = [round(self.seconds * self.bench.rate)]
        return inner_products(layout, found.outputs, self.plant.outputs, found.bench, ticks, [seed])
