"""`diagnose` and `calibrate`: the whole way from a dataset to a verdict and a revised model."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from eha_bench.core.atomic_file import write_text
from eha_bench.core.errors import EhaBenchError, InputError, Place
from eha_bench.core.finite import finite_or_none
from eha_bench.core.interruption import Interruption, checkpoints, raised_again
from eha_bench.core.output_folder import writable
from eha_bench.core.progress import ProgressHook
from eha_bench.core.workers import IN_PROCESS, Workers
from eha_bench.diagnosis.data.dataset import Dataset, load_dataset
from eha_bench.diagnosis.fit.baseline import (
    COARSE,
    Baseline,
    CalibrationInterrupted,
    calibrated_baseline,
    no_progress,
)
from eha_bench.diagnosis.fit.convergence import Convergence, moved_notes
from eha_bench.diagnosis.fit.effort import count_simulated_time
from eha_bench.diagnosis.fit.evidence import Groups, groups_of
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.profile import profile_interval
from eha_bench.diagnosis.fit.side_by_side import fits_by, one_thread_of_algebra
from eha_bench.diagnosis.fit.start_angles import angles_note, starts_of
from eha_bench.diagnosis.fit.uncertainty import (
    Covariance,
    Estimate,
    ParameterDirection,
    covariance,
    directions,
    estimates,
    open_parameters,
    undetermined_directions,
)
from eha_bench.diagnosis.outcome.at_rest import Calibrated, with_friction_at_rest
from eha_bench.diagnosis.outcome.beyond_training import beyond_training
from eha_bench.diagnosis.outcome.decide import Decision, decide, in_held_out
from eha_bench.diagnosis.outcome.diagnosis import (
    SCHEMA_VERSION,
    Diagnosis,
    FailedStage,
    Unknown,
    Verdict,
    errors_to_dict,
    estimate_to_dict,
    failed_stage,
    own_to_dict,
)
from eha_bench.diagnosis.outcome.differing_runs import differing_parameter
from eha_bench.diagnosis.outcome.findings import (
    assemble,
    lateness_estimates,
    lateness_note,
    own_estimates,
    units_of,
)
from eha_bench.diagnosis.outcome.honest import curve_is_worse, prune, worse
from eha_bench.diagnosis.outcome.model_errors import held_out_windows, scores_of, with_replay_errors
from eha_bench.diagnosis.outcome.own_noise import with_own_noise, with_slow_noise
from eha_bench.diagnosis.outcome.revise import revised_model
from eha_bench.diagnosis.outcome.rivals import other_rivals
from eha_bench.diagnosis.points import diagnose_points
from eha_bench.diagnosis.replay.errors_by_channel import ChannelError
from eha_bench.diagnosis.search import stepwise
from eha_bench.diagnosis.search.backward import drop, without
from eha_bench.diagnosis.search.state import begin
from eha_bench.diagnosis.unknown.locator import locate
from eha_bench.plants.model import Model
from eha_bench.plants.static_plant import StaticPlant

_NOTHING = 5.0


@dataclass(frozen=True)
class Calibration:
    """Parameters under `calibrate`, estimated on all training runs.

    Attributes:
        model: with the estimates. parameters: with 95 % intervals, SI; friction at rest among them
            where it was estimated.
        undetermined: directions that the data do not determine, in words.
        train, holdout, unseen: channel -> errors (before: declared; after: calibrated).
        per_run: run -> parameter of that run alone -> value; of held-out runs by their first
            part.
        lateness: clock of a log -> s by which its stamps are late by always the same.
        notes: what the data gate found, and what was estimated in addition to `calibrate`.
        complete: False where it was interrupted.
        convergence: how the fit ended. weakest: direction of the information matrix, if any.
        covariance: of all fitted numbers; None where no interval is given. seconds: it took.
        failed: the stage that failed, if any: what was found before it stands.
    """

    model: Model
    parameters: dict[str, Estimate]
    undetermined: tuple[str, ...]
    train: Mapping[str, ChannelError]
    notes: tuple[str, ...]
    complete: bool = True
    holdout: Mapping[str, ChannelError] = field(default_factory=dict)
    unseen: Mapping[str, ChannelError] = field(default_factory=dict)
    per_run: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)
    lateness: Mapping[str, Estimate] = field(default_factory=dict)
    convergence: Convergence | None = None
    weakest: tuple[ParameterDirection, ...] = ()
    covariance: Covariance | None = None
    seconds: float = math.nan
    failed: FailedStage | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the content of calibration.json; what is not computable is null."""
        return {
            "schema_version": SCHEMA_VERSION,
            "parameters": {name: estimate_to_dict(e) for name, e in self.parameters.items()},
            "undetermined": list(self.undetermined),
            "weakest_direction": [
                {"deviation": finite_or_none(item.deviation), "parameters": dict(item.shares)}
                for item in self.weakest
            ],
            "convergence": None if self.convergence is None else self.convergence.to_dict(),
            "covariance": None if self.covariance is None else self.covariance.to_dict(),
            "seconds": finite_or_none(self.seconds),
            "per_run": own_to_dict(self.per_run),
            "lateness": {name: estimate_to_dict(e) for name, e in self.lateness.items()},
            "error": {
                "train": errors_to_dict(self.train),
                "holdout": errors_to_dict(self.holdout),
                "unseen": errors_to_dict(self.unseen),
            },
            "model": "calibrated.yaml",
            "notes": list(self.notes),
            "complete": self.complete,
            "failed": None if self.failed is None else self.failed.to_dict(),
        }  # fmt: skip

    def write(self, folder: Path) -> None:
        """Write calibration.json and calibrated.yaml into a folder."""
        folder.mkdir(parents=True, exist_ok=True)
        self.model.write(folder / "calibrated.yaml", "Calibrated by eha-bench calibrate")
        text = json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False)
        write_text(folder / "calibration.json", text + "\n")


