"""Searches for the cheapest permitted experiment that separates what a diagnosis leaves open.

Experiments are screened (`screening`): each at the largest size that keeps the limits, ranked by
the bench time after which it would decide. Then draws from the rivals' posteriors decide: the
shortest experiment, or sum of two or three, that names the right rival with the wanted probability
(`separating`); where one rival is left, the one that brings the widest interval of a parameter
under what is asked (`narrowing`). It is simulated again with fresh draws for what is stated of it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.channels import CHANNELS, unit_of
from eha_bench.core.errors import InputError
from eha_bench.core.per_cent import per_cent
from eha_bench.core.progress import ProgressHook
from eha_bench.diagnosis.outcome.rival import NO_EFFECT, Standing
from eha_bench.experiment.candidates import Experiment, ExperimentSettings
from eha_bench.experiment.commanded import Commanded
from eha_bench.experiment.decision import (
    DISTINGUISHED,
    DrawRows,
    odds,
    posterior_after,
    shares_of_a_decision,
)
from eha_bench.experiment.describe import (
    broken_limit,
    causes_in_words,
    planned_trial,
    sentence_of,
    width_words,
)
from eha_bench.experiment.hypothesis import Question, rivals_to_separate
from eha_bench.experiment.lengthening import SHORTEST
from eha_bench.experiment.narrowing import (
    counted_parameters,
    narrowest,
    widths_after,
    worst_width,
)
from eha_bench.experiment.permitted import (
    PLANT,
    RECORDINGS,
    SIGMAS,
    Limit,
    Permitted,
    SetUp,
    measured_of,
    permitted_ranges,
)
from eha_bench.experiment.proposal import PlannedTrial, Proposal, ProposalEnding, Width
from eha_bench.experiment.response import Bench
from eha_bench.experiment.rival_simulator import (
    RivalSimulator,
    SimulatedExperiment,
    one_after_the_other,
)
from eha_bench.experiment.screening import best_experiments
from eha_bench.experiment.sensors import advice
from eha_bench.experiment.separating import (
    FRESH,
    Separating,
    Separation,
    is_worth_bench_time,
)

ASKED = 0.95
WITHIN = 0.1
"""Half of a 95 % interval, as a share of the parameter, that is asked for by default."""
_STARTS = 0.02
"""Share of a recorded way by which recordings may begin away from 0 that is taken for 0."""
_NARROWER = 0.9
"""Share of the present interval that an experiment has to bring it under to be worth its time."""


def no_progress(_stage: str, _fraction: float) -> None:
    """Say nothing."""


def propose(
    question: Question,
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
        question: what a diagnosis leaves open. budget: bench time allowed, s.
        safety: target.yaml or suite that says what is safe; None: what has been recorded.
        probability: of naming the right rival that is asked for.
        within: half of a 95 % interval, as a share of the parameter, that is asked for where
            parameters are what is open.
        seed: of all draws. progress: called with the stage and the fraction of it done.

    Raises:
        InputError: a file is wrong, nothing of the model can be commanded, or the budget
            allows none.
    """
    began = time.perf_counter()
    if budget < SHORTEST:
        raise InputError(
            f"{budget:g} s of bench time are too few",
            hint=f"an experiment takes {SHORTEST:g} s at least: give it as --budget",
        )
    found = _Planner(question, budget, safety, probability, within, seed, progress).run()
    return replace(found, seconds=time.perf_counter() - began, source=question.source)


