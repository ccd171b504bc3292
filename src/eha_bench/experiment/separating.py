"""The shortest experiment, or sum of two or three, that names the right one of several rivals.

Draws from the rivals' posteriors decide (`decision.odds`), and draws that did not choose it confirm
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from eha_bench.core.arrays import FloatArray
from eha_bench.experiment.candidates import Experiment
from eha_bench.experiment.decision import DrawRows, Odds, is_spread, odds
from eha_bench.experiment.lengthening import SHORTEST, longer
from eha_bench.experiment.response import Responses
from eha_bench.experiment.rival_simulator import (
    RivalSimulator,
    SimulatedExperiment,
    one_after_the_other,
    sums_of,
)

MOST_WRONG = 0.02
"""Probability of naming a wrong rival that an experiment may have."""
FRESH = 24
"""Draws that check what was chosen."""
_COMBINED = 3
"""Experiments that are tried together."""
_DRAWS = 12
_GENTLER = 0.6
"""Share by which the experiment is made smaller, again and again, while it still decides."""
_SMALLEST = 0.01
_LONGER = 6
"""Most times that an experiment is made longer."""
_BETTER = 0.02
"""Rise of the probability that is worth more bench time."""
_NO_BETTER = 2
"""Times that more bench time brings nothing until it is believed: draws are few."""
_IN_FEW_BLOCKS = 1e-6
"""What an experiment that decides by few blocks is short of: more than nothing, less than any that
does not decide."""
_WORTH = 0.5
"""Least probability of naming the right rival that is worth bench time."""


@dataclass(frozen=True)
class Separation:
    """The experiment that separates rivals best.

    Attributes:
        experiments: one after the other. odds: by the draws that chose them.
        surest: the one that was found best before draws decided.
        layout: of those draws.
    """

    experiments: list[Experiment]
    odds: Odds
    surest: Experiment
    layout: DrawRows


def is_worth_bench_time(found: Odds) -> bool:
    """Whether an experiment names the right rival often enough, and a wrong one seldom enough."""
    return found.right >= _WORTH and found.wrong <= 2.0 * MOST_WRONG


@dataclass(frozen=True)
class Separating:
    """A search for the shortest experiment.

    Attributes:
        simulator: of experiments. budget: bench time allowed, s.
        probability: of naming the right rival that is asked for.
    """

    simulator: RivalSimulator
    budget: float
    probability: float

    def best(self, screened: Sequence[SimulatedExperiment]) -> Separation | None:
        """Return the shortest experiment that suffices, or the surest; None where none is safe."""
        layout = self.simulator.draws(_DRAWS, 2)
        drawn: list[SimulatedExperiment] = []
        for number, item in enumerate(screened):
            self.simulator.progress("draws", number / len(screened))
            again = self.simulator.with_draws(item.experiment, layout, 10 + number)
            if again is not None:
                drawn.append(again)
        if not drawn:
            return None
        chosen, found = self._shortest(drawn, layout)
        return Separation(chosen, found, drawn[0].experiment, layout)

    def confirmed(self, found: Separation) -> list[Experiment]:
        """Return its experiments as gentle as decides as surely, and as long as is confirmed."""
        chosen = found.experiments
        if len(chosen) == 1:
            chosen = [self._gentlest(chosen[0], found.layout, found.odds)]
        return self._lengthen_until_confirmed(chosen)

    def _suffices(self, found: Odds) -> bool:
        """Whether the right rival is named as surely as asked for."""
        return found.right >= self.probability and found.wrong <= MOST_WRONG

    def _short_of(self, found: Odds, *, spread: bool) -> float:
        """Return how far an experiment is from one that suffices and whose gain is spread, or 0."""
        if not self._suffices(found):
            return 1.0 - found.worth
        return 0.0 if spread else _IN_FEW_BLOCKS

    def _shortest(
        self, drawn: Sequence[SimulatedExperiment], layout: DrawRows
    ) -> tuple[list[Experiment], Odds]:
        """Return the shortest sum of experiments that suffices, or the one that is surest."""
        rate = self.simulator.bench.rate
        best: tuple[tuple[float, float], list[Experiment], Odds] | None = None
        several = sums_of(drawn, _COMBINED)
        for number, items in enumerate(several):
            self.simulator.progress("shortest", number / len(several))
            *first, last = items
            gone = sum(item.ticks[-1] / rate for item in first)
            if gone >= self.budget or (best is not None and best[0][0] == 0.0 < gone >= best[0][1]):
                continue
            grams = one_after_the_other(items)
            after = zip(odds(layout, grams), is_spread(layout, grams), strict=True)
            own = list(after)[len(grams) - len(last.ticks) :]
            for block, (tick, (found, spread)) in enumerate(zip(last.ticks, own, strict=True)):
                seconds = gone + tick / rate
                if seconds > self.budget + 0.5 / rate:
                    break
                if seconds < SHORTEST and tick < last.ticks[-1]:
                    continue
                short = self._short_of(found, spread=bool(spread))
                if best is None or (short, seconds) < best[0]:
                    cut = [*(item.experiment for item in first), last.cut_after(block, rate)]
                    best = (short, seconds), cut, found
        assert best is not None
        return best[1], best[2]

    def _gentlest(self, chosen: Experiment, layout: DrawRows, expected: Odds) -> Experiment:
        """Return an experiment at a size within what was recorded, or nearer to it if that decides.

        Rivals were fitted to what has been recorded; the further beyond, the less they are worth.
        Smaller than that is no better: what a machine does in tiny motions was not recorded either.
        """
        here = self.simulator.respond(chosen, layout)
        was_spread = bool(is_spread(layout, self._products(chosen, here, layout))[-1])
        while chosen.size > _SMALLEST and self.simulator.goes_beyond(chosen, here):
            self.simulator.progress("gentler", 0.0)
            item = chosen.at_size(_GENTLER * chosen.size)
            responses = self.simulator.respond(item, layout)
            if not responses.safe:
                break
            grams = self._products(item, responses, layout)
            (found,) = odds(layout, grams[-1:])
            if found.right < min(expected.right, self.probability) or found.wrong > max(
                expected.wrong, MOST_WRONG
            ):
                break
            if was_spread and not is_spread(layout, grams)[-1]:
                break
            chosen, here = item, responses
        return chosen

    def _products(self, item: Experiment, responses: Responses, layout: DrawRows) -> FloatArray:
        """Return inner products up to the end of each block."""
        return self.simulator.products(responses, layout, self.simulator.ticks(item), 50)

    def _lengthen_until_confirmed(self, chosen: list[Experiment]) -> list[Experiment]:
        """Return an experiment made longer until draws that did not choose it confirm its worth.

        The shortest of many that seem to suffice is one that few draws flatter.
        """
        best: tuple[float, list[Experiment]] | None = None
        no_better = 0
        for number in range(_LONGER):
            self.simulator.progress("confirm", number / _LONGER)
            layout = self.simulator.draws(FRESH, 4, number)
            parts = [
                self.simulator.with_draws(item, layout, 70 + k) for k, item in enumerate(chosen)
            ]
            drawn = [item for item in parts if item is not None]
            if len(drawn) < len(parts):
                break
            (found,) = odds(layout, one_after_the_other(drawn)[-1:])
            if best is None or found.worth >= best[0] + _BETTER:
                best, no_better = (found.worth, [item.experiment for item in drawn]), 0
            else:
                no_better += 1
            if self._suffices(found) or no_better == _NO_BETTER:
                break
            further = longer([item.experiment for item in drawn], self.budget)
            if further is None:
                break
            chosen = further
        return chosen if best is None else best[1]