def calibrate(
    dataset: Dataset | str | Path | Mapping[str, Any],
    out: str | Path | None = None,
    progress: ProgressHook = no_progress,
) -> Calibration:
    """Estimate the parameters under `calibrate` on all training runs by simulation error.

    How friction behaves at rest is estimated as well, and noted; it keeps its declared
    value where the data do not determine it. Ctrl-C (or SIGTERM) ends the fit and keeps what was
    found until then (`complete` is False); once that is in `out`, the signal is raised again.

    Args:
        dataset: dataset.yaml, a dict of what it would hold, or as loaded.
        out: folder that gets calibration.json and calibrated.yaml.
        progress: called with the stage and the fraction of it done.

    Raises:
        InputError: a file is wrong or missing, nothing can be compared, or `out` cannot be used.
    """
    loaded = dataset if isinstance(dataset, Dataset) else load_dataset(dataset)
    if out is not None:
        writable(Path(out))
    if isinstance(loaded.model.plant, StaticPlant):
        raise InputError(
            f"calibrate fits recordings over time; {loaded.model.plant_id} has operating points",
            where=Place(file=loaded.source),
            hint="diagnose fits its parameters under `calibrate` with every candidate",
        )
    with raised_again(kept=out is not None):
        return _calibrate(loaded, out, progress)


def _calibrate(loaded: Dataset, out: str | Path | None, progress: ProgressHook) -> Calibration:
    """Return the estimates, as far as the fit came."""
    started, complete = time.perf_counter(), True
    with one_thread_of_algebra(), Interruption() as asked:
        try:
            with checkpoints(asked):
                base = calibrated_baseline(loaded, progress)
        except CalibrationInterrupted as stop:
            base, complete = stop.baseline, False
        groups = groups_of(base.problem)
        ended = with_friction_at_rest(base, groups, units_of(loaded.model))
        found = replace(_estimates(base, ended, groups), complete=False)
        _write(found, out)
        stage = "intervals"
        try:
            if complete:
                found = _with_profiles(base.problem, ended.end.fit, found, progress)
            stage = "score"
            found = _with_errors(found, base, ended.end.fit, progress)
        except Exception as error:
            found = _ended_in(found, stage, error)
            _write(found, out)
            if isinstance(error, EhaBenchError):
                raise
            complete = False
    if not complete and found.failed is None:
        found = replace(found, notes=(*found.notes, "interrupted before the fit had ended"))
    found = replace(found, complete=complete, seconds=time.perf_counter() - started)
    _write(found, out)
    return found


