"""`diagnose` and `calibrate`: the whole way from a dataset to a verdict and a revised model."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.atomic_file import write_text
from eha_bench.core.errors import InputError, Place
from eha_bench.core.interruption import Interruption, checkpoints
from eha_bench.core.output_folder import writable
from eha_bench.core.workers import HERE, Workers
from eha_bench.diagnosis.data.dataset import Dataset, load_dataset
from eha_bench.diagnosis.fit.baseline import (
    COARSE,
    Baseline,
    CalibrationInterrupted,
    calibrated,
    no_progress,
)
from eha_bench.diagnosis.fit.effort import counted
from eha_bench.diagnosis.fit.evidence import groups_of
from eha_bench.diagnosis.fit.side_by_side import fits_by, one_thread_of_algebra
from eha_bench.diagnosis.fit.start_angles import said, starts_of
from eha_bench.diagnosis.fit.uncertainty import Estimate, estimates, undetermined
from eha_bench.diagnosis.outcome.at_rest import with_friction_at_rest
from eha_bench.diagnosis.outcome.decide import Decision, decide
from eha_bench.diagnosis.outcome.diagnosis import (
    SCHEMA_VERSION,
    Diagnosis,
    Unknown,
    Verdict,
    errors_to_dict,
    estimate_to_dict,
)
from eha_bench.diagnosis.outcome.findings import assemble, units_of
from eha_bench.diagnosis.outcome.revise import revised
from eha_bench.diagnosis.outcome.scoring import scored
from eha_bench.diagnosis.points import diagnose_points
from eha_bench.diagnosis.replay.errors_by_channel import (
    ChannelError,
    floors,
    replay_errors,
    replay_notes,
)
from eha_bench.diagnosis.replay.replay import replay
from eha_bench.diagnosis.search import stepwise
from eha_bench.diagnosis.search.stepwise import Search
from eha_bench.plants.model import Model
from eha_bench.plants.static_plant import StaticPlant

FloatArray = NDArray[np.float64]
Progress = Callable[[str, float], None]

_NOTHING = 5.0


@dataclass(frozen=True)
class Calibration:
    """Parameters under `calibrate`, estimated on all training runs.

    Attributes:
        model: with the estimates. parameters: with 95 % intervals, SI; friction at rest among them
            where it was estimated.
        undetermined: directions that the data do not determine, in words.
        train: channel -> errors (before: declared; after: calibrated).
        notes: what the data gate found, and what was estimated beside `calibrate`.
        complete: False where it was interrupted.
    """

    model: Model
    parameters: dict[str, Estimate]
    undetermined: tuple[str, ...]
    train: dict[str, ChannelError]
    notes: tuple[str, ...]
    complete: bool = True

    def to_dict(self) -> dict[str, Any]:
        """Return the content of calibration.json; what is not computable is null."""
        return {
            "schema_version": SCHEMA_VERSION,
            "parameters": {name: estimate_to_dict(e) for name, e in self.parameters.items()},
            "undetermined": list(self.undetermined),
            "error": {"train": errors_to_dict(self.train)},
            "model": "calibrated.yaml",
            "notes": list(self.notes),
            "complete": self.complete,
        }

    def write(self, folder: Path) -> None:
        """Write calibration.json and calibrated.yaml into a folder."""
        folder.mkdir(parents=True, exist_ok=True)
        self.model.write(folder / "calibrated.yaml", "Calibrated by eha-bench calibrate")
        text = json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False)
        write_text(folder / "calibration.json", text + "\n")


def calibrate(
    dataset: Dataset | str | Path, out: str | Path | None = None, progress: Progress = no_progress
) -> Calibration:
    """Estimate the parameters under `calibrate` on all training runs by simulation error.

    How friction behaves at rest is estimated as well, and said in the notes; it keeps its declared
    value where the data do not determine it. Ctrl-C ends the fit and keeps what was found until
    then (`complete` is False).

    Args:
        dataset: dataset.yaml, or as loaded.
        out: folder that gets calibration.json and calibrated.yaml.
        progress: called with the stage and the fraction of it done.

    Raises:
        InputError: a file is wrong or missing, nothing can be compared, or `out` cannot be used.
    """
    loaded = dataset if isinstance(dataset, Dataset) else load_dataset(Path(dataset))
    if out is not None:
        writable(Path(out))
    if isinstance(loaded.model.plant, StaticPlant):
        raise InputError(
            f"calibrate fits recordings over time; {loaded.model.plant_id} has operating points",
            where=Place(file=loaded.source),
            hint="diagnose fits its parameters under `calibrate` with every candidate",
        )
    complete = True
    with one_thread_of_algebra(), Interruption() as asked:
        try:
            with checkpoints(asked):
                base = calibrated(loaded, progress)
        except CalibrationInterrupted as stop:
            base, complete = stop.baseline, False
        groups, units = groups_of(base.problem), units_of(loaded.model)
        ended = with_friction_at_rest(base, groups, units)
        end = ended.end
        model = revised(loaded.model, end.fit.vector, ended.keys)
        noise = base.problem.noise
        replays = replay(
            base.measured, [loaded.model, model], noise, lambda done: progress("replay", done)
        )
        errors = replay_errors(replays, floors(noise), places=(0, 0, 1))
    notes = (*base.notes, *ended.notes)
    if not complete:
        notes = (*notes, "interrupted before the fit had ended")
    if begun := starts_of(base.problem):
        notes = (*notes, said(begun))
    found = Calibration(
        model,
        estimates(end.fit, groups, units, shift=end.shifts),
        undetermined(end.fit),
        errors,
        (*notes, *replay_notes(replays, errors)),
        complete,
    )
    if out is not None:
        found.write(Path(out))
    return found


def diagnose(
    dataset: Dataset | str | Path,
    out: str | Path | None = None,
    progress: Progress = no_progress,
    workers: Workers = HERE,
) -> Diagnosis:
    """Close the loop: residual, cause, revised model, errors before and after.

    Runs for holdout are read only when everything is decided. Ctrl-C ends the search and keeps what
    was found until then (`complete` is False); pressed again it leaves the errors out.

    Args:
        dataset: dataset.yaml, or as loaded.
        out: folder that gets diagnosis.json, revised.yaml and recalibrated.yaml.
        progress: called with the stage and the fraction of it done.
        workers: do the fits that are independent; this process does so on threads.

    Raises:
        InputError: a file is wrong or missing, nothing can be compared, or `out` cannot be used.
        WorkError: a worker could not do what it was given.
    """
    started = time.perf_counter()
    loaded = dataset if isinstance(dataset, Dataset) else load_dataset(Path(dataset))
    if out is not None:
        writable(Path(out))
    if isinstance(loaded.model.plant, StaticPlant):
        found = replace(diagnose_points(loaded, progress), seconds=time.perf_counter() - started)
        if out is not None:
            found.write(Path(out))
        return found
    with one_thread_of_algebra(), Interruption() as asked, counted() as spent:
        with fits_by(workers):
            base, search, decision, complete = _searched(loaded, asked, progress)
        found = assemble(loaded, base, search, decision)
        base = base.begun(starts_of(search.problem))
        vectors = (search.base.vector, found.revised.vector())
        try:
            found = scored(found, loaded, base, vectors, progress)
        except KeyboardInterrupt:
            complete = False
            found = replace(found, notes=(*found.notes, "interrupted before the runs were scored"))
    found = replace(
        found,
        complete=complete,
        seconds=time.perf_counter() - started,
        # exactly, as threads end in any order
        simulations=math.fsum(spent) / sum(float(item.time[-1]) for item in base.measured),
    )
    if out is not None:
        found.write(Path(out))
    progress("done", 1.0)
    return found


def _searched(
    dataset: Dataset, asked: Interruption, progress: Progress
) -> tuple[Baseline, Search, Decision, bool]:
    """Calibrate, search and decide, or as far as that went until a stop was asked for.

    The last value says whether all of it was done.
    """
    try:
        with checkpoints(asked):
            base = calibrated(dataset, progress)
    except CalibrationInterrupted as stop:
        search = stepwise.begin(stop.baseline)
        note = "interrupted while calibrating: nothing was searched for, so the verdict is open"
        decision = Decision(Verdict.UNKNOWN, search.fit, (note,), Unknown(None, (), note))
        return stop.baseline, search, decision, False
    search = stepwise.begin(base)
    complete = True
    try:
        with checkpoints(asked):
            stepwise.run(search, progress)
            decision = decide(search, COARSE, progress)
    except KeyboardInterrupt:
        complete = False
        note = "interrupted while searching: what is named was found until then"
        verdict = Verdict.EFFECT if search.effects else Verdict.UNKNOWN
        if search.excess_base.significance < _NOTHING:
            verdict = Verdict.NONE
        unknown = Unknown(None, (), note) if verdict is Verdict.UNKNOWN else None
        decision = Decision(verdict, search.fit, (note,), unknown)
    return base, search, decision, complete


run_diagnosis = diagnose


__all__ = ["Calibration", "Unknown", "calibrate", "diagnose", "run_diagnosis"]
