"""`calibrate`: from a dataset to the parameters of its model, fitted by simulation error."""

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
from eha_bench.core.interruption import Interruption, checkpoints, signals_raised_after
from eha_bench.core.output_folder import spare_inputs, writable
from eha_bench.core.progress import ProgressHook, live_progress
from eha_bench.diagnosis.data.dataset import Dataset, load_dataset
from eha_bench.diagnosis.ended_runs import baseline_up_to_jumps
from eha_bench.diagnosis.fit.baseline import (
    Baseline,
    CalibrationInterrupted,
    no_progress,
)
from eha_bench.diagnosis.fit.convergence import Convergence, moved_notes
from eha_bench.diagnosis.fit.evidence import Groups, groups_of
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.profile import profile_interval
from eha_bench.diagnosis.fit.side_by_side import one_thread_of_algebra
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
from eha_bench.diagnosis.outcome.diagnosis import (
    SCHEMA_VERSION,
    FailedStage,
    errors_to_dict,
    estimate_to_dict,
    failed_stage,
    own_to_dict,
)
from eha_bench.diagnosis.outcome.findings import (
    lateness_estimates,
    lateness_notes,
    own_estimates,
)
from eha_bench.diagnosis.outcome.model_errors import scores_of
from eha_bench.diagnosis.outcome.revise import revised_model
from eha_bench.diagnosis.replay.error_by_value import ErrorByValue
from eha_bench.diagnosis.replay.errors_by_channel import ChannelError
from eha_bench.plants.model import Model
from eha_bench.plants.static_plant import StaticPlant
from eha_bench.posterior.covered import Covered

CALIBRATED = "calibrated.yaml"
SUMMARY = "calibration.json"
_NOTHING_ASKED = (
    "nothing is calibrated: the model has no parameter under `calibrate`; list there which ones "
    "may be estimated"
)


@dataclass(frozen=True)
class Calibration:
    """Parameters under `calibrate`, estimated on all training runs.

    Attributes:
        model: with the estimates. parameters: with 95 % intervals, SI; friction at rest among them
            where it was estimated.
        undetermined: directions that the data do not determine, in words.
        train, holdout, unseen: channel -> errors (before: declared; after: calibrated).
        covered: where the training recordings have been.
        error_by_value: errors of the calibrated model by the value of each channel.
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
    covered: Covered | None = None
    error_by_value: tuple[ErrorByValue, ...] = ()
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
            "covered": None if self.covered is None else self.covered.to_dict(),
            "error_by_value": [item.to_dict() for item in self.error_by_value],
            "model": CALIBRATED,
            "notes": list(self.notes),
            "complete": self.complete,
            "failed": None if self.failed is None else self.failed.to_dict(),
        }  # fmt: skip

    def write(self, folder: Path) -> None:
        """Write calibration.json and calibrated.yaml into a folder."""
        folder.mkdir(parents=True, exist_ok=True)
        self.model.write(folder / CALIBRATED, "Calibrated by eha-bench calibrate")
        text = json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False)
        write_text(folder / SUMMARY, text + "\n")

    def with_note(self, note: str) -> Calibration:
        """Return it with one more note."""
        return replace(self, notes=(*self.notes, note))

    def keep(self, folder: str | Path | None) -> None:
        """Write it where there is a folder to write it to."""
        if folder is not None:
            self.write(Path(folder))


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
        folder = writable(Path(out))
        spare_inputs((folder / CALIBRATED, folder / SUMMARY), loaded.files)
    if isinstance(loaded.model.plant, StaticPlant):
        raise InputError(
            f"calibrate fits recordings over time; {loaded.model.plant_id} has operating points",
            where=Place(file=loaded.source),
            hint="diagnose fits its parameters under `calibrate` with every candidate",
        )
    with signals_raised_after(kept=out is not None), live_progress(progress) as live:
        return _calibrate(loaded, out, live)


def _calibrate(loaded: Dataset, out: str | Path | None, progress: ProgressHook) -> Calibration:
    """Return the estimates, as far as the fit came."""
    started, complete = time.perf_counter(), True
    with one_thread_of_algebra(), Interruption() as asked:
        try:
            with checkpoints(asked):
                base = baseline_up_to_jumps(loaded, progress)
        except CalibrationInterrupted as stop:
            base, complete = stop.baseline, False
        groups = groups_of(base.problem)
        units = loaded.model.plant.layout.units_at(loaded.model.vector())
        ended = with_friction_at_rest(base, groups, units)
        found = replace(_estimates(base, ended, groups), complete=False)
        found.keep(out)
        stage = "intervals"
        try:
            if complete:
                found = _with_profiles(base.problem, ended.end.fit, found, progress)
            stage = "score"
            found = _with_errors(found, base, ended.end.fit, progress)
        except Exception as error:
            found = _ended_in(found, stage, error)
            found.keep(out)
            if isinstance(error, EhaBenchError):
                raise
            complete = False
    if not complete and found.failed is None:
        found = found.with_note("interrupted before the fit had ended")
    found = replace(found, complete=complete, seconds=time.perf_counter() - started)
    found.keep(out)
    return found


def _estimates(base: Baseline, ended: Calibrated, groups: Groups) -> Calibration:
    """Return what a fit has estimated, without errors: no run is replayed here."""
    model, end, places = base.dataset.model, ended.end, base.problem.places
    vector = end.fit.vector
    values = estimates(end.fit, groups, places.layout.units_at(vector), shift=end.shifts)
    open_ = open_parameters(end.fit) if ended.convergence.has_intervals else values.keys()
    values = {key: item.without_interval if key in open_ else item for key, item in values.items()}
    notes = [
        *base.notes,
        *ended.notes,
        *ended.convergence.notes(),
        *moved_notes(
            model,
            {key: float(vector[places.index[key]]) for key in ended.keys},
            ended.convergence.at_bounds,
            {key: (item.low, item.high) for key, item in values.items()},
        ),
    ]
    if starts := starts_of(base.problem):
        notes.append(angles_note(starts))
    late = lateness_estimates(places, values)
    notes += lateness_notes(places, late)
    parameters = {key: item for key, item in values.items() if key in places.layout.index}
    per_run = own_estimates(places, values)
    if not parameters and not per_run:
        notes.insert(0, _NOTHING_ASKED)
    return Calibration(
        revised_model(model, vector, ended.keys),
        parameters,
        undetermined_directions(end.fit),
        {},
        tuple(notes),
        per_run=per_run,
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
    return replace(found, failed=failed).with_note(failed.note)


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