def _estimates(base: Baseline, ended: Calibrated, groups: Groups) -> Calibration:
    """Return what a fit has estimated, without errors: no run is replayed here."""
    model, end, places = base.dataset.model, ended.end, base.problem.places
    vector = end.fit.vector
    notes = [
        *base.notes,
        *ended.notes,
        *ended.convergence.notes(),
        *moved_notes(
            model,
            {key: float(vector[places.index[key]]) for key in ended.keys},
            ended.convergence.at_bounds,
        ),
    ]
    if starts := starts_of(base.problem):
        notes.append(angles_note(starts))
    values = estimates(end.fit, groups, units_of(model), shift=end.shifts)
    open_ = open_parameters(end.fit) if ended.convergence.has_intervals else values.keys()
    values = {key: item.without_interval if key in open_ else item for key, item in values.items()}
    late = lateness_estimates(places, values)
    notes += lateness_note(late)
    return Calibration(
        revised_model(model, vector, ended.keys),
        {key: item for key, item in values.items() if key in places.layout.index},
        undetermined_directions(end.fit),
        {},
        tuple(notes),
        per_run=own_estimates(places, values),
        lateness=late,
        convergence=ended.convergence,
        weakest=directions(end.fit)[:1],
        covariance=_covariance(end.fit, groups) if ended.convergence.has_intervals else None,
    )


def _with_errors(
    found: Calibration, base: Baseline, fit: Fit, progress: ProgressHook
) -> Calibration:
    """Return a calibration with its errors on all runs, held-out ones included."""
    declared = base.dataset.model
    places = base.problem.places
    scores = scores_of(
        base.dataset,
        base,
        (declared, declared, found.model),
        (places.with_lateness(declared.vector(), places.lateness(fit.vector)), fit.vector),
        progress,
    )
    return replace(found, **scores.fields(found.per_run, found.notes))


def _ended_in(found: Calibration, stage: str, error: Exception) -> Calibration:
    """Return what was found before a stage that failed."""
    failed = failed_stage(stage, error)
    return replace(found, failed=failed, notes=(*found.notes, failed.note))


def _with_profiles(
    problem: Problem, fit: Fit, found: Calibration, progress: ProgressHook
) -> Calibration:
    """Return a calibration with the profile's intervals where they reach further."""
    values = dict(found.parameters)
    for number, (key, item) in enumerate(found.parameters.items()):
        progress("intervals", number / len(values))
        half = max(item.high - item.value, item.value - item.low)
        values[key] = replace(item, profile=profile_interval(problem, fit, key, half))
    return replace(found, parameters=values)


def _covariance(fit: Fit, groups: Groups) -> Covariance:
    return Covariance(tuple(item.key for item in fit.free), covariance(fit, groups))