class _Planner:
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
        self.question, self.budget = question, budget
        self.probability, self.within = probability, within
        self.rivals = rivals_to_separate(question.rivals)
        self.causes = tuple(dict.fromkeys(rival.cause for rival in self.rivals))
        self.plant = plant = self.rivals[0].model.plant
        commanded = Commanded.of(question)
        bench = Bench.of(question.covered, plant, commanded.channel)
        self.permitted: Permitted = permitted_ranges(
            plant, commanded, [rival.vector for rival in self.rivals], question.covered, safety
        )
        self.plan = ExperimentSettings(
            commanded,
            {key: item for key, item in self.permitted.command.items() if item.high > item.low},
            bench.rate,
            {key: self._safety(key) for key in self.permitted.limits},
            {
                key: places
                for key in self.permitted.limits
                if (places := self._initial(key, commanded))
            },
        )
        self.simulator = RivalSimulator(
            self.rivals, question.covered, bench, self.permitted, self.plan, seed, progress
        )

    def run(self) -> Proposal:
        """Search, and say how it ended."""
        if len(self.causes) < 2:
            if why := self._why_nothing_can_be_planned():
                return self._none_permitted(why)
            if self._worst(self.rivals[0].covariance) <= self.within:
                return self._ending(ProposalEnding.NOTHING_OPEN, self._why_nothing_open())
        if not self.plan.command:
            return self._none_permitted(
                f"{self.permitted.words}, and they leave the command no room: "
                "give a --safety file that permits more",
            )
        screened = best_experiments(self.simulator, self.budget, self._shares_reached)
        if not screened:
            return self._none_permitted(
                f"none of {self.simulator.tried} experiments keeps every limit with margin "
                f"({self.permitted.words}){self._what_is_broken()}",
            )
        if len(self.causes) > 1:
            return self._separating(screened)
        return self._narrowing(screened)

    def _what_is_broken(self) -> str:
        """Say which limit stands in the way of most experiments, and by how much."""
        tightest = self.simulator.tightest_limit()
        if tightest is None:
            return ""
        room, count = tightest
        unit = self.plant.units.get(room.channel)
        if unit is None and room.channel in CHANNELS:
            unit = unit_of(room.channel)
        return f": {broken_limit(room, count, unit or '')}"

    def _shares_reached(self, grams: FloatArray) -> FloatArray:
        """Return what is reached by the end of each block, as a share of what is needed."""
        layout = self.simulator.layout
        if len(self.causes) > 1:
            return shares_of_a_decision(layout, grams)
        worst = [self._worst(posterior_after(self.rivals[0], layout, gram, 0)) for gram in grams]
        return (self.within / np.maximum(worst, 1e-12)) ** 2

    def _separating(self, screened: Sequence[SimulatedExperiment]) -> Proposal:
        """Return the shortest experiment that names the right rival."""
        search = Separating(self.simulator, self.budget, self.probability)
        found = search.best(screened)
        if found is None:
            return self._none_permitted(
                f"none of {self.simulator.tried} experiments is sure to keep every limit with "
                f"margin ({self.permitted.words}): the recordings leave too much open"
                f"{self._most_of_all()}"
            )
        if not is_worth_bench_time(found.odds):
            return self._none_separates(found)
        proposal = self._proposal_of(search.confirmed(found))
        if proposal.odds is not None and not is_worth_bench_time(proposal.odds):
            # draws that chose it flattered it
            return self._none_separates(replace(found, odds=proposal.odds))
        return proposal

    def _none_separates(self, found: Separation) -> Proposal:
        """Say how far the best experiment comes, and which sensor would help."""
        sensor = advice(self.rivals, found.layout, found.surest, self.plan, self.simulator.bench,
                        self.permitted.limits)  # fmt: skip
        causes = " and ".join(causes_in_words(self.rivals).values())
        why = (
            f"no permitted experiment within {self.budget:g} s separates {causes}: "
            f"the best of {self.simulator.tried} experiments would name the right one in "
            f"{per_cent(found.odds.right)} of cases and a wrong one in "
            f"{per_cent(found.odds.wrong, 1)}"
        )
        if sensor is not None:
            why += f"; log {sensor.channel} as well and it would in {per_cent(sensor.right)}"
        return replace(self._none_permitted(why), odds=found.odds, sensor=sensor)

    def _narrowing(self, screened: Sequence[SimulatedExperiment]) -> Proposal:
        """Return the shortest experiment that brings the worst interval under what is asked."""
        found = narrowest(self.simulator, screened, self.budget, self.within)
        before = self._worst(self.rivals[0].covariance)
        if found.worst > _NARROWER * before and found.worst > self.within:
            return self._none_permitted(
                f"no permitted experiment of {self.budget:g} s narrows by much what the recordings "
                f"leave open{self._most_of_all()}"
            )
        return self._proposal_of(found.experiments)

    # --- what is open ----------------------------------------------------------------------

    def _why_nothing_can_be_planned(self) -> str:
        """Say what is open that no experiment of one rival would tell; "" where nothing is."""
        question = self.question
        if question.not_simulated:
            return f"{question.not_simulated}, and run `eha-bench diagnose` again"
        if question.no_interval:
            # parameters are not narrowed while their model leaves too much unexplained
            return (
                "the diagnosis gives no interval that could be narrowed, because "
                f"{question.no_interval}: log more channels, or declare what the plant lacks, and "
                "run `eha-bench diagnose` again"
            )
        if question.unnamed and question.complete:
            # better known parameters tell nothing of it
            return (
                f"what is missing has no name yet, and no rival that an experiment could tell from "
                f"it: {question.unnamed}; declare what the plant lacks there, or log more "
                "channels, and run `eha-bench diagnose` again"
            )
        known = self._worst(self.rivals[0].covariance) <= self.within
        if known and not question.complete:
            return "the diagnosis was interrupted: run `eha-bench diagnose` again"
        return ""

    def _why_nothing_open(self) -> str:
        rival = self.rivals[0]
        left = "no missing effect was found"
        if rival.cause != NO_EFFECT:
            left = f"no rival of '{rival.cause}' is left"
        return (
            f"nothing is open: {left}, and every parameter is known within {per_cent(self.within)}"
            f"{self._not_judged()}{self._warned_of()}"
        )

    def _not_judged(self) -> str:
        """Name the parameters whose interval is a share of nothing, as a clause."""
        left = counted_parameters(self.rivals[0].unjudged)
        return f", but for {', '.join(left)}, which may as well be 0" if left else ""

    def _warned_of(self) -> str:
        """Say what the diagnosis warned of: a parameter that moved far may hide what is missing."""
        cautions = self.question.cautions
        if not cautions:
            return ""
        return f"; check what the diagnosis warns of: {'; '.join(cautions)}"

    def _most_of_all(self) -> str:
        """Return the parameter that is known least, and how well, as a clause."""
        found = [
            (share, key, rival.judged_against[key])
            for rival in self.rivals
            for key, share in rival.relative_half_widths(rival.covariance).items()
            if counted_parameters([key])
        ]
        if not found:
            return ""
        share, key, of = max(found)
        return f", most of all {key}, which is known to {width_words(share, of)}"

    def _worst(self, covariance: FloatArray) -> float:
        return worst_width(self.rivals[0], covariance)

    # --- the proposal ------------------------------------------------------------------------

    def _proposal_of(self, chosen: Sequence[Experiment]) -> Proposal:
        """Return a proposal with what fresh draws say of it."""
        simulator = self.simulator
        simulator.progress("predict", 0.0)
        layout = simulator.draws(FRESH, 3)
        done: list[SimulatedExperiment] = []
        trials: list[PlannedTrial] = []
        for number, item in enumerate(chosen):
            if (safe := simulator.safe_responses(item, layout)) is None:
                continue
            experiment, responses = safe
            done.append(simulator.simulated(experiment, responses, layout, 100 + number))
            trials.append(
                planned_trial(
                    f"part_{len(done)}", experiment, self.plan, self.rivals, layout, responses
                )
            )
        if not done:
            return self._none_permitted(
                "no experiment is sure to keep every limit: the recordings leave too much open"
                f"{self._most_of_all()}"
            )
        last = one_after_the_other(done)[-1:]
        after = self._widths_after([item.experiment for item in done], layout, last[0])
        proposal = Proposal(
            ProposalEnding.PROPOSED,
            "",
            self.causes,
            self._asked,
            self.budget,
            self.permitted.words,
            odds=odds(layout, last)[0] if len(self.causes) > 1 else None,
            widths=self._widths(after),
            trials=tuple(trials),
            suite=self.plan.suite(
                [item.experiment for item in done], [trial.id for trial in trials]
            ),
            notes=tuple(self._notes()),
            tried=simulator.tried,
        )
        causes = causes_in_words(self.rivals)
        return replace(proposal, sentence=sentence_of(proposal, causes))

    @property
    def _asked(self) -> float:
        """What is asked for: a probability, or half of an interval where one cause is left."""
        return self.probability if len(self.causes) > 1 else self.within

    def _notes(self) -> list[str]:
        tried, refused = self.simulator.tried, len(self.simulator.refused) or "none"
        verb = "breaks" if len(self.simulator.refused) <= 1 else "break"
        notes = [f"{tried} experiments were simulated; {refused} {verb} a limit at any size"]
        if unwatched := self.permitted.unwatched:
            names = " and ".join(f"'{name}'" for name in unwatched)
            notes.append(
                f"CAUTION: {names}: the safety file limits what the model does not predict; the "
                "proposal does not keep that limit, nor does its suite watch it"
            )
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

    def _widths_after(
        self, experiments: Sequence[Experiment], layout: DrawRows, gram: FloatArray
    ) -> Mapping[str, float]:
        """Return half of each 95 % interval after experiments, relative.

        About draws where parameters are what is open; at the fitted values of the first rival where
        they are told as well.
        """
        if len(self.causes) == 1:
            return widths_after(self.simulator, experiments)
        rival = self.rivals[0]
        return rival.relative_half_widths(posterior_after(rival, layout, gram, 0))

    def _widths(self, after: Mapping[str, float]) -> tuple[Width, ...]:
        rival = self.rivals[0]
        before = rival.relative_half_widths(rival.covariance)
        found = [
            Width(key, before[key], after.get(key, math.nan), rival.judged_against[key])
            for key in counted_parameters(before)
        ]
        return tuple(sorted(found, key=lambda item: -item.before))

    def _initial(self, key: SetUp, commanded: Commanded) -> dict[str, float]:
        """Return where trials of a setup begin: where its recordings do, if that is not at 0.

        A rig that stands half a stroke out is half a stroke nearer to its limit, also in a setup
        that has not been recorded yet. What follows a position stands where it is asked to be.
        """
        covered = self.question.covered
        recorded = {item.setup: item for item in covered.setups}
        setup = recorded.get(key) or next(iter(recorded.values()), None)
        if setup is None or commanded.follows or commanded.is_imposed_position:
            return {}
        began = {**self.plant.behind(self.rivals[0].vector, setup.starts), **setup.starts}
        found = {}
        for name in self.plant.roles.rate_of:
            low, high = setup.extremes.get(name, (math.inf, -math.inf))
            little = max(_STARTS * max(high - low, 0.0), SIGMAS * covered.sensor_noise(name))
            if name in self.plant.states and abs(began.get(name, 0.0)) > little:
                found[name] = float(f"{began[name]:.4g}")
        return found

    def _safety(self, setup: SetUp) -> dict[str, Any]:
        """Return limits as a suite writes them: of what the rig measures.

        Where only recordings say how far a channel may go, its noise has to be known: one reading
        beyond them ends a run.
        """
        measured = measured_of(self.plant)
        found: dict[str, Any] = {}
        for name, limit in self.permitted.limits[setup].items():
            stated = limit.reason not in (PLANT, RECORDINGS) or (
                limit.reason == RECORDINGS and self.question.covered.sensor_noise(name) > 0.0
            )
            if name in measured and stated and (text := _limit_text(limit)):
                unit = {"unit": self.plant.units.get(name, "")}
                found[name] = text if name in CHANNELS else {"limit": text, **unit}
        return found

    def _none_permitted(self, sentence: str) -> Proposal:
        return self._ending(ProposalEnding.NONE_PERMITTED, sentence)

    def _ending(self, ending: ProposalEnding, sentence: str) -> Proposal:
        return Proposal(
            ending,
            sentence,
            self.causes,
            self._asked,
            self.budget,
            self.permitted.words,
            tried=self.simulator.tried,
        )


def _limit_text(limit: Limit) -> str:
    low, high = math.isfinite(limit.low), math.isfinite(limit.high)
    if low and high:
        return f"{limit.low:.6g} .. {limit.high:.6g}"
    if low:
        return f">= {limit.low:.6g}"
    return f"<= {limit.high:.6g}" if high else ""
