"""The way from a calibrated model to a verdict, stage by stage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from eha_bench.core.interruption import Interruption, checkpoints
from eha_bench.core.progress import ProgressHook
from eha_bench.core.workers import Workers
from eha_bench.diagnosis.data.dataset import Dataset
from eha_bench.diagnosis.fit.baseline import COARSE, Baseline
from eha_bench.diagnosis.fit.candidates import SheetNumber
from eha_bench.diagnosis.fit.side_by_side import fits_by
from eha_bench.diagnosis.fit.start_angles import starts_of
from eha_bench.diagnosis.fit.thresholds import Thresholds
from eha_bench.diagnosis.late_topics import with_clock_instead
from eha_bench.diagnosis.outcome.beyond_training import beyond_training, unchecked
from eha_bench.diagnosis.outcome.curve_instead import curve_instead
from eha_bench.diagnosis.outcome.decide import Decision, decide, in_held_out, without_curve
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis, Unknown, Verdict, failed_stage
from eha_bench.diagnosis.outcome.differing_runs import differing_parameters
from eha_bench.diagnosis.outcome.doubtful_numbers import doubtful_numbers
from eha_bench.diagnosis.outcome.findings import adds, assemble
from eha_bench.diagnosis.outcome.honest import (
    against_second,
    against_the_end,
    curve_is_worse,
    prune,
)
from eha_bench.diagnosis.outcome.led_commands import with_led_commands
from eha_bench.diagnosis.outcome.misplaced_columns import misplaced_column
from eha_bench.diagnosis.outcome.model_errors import (
    held_out_windows,
    spread_of_replays,
    with_replay_errors,
)
from eha_bench.diagnosis.outcome.only_a_mean import only_a_mean
from eha_bench.diagnosis.outcome.other_forms import other_forms
from eha_bench.diagnosis.outcome.own_noise import with_own_noise, with_slow_noise
from eha_bench.diagnosis.outcome.rare_stretches import note_of_rare_stretches
from eha_bench.diagnosis.outcome.refusal import Refusal
from eha_bench.diagnosis.outcome.remainder import remainder
from eha_bench.diagnosis.outcome.revise import revised_model
from eha_bench.diagnosis.outcome.rivals import other_rivals
from eha_bench.diagnosis.outcome.scaled_channel import with_scaled_channel
from eha_bench.diagnosis.outcome.scaled_sensor import ScaledSensor, scaled_sensor
from eha_bench.diagnosis.outcome.sizes_over_forms import with_sizes_over_forms
from eha_bench.diagnosis.outcome.worst_range import worst_range
from eha_bench.diagnosis.search import stepwise
from eha_bench.diagnosis.search.backward import drop, without
from eha_bench.diagnosis.search.exchange import take_equivalent
from eha_bench.diagnosis.search.left_out_runs import explains_all_runs, search_in_all_runs
from eha_bench.diagnosis.search.state import accept_nothing, begin
from eha_bench.diagnosis.unknown.locator import locate


class Conclusion:
    """A diagnosis from its calibrated model on, stage by stage.

    What has been found is on disk before the next stage begins, so none takes it away.

    Args:
        dataset: with the declared model. base: calibrated. out: folder, or None.
        progress: called with the stage and the fraction of it done.
        thresholds: of the verdict.
    """

    sensor: ScaledSensor | None = None
    """The sensor whose gain was found wrong, and that is read right since."""

    def __init__(
        self,
        dataset: Dataset,
        base: Baseline,
        out: str | Path | None,
        progress: ProgressHook,
        thresholds: Thresholds,
    ) -> None:
        self.dataset, self.base, self.out, self.progress = dataset, base, out, progress
        self.stage = "search"
        self.refused: list[Refusal] = []
        self.search = begin(base, thresholds)
        note = "no effect has stood its tests yet, so the verdict is open"
        self.decision = self._open(note)
        self.found = _calibration_alone(dataset, base, self.decision)

    def whole(self, asked: Interruption, workers: Workers) -> Diagnosis:
        """Search, decide, and score; or as far as that goes until a stop is asked for."""
        try:
            with checkpoints(asked), fits_by(workers):
                self._decide()
                if (given := with_led_commands(self.base, self.search)) is not None:
                    self.base, self.search = given, begin(given, self.search.thresholds)
                    self._decide()
                right = with_clock_instead(self.base, self.search, self._on_progress)
                if right is not None:
                    self._decide_read_right(right)
                self._read_at_scale()
                if (slow := with_slow_noise(self.base, self.search, self.decision)) is not None:
                    self.base, self.search = slow, begin(slow, self.search.thresholds)
                    self._decide()
                if self.decision.verdict is Verdict.NONE and self.base.left_out:
                    self._decide_with_all_runs()
        except KeyboardInterrupt:
            self.decision = self._decision_so_far()
            return self._if_it_stands(self._assemble(complete=False))
        found = self._what_stands(self._assemble(complete=True), asked, workers)
        limits = self.search.thresholds
        if found.complete and self.decision.learned and (why := curve_is_worse(found, limits)):
            found = self._without_the_curve(why)
        if found.complete and found.verdict is Verdict.UNKNOWN and self.search.is_unexplained:
            found = self._with_misplaced_column(self._with_rare_stretches(found))
            self.found = found = self._with_worst_range(self._with_differing_runs(found))
        if found.complete and found.verdict is Verdict.EFFECT and self.search.is_unexplained:
            self.found = found = self._with_worst_range(found)
        if found.complete and (
            why := beyond_training(found, limits, lambda: self._spread_of_replays(found))
        ):
            self.found = found = found.with_note(why)
            if found.verdict is Verdict.NONE:
                found = self._unknown_in_held_out()
        if found.complete and found.verdict is Verdict.NONE and self._all_is_as_declared:
            self.found = found = self._with_doubtful_number(found, asked, workers)
        if found.complete and (why := unchecked(found, self.dataset)):
            self.found = found = found.with_note(why)
        return self._with_rivals(found, asked, workers) if found.complete else found

    def _decide(self) -> None:
        """Search, and decide upon what was found."""
        stepwise.run(self.search, self._on_progress)
        if (own := with_own_noise(self.base, self.search)) is not None:
            self.base, self.search = own
            stepwise.run(self.search, self._on_progress)
        self.stage = "decide"
        self.refused = prune(self.search)
        self.decision = self._verdict()

    def _verdict(self) -> Decision:
        """Decide upon what the search holds."""
        return self._no_pass(decide(self.search, COARSE, self._on_progress, self.refused))

    def _no_pass(self, decision: Decision) -> Decision:
        """Return a decision in which a sensor that was read right is no pass."""
        return decision if self.sensor is None else self.sensor.decided(decision)

    def _read_at_scale(self) -> None:
        """Decide again with a channel read right whose scale is wrong."""
        right = with_scaled_channel(self.base, self.search, self._on_progress)
        if right is not None:
            self._decide_read_right(right)
        elif (found := scaled_sensor(self.base, self.search, self._on_progress)) is not None:
            self.sensor = found
            self._decide_read_right(found.base)

    def _decide_read_right(self, right: Baseline) -> None:
        """Decide again with a channel read right, in held-out runs as well."""
        self.dataset, self.base = right.dataset, right
        self.search = begin(right, self.search.thresholds)
        self._decide()

    def _decide_with_all_runs(self) -> None:
        """Look for a cause of what only runs show of which the calibrated model explains nothing.

        What explains such a run, and leaves nothing of the others, is no accident; a log of another
        machine stays out.
        """
        before = self.base, self.search, self.decision, self.refused
        whole, search = search_in_all_runs(self.base, self.search, self._on_progress)
        self.base, self.search = whole, search
        self._decide()
        found = self.decision.verdict is Verdict.EFFECT
        if not (found and explains_all_runs(self.search, before[0])):
            self.base, self.search, self.decision, self.refused = before
            return
        note = (
            f"the calibrated model explains nothing of {', '.join(before[0].left_out)}, "
            "with what was found it does"
        )
        self.decision = replace(self.decision, notes=(*self.decision.notes, note))

    @property
    def _all_is_as_declared(self) -> bool:
        """Whether nothing was added but what differs from a maker's sheet as parts do."""
        return all(isinstance(item.start, SheetNumber) for item in self.search.accepted)

    def _with_rare_stretches(self, found: Diagnosis) -> Diagnosis:
        """Note when what is missing acts, where that is seldom."""
        for note in note_of_rare_stretches(self.search.problem, self.search.fit.vector):
            found = found.with_note(note)
        return found

    def _with_worst_range(self, found: Diagnosis) -> Diagnosis:
        """Note where the model errs most, where that is in one part of a channel's range."""
        floors = found.covered.noise if found.covered is not None else {}
        worst = worst_range(found.error_by_value, floors)
        if worst is None:
            return found
        unknown = found.unknown
        if unknown is not None:
            unknown = replace(unknown, where=worst.words())
        return replace(found, unknown=unknown).with_note(worst.words())

    def _with_misplaced_column(self, found: Diagnosis) -> Diagnosis:
        """Note a column of the log that stands a row beside its place."""
        column = misplaced_column(self.search)
        return found if column is None else found.with_note(column.note)

    def _with_doubtful_number(
        self, found: Diagnosis, asked: Interruption, workers: Workers
    ) -> Diagnosis:
        """Note a number, or a scale, with which all would be as believed that is not."""
        self.stage = "numbers"
        self.progress(self.stage, 0.0)
        try:
            with checkpoints(asked), fits_by(workers):
                doubtful = doubtful_numbers(self.search)
        except KeyboardInterrupt:
            note = "interrupted before numbers that may be declared wrongly were looked for"
            return replace(found.with_note(note), complete=False)
        if doubtful is None:
            return found
        return replace(found.with_note(doubtful.note), doubtful=doubtful.words)

    def _with_differing_runs(self, found: Diagnosis) -> Diagnosis:
        """Note loads, masses or friction whose differences between runs explain it."""
        explained = 0.0
        if self.decision.learned and found.unknown is not None:
            explained = found.unknown.share
        if explained <= self.search.thresholds.nearly_all:
            explained = 0.0
        differing = differing_parameters(self.base, self.search.excess_base, explained)
        if differing is None:
            return found
        if found.unknown is not None and differing.is_all_of_it:
            # a curve would only imitate it
            if self.decision.learned:
                found = self._without_the_curve("it would imitate what differs between runs")
            assert found.unknown is not None
            unknown = Unknown(found.unknown.equation, (), differing.note)
            found = replace(found, unknown=unknown)
        return found.with_note(differing.note)

    def _what_stands(self, found: Diagnosis, asked: Interruption, workers: Workers) -> Diagnosis:
        """Take out what the end speaks against, one after the other; say what remains beside."""
        second = ""
        while found.complete and found.verdict is Verdict.EFFECT:
            against = against_the_end(self.search, found)
            against = against or against_second(self.search, second, found)
            if against is None:
                found = self._with_remainder(found, asked, workers)
                try:
                    with checkpoints(asked), fits_by(workers):
                        imitation = self._imitation(found)
                except KeyboardInterrupt:
                    note = "interrupted before a curve was tried instead of what was found"
                    self.found = found = replace(found.with_note(note), complete=False)
                    break
                if imitation is None:
                    break
                found = self._without_effect(imitation, asked, workers)
                continue
            # runs that are only scored choose between two, not among many
            others = () if second else against.item.equivalent
            found = self._without_effect(against, asked, workers, others)
            added = {item.start.candidate for item in self.search.effects}
            second = second or next((name for name in others if name in added), "")
        if found.verdict is Verdict.EFFECT and second in {item.id for item in found.effects}:
            self.found = found = found.with_note(
                f"held-out runs decided for {second}: over windows what is not accepted fits as "
                "well; ask runs of another day"
            )
        return found

    def _imitation(self, found: Diagnosis) -> Refusal | None:
        """Return an effect that only stands for a law that nobody declared, None for none."""
        if found.remainder is None:
            return None
        mean = only_a_mean(self.search, found.remainder)
        return mean or curve_instead(self.search, found.remainder, COARSE)

    def _with_remainder(self, found: Diagnosis, asked: Interruption, workers: Workers) -> Diagnosis:
        """Say what remains beside the effects, where more than noise does, and where it acts."""
        if not self.search.is_unexplained:
            return found
        self.stage = "locate"
        places = [(item.id, item.equation, item.at) for item in found.effects]
        try:
            with checkpoints(asked), fits_by(workers):
                left = remainder(self.search, places, COARSE, self._on_progress)
        except KeyboardInterrupt:
            note = "interrupted before what remains was located"
            return replace(found.with_note(note), complete=False)
        if left is None:
            return found
        effects = tuple(
            item.without_intervals if item.id in left.found_there else item
            for item in found.effects
        )
        self.found = replace(found, effects=effects, remainder=left).with_note(left.note)
        return self.found

    def _with_rivals(self, found: Diagnosis, asked: Interruption, workers: Workers) -> Diagnosis:
        """Fit what these data cannot tell from what was found."""
        self.stage = "rivals"
        self.progress(self.stage, 0.0)
        try:
            with checkpoints(asked), fits_by(workers):
                named = self.search.effects if found.verdict is Verdict.EFFECT else ()
                forms = {
                    item.start.candidate: other_forms(
                        self.search, item, item.start, self.search.fit
                    )
                    for item in named
                }
                rivals = other_rivals(self.search, self.decision, found, forms)
        except KeyboardInterrupt:
            note = "interrupted before the rivals were fitted"
            self.found = replace(found.with_note(note), complete=False)
        else:
            found = with_sizes_over_forms(found, forms)
            self.found = replace(found, rivals=(*found.rivals, *rivals))
        return self.found

    def interrupted(self) -> Diagnosis:
        """Return what there is where the calibration was interrupted."""
        note = "interrupted while calibrating: no effect was tried, so the verdict is open"
        self.decision = self._open(note)
        return self._assemble(complete=False)

    def failed(self, error: Exception) -> Diagnosis:
        """Return what was found before the stage that failed."""
        stage = failed_stage(self.stage, error)
        unknown = self.found.unknown
        if self.found.verdict is Verdict.UNKNOWN and unknown is None:
            unknown = Unknown(None, (), stage.note)
        found = replace(self.found, complete=False, unknown=unknown, failed=stage)
        return found.with_note(stage.note)

    def keep(self, *, complete: bool) -> None:
        """Write what has been found so far."""
        replace(self.found, complete=complete).keep(self.out)

    def _on_progress(self, stage: str, fraction: float) -> None:
        self.stage = stage
        self.progress(stage, fraction)

    def _open(self, note: str) -> Decision:
        return Decision(Verdict.UNKNOWN, self.search.fit, (note,), Unknown(None, (), note))

    def _if_it_stands(self, found: Diagnosis) -> Diagnosis:
        """Return what an interrupted search found, without causes that its own figures refuse."""
        refused: list[str] = []
        while (
            found.verdict is Verdict.EFFECT
            and found.replays != ()
            and (against := against_the_end(self.search, found)) is not None
        ):
            refused.append(against.note)
            if len(self.search.effects) > 1:
                drop(self.search, against.item, without(self.search, against.item))
                decision = self._decision_so_far()
                self.decision = replace(decision, notes=(*decision.notes, *refused))
            else:
                accept_nothing(self.search)
                self.decision = self._open(f"interrupted during the search; {'; '.join(refused)}")
            found = self._assemble(complete=False)
        return found

    def _decision_so_far(self) -> Decision:
        note = "interrupted during the search: it names the causes found until then"
        if not all(self.search.thresholds.allow(item.comparison) for item in self.search.effects):
            # one was still on trial, and the fit holds it
            accept_nothing(self.search)
            note = "interrupted during the search, before any cause had stood its test"
        verdict = Verdict.EFFECT if self.search.effects else Verdict.UNKNOWN
        missing, limits = self.search.excess_base, self.search.thresholds
        if not limits.is_unexplained(missing) and missing.relative < limits.rest:
            verdict = Verdict.NONE
        unknown = Unknown(None, (), note) if verdict is Verdict.UNKNOWN else None
        return self._no_pass(Decision(verdict, self.search.fit, (note,), unknown))

    def _assemble(self, *, complete: bool) -> Diagnosis:
        """Assemble what was decided, and replay all runs."""
        self.stage = "assemble"
        self.found = assemble(self.dataset, self.base, self.search, self.decision)
        self.keep(complete=False)
        self.stage = "score"
        base = self.base.at_angles(starts_of(self.search.problem))
        before = self.search.base.vector if adds(self.search, self.decision) else None
        try:
            found = with_replay_errors(self.found, self.dataset, base, before, self._on_progress)
        except KeyboardInterrupt:
            note = "interrupted before the runs were scored"
            return replace(self.found.with_note(note), complete=False)
        self.found = replace(found, complete=complete)
        return self.found

    def _without_effect(
        self, against: Refusal, asked: Interruption, workers: Workers, others: Sequence[str] = ()
    ) -> Diagnosis:
        """Decide again without an effect that the end speaks against.

        Args:
            against: it, and why. asked, workers: as of `whole`.
            others: its equivalents, if the best of them may take its place.
        """
        self.stage = "decide"
        try:
            with checkpoints(asked), fits_by(workers):
                if not (others and take_equivalent(self.search, against.item)):
                    drop(self.search, against.item, without(self.search, against.item))
                self.refused += [against, *prune(self.search)]
                self.decision = self._verdict()
        except KeyboardInterrupt:
            accept_nothing(self.search)
            self.decision = self._open(f"interrupted where {against.note}")
            return self._assemble(complete=False)
        return self._assemble(complete=True)

    def _unknown_in_held_out(self) -> Diagnosis:
        """Say that something acts in held-out runs alone, and in which balance."""
        self.stage = "locate"
        nothing_missing = self.decision
        self._decided(in_held_out(nothing_missing, ""))
        problem = held_out_windows(self.dataset, self.base, self.found.revised)
        if problem is not None:
            _, equation, _ = locate(problem, self.search.fit, COARSE, self._on_progress)
            self._decided(in_held_out(nothing_missing, equation))
        return self.found

    def _spread_of_replays(self, found: Diagnosis) -> Mapping[str, float]:
        """Return what the uncertainty of what was fitted makes of whole held-out replays, SI."""
        if not found.rivals:
            return {}
        late = {name: item.value for name, item in found.lateness.items()}
        return spread_of_replays(self.dataset, self.base, found.rivals[0], late)

    def _decided(self, decision: Decision) -> None:
        """Take another verdict on what was found, so that it stands if what follows fails."""
        self.decision = decision
        self.found = replace(self.found, verdict=decision.verdict, unknown=decision.unknown)

    def _without_the_curve(self, why: str) -> Diagnosis:
        """Leave a learned curve out of the revised model with which replays are worse."""
        self.stage = "decide"
        self.decision = without_curve(self.decision, self.search, why)
        return self._assemble(complete=True)


def _calibration_alone(dataset: Dataset, base: Baseline, decision: Decision) -> Diagnosis:
    """Return what a calibration alone says, without intervals: no run is simulated here."""
    model = revised_model(dataset.model, base.fit.vector, base.keys)
    return Diagnosis(
        decision.verdict,
        model,
        model,
        unknown=decision.unknown,
        notes=(*base.notes, *decision.notes),
        complete=False,
    )