def diagnose(
    dataset: Dataset | str | Path | Mapping[str, Any],
    out: str | Path | None = None,
    progress: ProgressHook = no_progress,
    workers: Workers = IN_PROCESS,
) -> Diagnosis:
    """Close the loop: residual, cause, revised model, errors before and after.

    Runs for holdout are read only when everything is decided. Ctrl-C ends the search and keeps what
    was found until then (`complete` is False); pressed again it leaves the errors out.

    Args:
        dataset: dataset.yaml, a dict of what it would hold, or as loaded.
        out: folder that gets diagnosis.json, revised.yaml and recalibrated.yaml.
        progress: called with the stage and the fraction of it done.
        workers: do the fits that are independent; this process does so on threads.

    Raises:
        InputError: a file is wrong or missing, nothing can be compared, or `out` cannot be used.
        WorkError: a worker could not do what it was given.
    """
    started = time.perf_counter()
    loaded = dataset if isinstance(dataset, Dataset) else load_dataset(dataset)
    if out is not None:
        writable(Path(out))
    if isinstance(loaded.model.plant, StaticPlant):
        found = replace(diagnose_points(loaded, progress), seconds=time.perf_counter() - started)
        if out is not None:
            found.write(Path(out))
        return found
    with one_thread_of_algebra(), Interruption() as asked, count_simulated_time() as spent:
        progress("calibrate", 0.0)
        try:
            with checkpoints(asked), fits_by(workers):
                base, interrupted = calibrated_baseline(loaded, progress), False
        except CalibrationInterrupted as stop:
            base, interrupted = stop.baseline, True
        closing = _Closing(loaded, base, Path(out) if out is not None else None, progress)
        closing.keep(complete=False)
        try:
            found = (
                closing.conclude_interrupted() if interrupted else closing.conclude(asked, workers)
            )
        except Exception as error:
            found = closing.conclude_failed(error)
            if isinstance(error, EhaBenchError):
                _write(replace(found, seconds=time.perf_counter() - started), out)
                raise
    found = replace(
        found,
        seconds=time.perf_counter() - started,
        # exactly, as threads end in any order
        simulations=math.fsum(spent) / sum(float(item.time[-1]) for item in base.measured),
    )
    _write(found, out)
    progress("done", 1.0)
    return found


def _write(found: Diagnosis | Calibration, out: str | Path | None) -> None:
    if out is not None:
        found.write(Path(out))


