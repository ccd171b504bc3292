"""Searches for the cheapest permitted experiment that separates what a diagnosis leaves open.

Every kind of signal in every permitted setup is brought to the largest size that keeps the limits,
simulated at the rivals' fitted values and along their posteriors' axes, and ranked by the time at
which the distance of the nearest two rivals suffices for a decision (`decision.distances`). The
best are varied. Then draws decide (`decision.odds`): the shortest experiment, or sum of two or
three, that names the right rival with the wanted probability. It is simulated again with fresh
draws for what is stated of it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.channels import CHANNELS
from eha_bench.core.errors import InputError, Place
from eha_bench.core.interruption import checkpoint
from eha_bench.core.per_cent import per_cent
from eha_bench.core.progress import ProgressHook
from eha_bench.diagnosis.outcome.rival import Standing
from eha_bench.experiment.candidates import (
    Experiment,
    ExperimentSettings,
    candidates,
    neighbour_of,
    unit_of_level,
)
from eha_bench.experiment.decision import (
    BLOCK,
    DISTINGUISHED,
    DrawRows,
    Odds,
    inner_products,
    layout_of,
    odds,
    posterior_after,
    shares_of_a_decision,
)
from eha_bench.experiment.describe import planned_trial, sentence_of
from eha_bench.experiment.hypothesis import Hypothesis, Question, read_question, rivals_to_separate
from eha_bench.experiment.permitted import (
    PLANT,
    RECORDINGS,
    Limit,
    Permitted,
    SetUp,
    mode_of,
    permitted_ranges,
)
from eha_bench.experiment.proposal import PlannedTrial, Proposal, ProposalEnding, Width
from eha_bench.experiment.response import Bench, Responses, largest, respond
from eha_bench.experiment.sensors import advice

MOST_WRONG = 0.02
"""Probability of naming a wrong rival that an experiment may have."""
ASKED = 0.95
WITHIN = 0.1
"""Half of a 95 % interval, as a share of the parameter, that is asked for by default."""
_LONGEST = 4.0
"""Length at which experiments are compared, s; longer ones are made of several."""
_SHORTEST = 1.0
"""Least length of a proposal, s: fewer than ten blocks bear out nothing where they are resampled."""
_GENTLER = 0.6
"""Share by which the experiment is made smaller, again and again, while it still decides."""
_SMALLEST = 0.01
_BEST = 5
_VARIATIONS = 5
_TOGETHER = 3
"""Most trials of a proposal."""
_DRAWS, _FRESH = 12, 24
_LONGER = 6
"""Most times that an experiment is made longer."""
_BETTER = 0.02
"""Rise of the probability that is worth more bench time."""
_NO_BETTER = 2
"""Times that more bench time brings nothing until it is believed: draws are few."""
_WORTH = 0.5
"""Least probability of naming the right rival that is worth bench time."""


def no_progress(_stage: str, _fraction: float) -> None:
    """Say nothing."""


@dataclass(frozen=True)
class _Tried:
    """An experiment with the inner products of its simulation, up to the end of each block."""

    candidate: Experiment
    ticks: tuple[int, ...]
    grams: FloatArray

    def cut_after(self, part: int, rate: float) -> Experiment:
        return self.candidate.lasting(self.ticks[part] / rate)


def propose(
    diagnosis: str | Path,
    *,
    budget: float = 30.0,
    safety: str | Path | None = None,
    probability: float = ASKED,
    within: float = WITHIN,
    seed: int = 0,
    progress: ProgressHook = no_progress,
) -> Proposal:
    """Return the cheapest permitted experiment that separates what a diagnosis leaves open.

    Args:
        diagnosis: diagnosis.json, or its folder. budget: bench time allowed, s.
        safety: target.yaml or suite that says what is safe; None: what has been recorded.
        probability: of naming the right rival that is asked for.
        within: half of a 95 % interval, as a share of the parameter, that is asked for where
            parameters are what is open.
        seed: of all draws. progress: called with the stage and the fraction of it done.

    Raises:
        InputError: a file is wrong, or the model has no command.
    """
    began = time.perf_counter()
    question = read_question(diagnosis)
    found = _ExperimentSearch(question, budget, safety, probability, within, seed, progress).run()
    return replace(found, seconds=time.perf_counter() - began, source=question.source)


class _ExperimentSearch:
    """One search; what it needs at every step."""

    def __init__(
        self,
        question: Question,
        budget: float,
        safety: str | Path | None,
        probability: float,
        within: float,
        seed: int,
        progress: ProgressHook,
    ) -> None:
        self.question, self.budget, self.progress = question, budget, progress
        self.probability, self.within, self.seed = probability, within, seed
        self.rivals = rivals_to_separate(question.rivals)
        self.causes = tuple(dict.fromkeys(rival.cause for rival in self.rivals))
        plant = self.rivals[0].model.plant
        if not plant.command:
            raise InputError(
                f"{plant.id} has no command that an experiment could give",
                where=Place(file=str(question.source)),
                hint="rank recordings that exist already with --from",
            )
        self.plant = plant
        self.bench = Bench.of(question.covered, plant.outputs, plant.command)
        self.permitted: Permitted = permitted_ranges(
            plant, [rival.vector for rival in self.rivals], question.covered, safety
        )
        self.plan = ExperimentSettings(
            mode_of(plant),
            unit_of_level(plant.command),
            {key: item for key, item in self.permitted.command.items() if item.high > item.low},
            self.bench.rate,
            {key: self._safety(key) for key in self.permitted.limits},
        )
        self.layout = layout_of(self.rivals, 0)
        self.tried = 0
        self.refused = 0

    def run(self) -> Proposal:
        """Search, and say how it ended."""
        if self._nothing_open():
            return self._ending(ProposalEnding.NOTHING_OPEN, self._why_nothing_open())
        if not self.plan.command:
            return self._ending(
                ProposalEnding.NONE_PERMITTED,
                f"{self.permitted.words}, and they leave the command no room: "
                "give a --safety file that permits more",
            )
        screened = self._best_experiments()
        if not screened:
            return self._ending(
                ProposalEnding.NONE_PERMITTED,
                f"none of {self.tried} experiments keeps every limit with margin "
                f"({self.permitted.words})",
            )
        if len(self.causes) > 1:
            return self._separating(screened)
        return self._narrowing(screened)

    # --- what is open ----------------------------------------------------------------------

    def _nothing_open(self) -> bool:
        return len(self.causes) < 2 and (
            self.question.unlocated or self._worst(self.rivals[0].covariance) <= self.within
        )

    def _why_nothing_open(self) -> str:
        if self.question.unlocated:
            return (
                "the unknown effect was not located, so no rival can be simulated: log more "
                "channels, and run `eha-bench diagnose` again"
            )
        if not self.question.complete:
            return "the diagnosis was interrupted: run `eha-bench diagnose` again"
        rival = self.rivals[0]
        left = "no effect is missing"
        if rival.cause != "none":
            left = f"no rival of '{rival.cause}' is left"
        return (
            f"nothing is open: {left}, and every parameter is known within {per_cent(self.within)}"
        )

    def _worst(self, covariance: FloatArray) -> float:
        return worst_width(self.rivals[0], covariance)

    # --- simulation --------------------------------------------------------------------------

    def _respond(self, candidate: Experiment, layout: DrawRows) -> Responses:
        checkpoint()
        trial = self.plan.trials([candidate], ["t"])[0]
        limits = self.permitted.limits[candidate.setup]
        return respond(self.rivals, layout.points, trial, self.bench, limits)

    def _products(self, tried: Responses, layout: DrawRows, ticks: Sequence[int], seed: int
                  ) -> FloatArray:  # fmt: skip
        outputs = self.plant.outputs
        return inner_products(layout, tried.outputs, outputs, self.bench, ticks, [self.seed, seed])

    def _largest(self, candidate: Experiment) -> Experiment | None:
        """Return it at the largest size that keeps the limits at the rivals' fitted values."""
        nominal = [np.zeros((1, len(rival.keys))) for rival in self.rivals]
        limits = self.permitted.limits[candidate.setup]
        return largest(self.rivals, nominal, candidate, self.plan, self.bench, limits)

    def _try(self, candidate: Experiment) -> _Tried | None:
        """Simulate at the fitted values and along the posterior's axes; None if that is unsafe."""
        self.tried += 1
        item = self._largest(candidate)
        if item is None:
            self.refused += 1
            return None
        responses = self._respond(item, self.layout)
        for _ in range(2):
            if responses.safe:
                break
            item = item.at_size(0.7 * item.size)
            responses = self._respond(item, self.layout)
        if not responses.safe:
            self.refused += 1
            return None
        ticks = self._ticks(item)
        return _Tried(item, ticks, self._products(responses, self.layout, ticks, 0))

    def _ticks(self, item: Experiment) -> tuple[int, ...]:
        """Return the tick at the end of each block."""
        count = round(item.seconds * self.bench.rate)
        block = max(2, round(BLOCK * self.bench.rate))
        return (*range(block, count, block), count)

    # --- search ------------------------------------------------------------------------------

    def _best_experiments(self) -> list[_Tried]:
        """Return the best experiments, after variation, the cheapest first."""
        every = list(candidates(self.plan, min(self.budget, _LONGEST)))
        found = []
        for number, item in enumerate(every):
            self.progress("candidates", number / len(every))
            if (tried := self._try(item)) is not None:
                found.append(tried)
        found.sort(key=self._price)
        rng = np.random.default_rng([self.seed, 1])
        best = self._unlike(found)
        out = list(found)
        for number, start in enumerate(best[:3]):
            here = start
            for step in range(_VARIATIONS):
                self.progress("vary", (number + step / _VARIATIONS) / 3.0)
                other = self._try(neighbour_of(here.candidate, rng, self.plan))
                if other is not None:
                    out.append(other)
                    if self._price(other) < self._price(here):
                        here = other
        out.sort(key=self._price)
        return self._unlike(out)

    def _unlike(self, found: Sequence[_Tried]) -> list[_Tried]:
        """Return the best few, of which no three are of one kind in one setup."""
        kept: list[_Tried] = []
        for item in found:
            alike = [k for k in kept if (k.candidate.kind, k.candidate.setup)
                     == (item.candidate.kind, item.candidate.setup)]  # fmt: skip
            if len(alike) < 2:
                kept.append(item)
            if len(kept) == _BEST:
                break
        return kept

    def _price(self, item: _Tried) -> float:
        """Return the bench time after which an experiment would decide, s."""
        reached = self._shares_reached(item.grams)
        enough = np.flatnonzero(reached >= 1.0)
        if enough.size:
            return item.ticks[int(enough[0])] / self.bench.rate
        return item.candidate.seconds / max(float(reached[-1]), 1e-9)

    def _shares_reached(self, grams: FloatArray) -> FloatArray:
        """Return what is reached by the end of each block, as a share of what is needed."""
        if len(self.causes) > 1:
            return shares_of_a_decision(self.layout, grams)
        worst = [self._worst(posterior_after(self.rivals[0], self.layout, gram, 0))
                 for gram in grams]  # fmt: skip
        return (self.within / np.maximum(worst, 1e-12)) ** 2

    # --- rivals ------------------------------------------------------------------------------

    def _separating(self, screened: list[_Tried]) -> Proposal:
        """Return the shortest experiment that names the right rival."""
        layout = layout_of(self.rivals, _DRAWS, np.random.default_rng([self.seed, 2]))
        drawn: list[_Tried] = []
        for number, item in enumerate(screened):
            self.progress("draws", number / len(screened))
            if (again := self._simulate_draws(item.candidate, layout, number)) is not None:
                drawn.append(again)
        if not drawn:
            return self._ending(
                ProposalEnding.NONE_PERMITTED,
                f"over the rivals' posteriors none of {self.tried} experiments keeps every limit "
                f"with margin ({self.permitted.words})",
            )
        chosen, expected = self._shortest(drawn, layout)
        if expected.right < _WORTH or expected.wrong > 2.0 * MOST_WRONG:
            sensor = advice(self.rivals, layout, drawn[0].candidate, self.plan, self.bench,
                            self.permitted.limits)  # fmt: skip
            why = (
                f"no permitted experiment within {self.budget:g} s separates "
                f"{' and '.join(self.causes)}: the best of {self.tried} "
                f"experiments would name the right one in {per_cent(expected.right)} of cases"
            )
            if sensor is not None:
                why += f"; log {sensor.channel} as well and it would in {per_cent(sensor.right)}"
            return replace(
                self._ending(ProposalEnding.NONE_PERMITTED, why), odds=expected, sensor=sensor
            )
        if len(chosen) == 1:
            chosen = [self._gentlest(chosen[0], layout, expected)]
        return self._proposal_of(self._lengthen_until_confirmed(chosen))

    def _suffices(self, found: Odds) -> bool:
        """Whether the right rival is named as surely as asked for."""
        return found.right >= self.probability and found.wrong <= MOST_WRONG

    def _lengthen_until_confirmed(self, chosen: list[Experiment]) -> list[Experiment]:
        """Return an experiment made longer until draws that did not choose it confirm its worth.

        The shortest of many that seem to suffice is one that few draws flatter.
        """
        best: tuple[float, list[Experiment]] | None = None
        no_better = 0
        for number in range(_LONGER):
            self.progress("confirm", number / _LONGER)
            layout = layout_of(self.rivals, _FRESH, np.random.default_rng([self.seed, 4, number]))
            parts = [self._simulate_draws(item, layout, 60 + k) for k, item in enumerate(chosen)]
            drawn = [item for item in parts if item is not None]
            if len(drawn) < len(parts):
                break
            found = odds(layout, _one_after_the_other(drawn)[-1:])[0]
            if best is None or found.worth >= best[0] + _BETTER:
                best, no_better = (found.worth, [item.candidate for item in drawn]), 0
            else:
                no_better += 1
            if self._suffices(found) or no_better == _NO_BETTER:
                break
            longer = self._longer([item.candidate for item in drawn])
            if longer is None:
                break
            chosen = longer
        return chosen if best is None else best[1]

    def _longer(self, chosen: list[Experiment]) -> list[Experiment] | None:
        """Return an experiment that takes half as long again, or once more; None beyond the budget.

        It is none of more than `_TOGETHER` trials.
        """
        *first, last = chosen
        gone = sum(item.seconds for item in first)
        most = min(_LONGEST, self.budget - gone)
        if last.seconds < 0.95 * most:
            return [*first, last.lasting(min(1.6 * last.seconds, most))]
        if len(chosen) < _TOGETHER and gone + 2.0 * last.seconds <= self.budget:
            return [*chosen, last]
        return None

    def _gentlest(self, chosen: Experiment, layout: DrawRows, expected: Odds) -> Experiment:
        """Return an experiment at the smallest size that decides as surely in the same time.

        Rivals were fitted to what has been recorded; the further beyond, the less they are worth.
        """
        while chosen.size > _SMALLEST:
            self.progress("gentler", 0.0)
            item = chosen.at_size(_GENTLER * chosen.size)
            responses = self._respond(item, layout)
            if not responses.safe:
                break
            grams = self._products(responses, layout, self._ticks(item)[-1:], 50)
            found = odds(layout, grams[-1:])[0]
            if found.right < min(expected.right, self.probability) or found.wrong > max(
                expected.wrong, MOST_WRONG
            ):
                break
            chosen = item
        return chosen

    def _simulate_draws(
        self, candidate: Experiment, layout: DrawRows, number: int
    ) -> _Tried | None:
        """Simulate with draws of the posteriors, smaller where one of them breaks a limit."""
        for _ in range(4):
            responses = self._respond(candidate, layout)
            if responses.safe:
                ticks = self._ticks(candidate)
                grams = self._products(responses, layout, ticks, 10 + number)
                return _Tried(candidate, ticks, grams)
            candidate = candidate.at_size(0.75 * candidate.size)
        return None

    def _shortest(self, drawn: list[_Tried], layout: DrawRows) -> tuple[list[Experiment], Odds]:
        """Return the shortest sum of experiments that suffices, or the one that is surest."""
        rate = self.bench.rate
        best: tuple[tuple[float, float], list[Experiment], Odds] | None = None
        several = [
            items
            for count in range(1, _TOGETHER + 1)
            for items in combinations_with_replacement(drawn[:3] if count > 1 else drawn, count)
        ]
        for number, items in enumerate(several):
            self.progress("shortest", number / len(several))
            *first, last = items
            gone = sum(item.ticks[-1] / rate for item in first)
            if gone >= self.budget or (best is not None and best[0][0] == 0.0 < gone >= best[0][1]):
                continue
            after = odds(layout, _one_after_the_other(items))
            own = after[len(after) - len(last.ticks) :]
            for part, (tick, found) in enumerate(zip(last.ticks, own, strict=True)):
                seconds = gone + tick / rate
                if seconds > self.budget + 0.5 / rate:
                    break
                if seconds < _SHORTEST and tick < last.ticks[-1]:
                    continue
                short = 0.0 if self._suffices(found) else 1.0 - found.worth
                if best is None or (short, seconds) < best[0]:
                    cut = [*(item.candidate for item in first), last.cut_after(part, rate)]
                    best = (short, seconds), cut, found
        assert best is not None
        return best[1], best[2]

    def _proposal_of(self, chosen: list[Experiment]) -> Proposal:
        """Return a proposal with what fresh draws say of it."""
        self.progress("predict", 0.0)
        layout = layout_of(self.rivals, _FRESH, np.random.default_rng([self.seed, 3]))
        done: list[_Tried] = []
        trials: list[PlannedTrial] = []
        kept: list[Experiment] = []
        for number, item in enumerate(chosen):
            candidate = item
            responses = self._respond(candidate, layout)
            for _ in range(4):
                if responses.safe:
                    break
                candidate = candidate.at_size(0.85 * candidate.size)
                responses = self._respond(candidate, layout)
            if not responses.safe:
                continue
            ticks = self._ticks(candidate)
            grams = self._products(responses, layout, ticks, 100 + number)
            done.append(_Tried(candidate, ticks, grams))
            kept.append(candidate)
            trials.append(
                planned_trial(
                    f"part_{len(kept)}", candidate, self.plan, self.rivals, layout, responses,
                    self.bench, ticks, grams,
                )
            )  # fmt: skip
        if not done:
            return self._ending(
                ProposalEnding.NONE_PERMITTED,
                "over fresh draws of the rivals' posteriors no experiment keeps every limit",
            )
        names = [trial.id for trial in trials]
        grams = _one_after_the_other(done)
        widths = self._widths(layout, grams[-1])
        found = None
        if len(self.causes) > 1:
            found = odds(layout, grams[-1:])[0]
        proposal = Proposal(
            ProposalEnding.PROPOSED,
            "",
            self.causes,
            self.probability if found is not None else self.within,
            self.budget,
            self.permitted.words,
            odds=found,
            widths=widths,
            trials=tuple(trials),
            suite=self.plan.suite(kept, names),
            notes=tuple(self._notes()),
            tried=self.tried,
        )
        return replace(proposal, sentence=sentence_of(proposal))

    def _notes(self) -> list[str]:
        refused = self.refused or "none"
        verb = "breaks" if self.refused <= 1 else "break"
        notes = [f"{self.tried} experiments were simulated; {refused} {verb} a limit at any size"]
        left = dict.fromkeys(
            item.cause for item in self.question.rivals if item.cause not in self.causes
        )
        if left:
            notes.append(
                f"{', '.join(left)} may fit as well, but the experiment does not consider them"
            )
        if any(item.standing is not Standing.FOUND and item.behind > DISTINGUISHED
               for item in self.rivals):  # fmt: skip
            notes.append(
                "some rivals fit worse by more than noise, but resampling does not confirm it"
            )
        return notes

    # --- parameters ----------------------------------------------------------------------------

    def _narrowing(self, screened: list[_Tried]) -> Proposal:
        """Return the shortest experiment that brings the worst interval under what is asked."""
        best: tuple[tuple[float, float], list[Experiment]] | None = None
        rate = self.bench.rate
        several = [
            items
            for count in range(1, _TOGETHER + 1)
            for items in combinations_with_replacement(screened[:4] if count > 1 else screened,
                                                       count)
        ]  # fmt: skip
        for items in several:
            *first, last = items
            gone = sum(item.ticks[-1] / rate for item in first)
            grams = _one_after_the_other(items)
            for part, gram in enumerate(grams[len(grams) - len(last.ticks) :]):
                seconds = gone + last.ticks[part] / rate
                if seconds > self.budget + 0.5 / rate:
                    break
                worst = self._worst(posterior_after(self.rivals[0], self.layout, gram, 0))
                order = (max(worst - self.within, 0.0), seconds)
                if best is None or order < best[0]:
                    cut = [*(item.candidate for item in first), last.cut_after(part, rate)]
                    best = order, cut
        assert best is not None
        before = self._worst(self.rivals[0].covariance)
        if best[0][0] + self.within > 0.9 * before:
            widths = self.rivals[0].relative_half_widths(self.rivals[0].covariance)
            name = max(counted_parameters(widths), key=lambda key: widths[key])
            return self._ending(
                ProposalEnding.NONE_PERMITTED,
                f"no permitted experiment of {self.budget:g} s narrows the interval of {name} "
                f"below its present {per_cent(before)}",
            )
        return self._proposal_of(best[1])

    def _widths(self, layout: DrawRows, gram: FloatArray) -> tuple[Width, ...]:
        rival = self.rivals[0]
        before = rival.relative_half_widths(rival.covariance)
        after = rival.relative_half_widths(posterior_after(rival, layout, gram, 0))
        found = [
            Width(key, before[key], after.get(key, math.nan)) for key in counted_parameters(before)
        ]
        return tuple(sorted(found, key=lambda item: -item.before))

    # --- words ---------------------------------------------------------------------------------

    def _safety(self, setup: SetUp) -> dict[str, Any]:
        """Return limits as a suite writes them: of what the rig measures.

        Where only recordings say how far a channel may go, its noise has to be known: one reading
        beyond them ends a run.
        """
        measured = {*self.plant.outputs, *self.plant.derived_channels, "pressure_difference"}
        found: dict[str, Any] = {}
        for name, limit in self.permitted.limits[setup].items():
            stated = limit.reason not in (PLANT, RECORDINGS) or (
                limit.reason == RECORDINGS and self.question.covered.noise.get(name, 0.0) > 0.0
            )
            if name in measured and stated and (text := _limit_text(limit)):
                unit = {"unit": self.plant.units.get(name, "")}
                found[name] = text if name in CHANNELS else {"limit": text, **unit}
        return found

    def _ending(self, ending: ProposalEnding, sentence: str) -> Proposal:
        return Proposal(
            ending,
            sentence,
            self.causes,
            self.probability if len(self.causes) > 1 else self.within,
            self.budget,
            self.permitted.words,
            tried=self.tried,
        )


def counted_parameters(widths: Iterable[str]) -> list[str]:
    """Return parameters whose interval counts: no curve's knots, no friction at rest."""
    return [key for key in widths if "[" not in key and not key.endswith("creep_speed")]


def worst_width(rival: Hypothesis, covariance: FloatArray) -> float:
    """Return half of the widest 95 % interval, as a share of its parameter."""
    own = rival.relative_half_widths(covariance)
    return max((own[name] for name in counted_parameters(own)), default=0.0)


def _one_after_the_other(items: Sequence[_Tried]) -> FloatArray:
    """Return the inner products of several experiments, up to the end of each of their blocks."""
    parts: list[FloatArray] = []
    for item in items:
        parts.append(item.grams + (parts[-1][-1] if parts else 0.0))
    return np.concatenate(parts)


def _limit_text(limit: Limit) -> str:
    low, high = math.isfinite(limit.low), math.isfinite(limit.high)
    if low and high:
        return f"{limit.low:.6g} .. {limit.high:.6g}"
    if low:
        return f">= {limit.low:.6g}"
    return f"<= {limit.high:.6g}" if high else ""
