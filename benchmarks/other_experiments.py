"""Experiments planned in other ways, for comparison: by chance, and by D-optimality.

Both are permitted as the proposal is: the same safety file, setups and signals, every extreme
simulated over the rivals' posteriors, and the same bench time.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eha_bench.experiment.candidates import (
    Experiment,
    ExperimentSettings,
    candidates,
    neighbour_of,
    unit_of_level,
)
from eha_bench.experiment.decision import inner_products, layout_of
from eha_bench.experiment.hypothesis import read_question, rivals_to_separate
from eha_bench.experiment.permitted import mode_of, permitted_ranges
from eha_bench.experiment.response import Bench, largest, respond
from eha_bench.suites import Suite, load_suite

_DRAWS = 12


class OtherPlanners:
    """Experiments of a given bench time for what a diagnosis leaves open.

    Args:
        diagnosis: its folder. safety: a suite that says what is safe. seconds: bench time.
        seed: of what is drawn.
    """

    def __init__(self, diagnosis: Path, safety: Path, seconds: float, seed: int) -> None:
        question = read_question(diagnosis)
        self.rivals = rivals_to_separate(question.rivals)
        plant = self.rivals[0].model.plant
        self.plant = plant
        self.bench = Bench.of(question.covered, plant.outputs, plant.command)
        self.permitted = permitted_ranges(
            plant, [rival.vector for rival in self.rivals], question.covered, safety
        )
        command = {key: item for key, item in self.permitted.command.items()
                   if item.high > item.low}  # fmt: skip
        self.plan = ExperimentSettings(
            mode_of(plant), unit_of_level(plant.command), command, self.bench.rate,
            {key: {} for key in command},
        )  # fmt: skip
        self.seconds = seconds
        self.rng = np.random.default_rng([seed, 9])

    def by_chance(self) -> Suite | None:
        """Return a permitted experiment drawn at random; None where none of many is permitted."""
        every = list(candidates(self.plan, self.seconds))
        for _ in range(40):
            drawn = every[int(self.rng.integers(len(every)))]
            drawn = neighbour_of(drawn, self.rng, self.plan).lasting(self.seconds)
            safe = self._largest(drawn)
            if safe is not None:
                return self._suite(safe.at_size(safe.size * float(self.rng.uniform(0.3, 1.0))))
        return None

    def d_optimal(self) -> Suite | None:
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
            trial = self.plan.trials([safe], ["t"])[0]
            found = respond(self.rivals[:1], layout.points, trial, self.bench, {})
            ticks = [round(self.seconds * self.bench.rate)]
            gram = inner_products(
                layout, found.outputs, self.plant.outputs, self.bench, ticks, [0]
            )[-1]
            own = layout.rows()[1][0]
            information = np.eye(layout.sizes[0]) + gram[own, own]
            value = float(np.linalg.slogdet(information)[1])
            if np.isfinite(value) and (best is None or value > best[0]):
                best = value, safe
        return None if best is None else self._suite(best[1])

    def _largest(self, item: Experiment) -> Experiment | None:
        """Return it at the largest size that keeps every limit over the posteriors."""
        draws = layout_of(self.rivals, _DRAWS, np.random.default_rng(5)).draws
        limits = self.permitted.limits[item.setup]
        return largest(self.rivals, draws, item, self.plan, self.bench, limits)

    def _suite(self, item: Experiment) -> Suite:
        return load_suite(self.plan.suite([item], ["part_1"]))