class _Closing:
    """A diagnosis from its calibrated model on, stage by stage.

    What has been found is on disk before the next stage begins, so none takes it away.

    Args:
        dataset: with the declared model. base: calibrated. out: folder, or None.
        progress: called with the stage and the fraction of it done.
    """

    def __init__(
        self, dataset: Dataset, base: Baseline, out: Path | None, progress: ProgressHook
    ) -> None:
        self.dataset, self.base, self.out, self.progress = dataset, base, out, progress
        self.stage = "search"
        self.refused: list[str] = []
        self.search = begin(base)
        note = "no effect was tried yet, so the verdict is open"
        self.decision = self._open(note)
        self.found = _calibration_alone(dataset, base, self.decision)

    def conclude(self, asked: Interruption, workers: Workers) -> Diagnosis:
        """Search, decide, and score; or as far as that goes until a stop is asked for."""
        try:
            with checkpoints(asked), fits_by(workers):
                self._decide()
                if (slow := with_slow_noise(self.base, self.search, self.decision)) is not None:
                    self.base, self.search = slow, begin(slow)
                    self._decide()
        except KeyboardInterrupt:
            self.decision = self._decision_so_far()
            return self._assemble(complete=False)
        found = self._assemble(complete=True)
        while found.complete and found.verdict is Verdict.EFFECT and (why := worse(found)):
            found = self._without_the_weakest(why)
        if found.complete and self.decision.learned and (why := curve_is_worse(found)):
            found = self._without_the_curve(why)
        if found.complete and found.verdict is Verdict.UNKNOWN:
            self.found = found = self._with_differing_runs(found)
        if found.complete and (why := beyond_training(found)):
            self.found = found = replace(found, notes=(*found.notes, why))
            if found.verdict is Verdict.NONE:
                found = self._unknown_in_held_out()
        return self._with_rivals(found, asked, workers) if found.complete else found

    def _decide(self) -> None:
        """Search, and decide upon what was found."""
        stepwise.run(self.search, self._on_progress)
        if (own := with_own_noise(self.base, self.search)) is not None:
            self.base, self.search = own
            stepwise.run(self.search, self._on_progress)
        self.stage = "decide"
        self.refused = prune(self.search)
        self.decision = decide(self.search, COARSE, self._on_progress, self.refused)

    def _with_differing_runs(self, found: Diagnosis) -> Diagnosis:
        """Note a load or a mass whose differences between runs explain what is missing."""
        differing = differing_parameter(self.base, self.search.excess_base)
        return found if differing is None else replace(found, notes=(*found.notes, differing.note))

    def _with_rivals(self, found: Diagnosis, asked: Interruption, workers: Workers) -> Diagnosis:
        """Fit what these data cannot tell from what was found."""
        self.stage = "rivals"
        self.progress(self.stage, 0.0)
        try:
            with checkpoints(asked), fits_by(workers):
                rivals = other_rivals(self.search, self.decision, found)
        except KeyboardInterrupt:
            note = "interrupted before the rivals were fitted"
            self.found = replace(found, notes=(*found.notes, note), complete=False)
        else:
            self.found = replace(found, rivals=(*found.rivals, *rivals))
        return self.found

    def conclude_interrupted(self) -> Diagnosis:
        """Return what there is where the calibration was interrupted."""
        note = "interrupted while calibrating: no effect was tried, so the verdict is open"
        self.decision = self._open(note)
        return self._assemble(complete=False)

    def conclude_failed(self, error: Exception) -> Diagnosis:
        """Return what was found before the stage that failed."""
        failed = failed_stage(self.stage, error)
        unknown = self.found.unknown
        if self.found.verdict is Verdict.UNKNOWN and unknown is None:
            unknown = Unknown(None, (), failed.note)
        return replace(
            self.found,
            complete=False,
            unknown=unknown,
            failed=failed,
            notes=(*self.found.notes, failed.note),
        )

    def keep(self, *, complete: bool) -> None:
        """Write what has been found so far."""
        _write(replace(self.found, complete=complete), self.out)

    def _on_progress(self, stage: str, fraction: float) -> None:
        self.stage = stage
        self.progress(stage, fraction)

    def _open(self, note: str) -> Decision:
        return Decision(Verdict.UNKNOWN, self.search.fit, (note,), Unknown(None, (), note))

    def _decision_so_far(self) -> Decision:
        note = "interrupted during the search: it names the causes found until then"
        verdict = Verdict.EFFECT if self.search.effects else Verdict.UNKNOWN
        if self.search.excess_base.significance < _NOTHING:
            verdict = Verdict.NONE
        unknown = Unknown(None, (), note) if verdict is Verdict.UNKNOWN else None
        return Decision(verdict, self.search.fit, (note,), unknown)

    def _assemble(self, *, complete: bool) -> Diagnosis:
        """Assemble what was decided, and replay all runs."""
        self.stage = "assemble"
        self.found = assemble(self.dataset, self.base, self.search, self.decision)
        self.keep(complete=False)
        self.stage = "score"
        base = self.base.at_angles(starts_of(self.search.problem))
        try:
            found = with_replay_errors(
                self.found, self.dataset, base, self.search.base.vector, self._on_progress
            )
        except KeyboardInterrupt:
            note = "interrupted before the runs were scored"
            return replace(self.found, notes=(*self.found.notes, note), complete=False)
        self.found = replace(found, complete=complete)
        return self.found

    def _without_the_weakest(self, why: str) -> Diagnosis:
        """Decide again without the weakest effect, with which runs never fitted are worse."""
        search = self.search
        weakest = min(search.effects, key=lambda item: item.comparison.gain)
        self.stage = "decide"
        drop(search, weakest, without(search, weakest))
        self.refused.append(f"{weakest.start.candidate} is not accepted: {why}")
        self.decision = decide(search, COARSE, self._on_progress, self.refused)
        return self._assemble(complete=True)

    def _unknown_in_held_out(self) -> Diagnosis:
        """Say that something acts in held-out runs alone, and in which balance."""
        self.stage = "locate"
        problem = held_out_windows(self.dataset, self.base, self.found.revised)
        equation = ""
        if problem is not None:
            _, equation, _ = locate(problem, self.search.fit, COARSE, self._on_progress)
        self.decision = in_held_out(self.decision, equation)
        verdict, unknown = self.decision.verdict, self.decision.unknown
        self.found = replace(self.found, verdict=verdict, unknown=unknown)
        return self.found

    def _without_the_curve(self, why: str) -> Diagnosis:
        """Leave a learned curve out of the revised model with which replays are worse."""
        self.stage = "decide"
        note = f"the learned curve is left out of the revised model: {why}"
        self.decision = replace(
            self.decision,
            fit=self.search.fit,
            learned=False,
            notes=(*self.decision.notes, note),
        )
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
