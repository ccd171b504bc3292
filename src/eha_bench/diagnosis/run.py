"""`diagnose` and `calibrate`: the whole way from a dataset to a verdict and a revised model."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.interruption import Interruption, checkpoints
from eha_bench.core.result import write_text
from eha_bench.diagnosis import search as searching
from eha_bench.diagnosis.baseline import (
    COARSE,
    FRICTION_AT_REST,
    Baseline,
    CalibrationInterrupted,
    calibrated,
    no_progress,
)
from eha_bench.diagnosis.candidates import LEARNED
from eha_bench.diagnosis.dataset import Dataset, load_dataset
from eha_bench.diagnosis.decide import Decision, decide
from eha_bench.diagnosis.diagnosis import (
    SCHEMA_VERSION,
    Diagnosis,
    FoundEffect,
    RankLine,
    Unknown,
    Verdict,
    errors_to_dict,
    estimate_to_dict,
)
from eha_bench.diagnosis.errors_by_channel import (
    ChannelError,
    floors,
    replay_errors,
    replay_notes,
)
from eha_bench.diagnosis.evidence import groups_of
from eha_bench.diagnosis.fit import Fit, jacobian
from eha_bench.diagnosis.replay import replay
from eha_bench.diagnosis.revise import revised
from eha_bench.diagnosis.scoring import scored
from eha_bench.diagnosis.search import Search
from eha_bench.diagnosis.uncertainty import Estimate, estimates, undetermined
from eha_bench.plants.effect import Effect
from eha_bench.plants.model import Model

FloatArray = NDArray[np.float64]
Progress = Callable[[str, float], None]

_NOTHING = 5.0


@dataclass(frozen=True)
class Calibration:
    """Parameters under `calibrate`, estimated on all training runs.

    Attributes:
        model: with the estimates. parameters: with 95 % intervals, SI.
        undetermined: directions that the data do not determine, in words.
        train: channel -> errors (before: declared; after: calibrated).
        notes: what the data gate found.
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

    Ctrl-C ends the fit and keeps what was found until then (`complete` is False).

    Args:
        dataset: dataset.yaml, or as loaded.
        out: folder that gets calibration.json and calibrated.yaml.
        progress: called with the stage and the fraction of it done.

    Raises:
        InputError: a file is wrong or missing, or nothing can be compared.
    """
    loaded = dataset if isinstance(dataset, Dataset) else load_dataset(Path(dataset))
    complete = True
    with Interruption() as asked:
        try:
            with checkpoints(asked):
                base = calibrated(loaded, progress)
        except CalibrationInterrupted as stop:
            base, complete = stop.baseline, False
        model = revised(loaded.model, base.fit.vector, base.keys)
        noise = base.problem.noise
        replays = replay(
            base.measured, [loaded.model, model], noise, lambda done: progress("replay", done)
        )
        errors = replay_errors(replays, floors(noise), places=(0, 0, 1))
    notes = base.notes if complete else (*base.notes, "interrupted before the fit had ended")
    found = Calibration(
        model,
        estimates(base.fit, groups_of(base.problem), _units(loaded.model)),
        undetermined(base.fit),
        errors,
        (*notes, *replay_notes(replays, errors)),
        complete,
    )
    if out is not None:
        found.write(Path(out))
    return found


def diagnose(
    dataset: Dataset | str | Path, out: str | Path | None = None, progress: Progress = no_progress
) -> Diagnosis:
    """Close the loop: residual, cause, revised model, errors before and after.

    Runs for holdout are read only when everything is decided. Ctrl-C ends the search and keeps what
    was found until then (`complete` is False); pressed again it leaves the errors out.

    Args:
        dataset: dataset.yaml, or as loaded.
        out: folder that gets diagnosis.json, revised.yaml and recalibrated.yaml.
        progress: called with the stage and the fraction of it done.

    Raises:
        InputError: a file is wrong or missing, or nothing can be compared.
    """
    started = time.perf_counter()
    loaded = dataset if isinstance(dataset, Dataset) else load_dataset(Path(dataset))
    with Interruption() as asked:
        base, search, decision = _searched(loaded, asked, progress)
        found = _assemble(loaded, base, search, decision)
        vectors = (search.base.vector, decision.fit.vector)
        try:
            found = scored(found, loaded, base, vectors, progress)
        except KeyboardInterrupt:
            found = replace(found, notes=(*found.notes, "interrupted before the runs were scored"))
    found = replace(found, complete=not asked(), seconds=time.perf_counter() - started)
    if out is not None:
        found.write(Path(out))
    progress("done", 1.0)
    return found


def _searched(
    dataset: Dataset, asked: Interruption, progress: Progress
) -> tuple[Baseline, Search, Decision]:
    """Calibrate, search and decide; where a stop is asked for, as far as that went."""
    try:
        with checkpoints(asked):
            base = calibrated(dataset, progress)
    except CalibrationInterrupted as stop:
        search = searching.begin(stop.baseline)
        note = "interrupted while calibrating: nothing was searched for, so the verdict is open"
        return stop.baseline, search, Decision(Verdict.UNKNOWN, search.fit, (note,), None)
    search = searching.begin(base)
    try:
        with checkpoints(asked):
            searching.run(search, progress)
            decision = decide(search, COARSE, progress)
    except KeyboardInterrupt:
        note = "interrupted while searching: what is named was found until then"
        verdict = Verdict.EFFECT if search.effects else Verdict.UNKNOWN
        if search.excess_base.significance < _NOTHING:
            verdict = Verdict.NONE
        decision = Decision(verdict, search.fit, (note,), None)
    return base, search, decision


run_diagnosis = diagnose


def _units(model: Model) -> dict[str, str]:
    return {key: parameter.unit for key, parameter in model.plant.layout.items()}


def _assemble(dataset: Dataset, base: Baseline, search: Search, decision: Decision) -> Diagnosis:
    model = dataset.model
    layout = model.plant.layout
    fit = _fresh(search, decision)
    added = [item.start.candidate for item in search.effects]
    if decision.unknown is not None and decision.learned:
        added.append(LEARNED)
    mundane = [item.start.keys[0] for item in search.accepted if item.start.mundane]
    keys = [*base.keys, *mundane]
    values = estimates(fit, search.groups, _units(model))
    effects = []
    for item in search.effects:
        effect = layout.effect(item.start.candidate)
        at = {p.name: layout.index[f"{effect.id}.{p.name}"] for p in effect.parameters}
        numbers = {p.name: float(fit.vector[at[p.name]]) for p in effect.parameters if p.size == 1}
        effects.append(
            FoundEffect(
                effect.id,
                str(effect.equation(layout.plant, numbers).value),
                _numbers(effect, item.start.keys, values, numbers),
                {p.name: str(p.decode(numbers[p.name])) for p in effect.parameters if p.choices},
                item.comparison.share_out,
                item.comparison.p_value,
            )
        )
    effects.sort(key=lambda item: -_share(search, item.id))
    groups = tuple(
        (item.start.candidate, *item.equivalent) for item in search.effects if item.equivalent
    )
    separate = {
        name: layout.effect(name).separate for name in {n for group in groups for n in group}
    }
    notes = list(base.notes)
    for key in base.nuisance:
        if fit.vector[layout.index[key]] == 0.0:
            continue
        text = f"friction at rest was estimated: {key} = {fit.vector[layout.index[key]]:.3g}"
        notes.append(f"{text} {layout.by_key[key].unit}")
    for key in mundane:
        notes.append(
            f"{key} is only assumed in the model; the data ask for "
            f"{fit.vector[layout.index[key]]:.4g} {layout.by_key[key].unit}"
        )
    notes += decision.notes
    return Diagnosis(
        decision.verdict,
        revised(model, fit.vector, keys, added),
        revised(model, search.base.vector, base.keys),
        tuple(effects) if decision.verdict is not Verdict.NONE else (),
        decision.unknown,
        groups,
        dict(sorted(separate.items())),
        _ranking(search),
        {},
        {},
        {key: item for key, item in values.items() if "." not in key},
        undetermined(fit),
        tuple(notes),
    )


def _fresh(search: Search, decision: Decision) -> Fit:
    """Return the fit with a Jacobian computed anew: intervals are no place for one updated."""
    fit = decision.fit
    if decision.learned:
        return fit
    layout = search.problem.plant.layout
    sticks = {key for key in FRICTION_AT_REST if key in layout.index
              and fit.vector[layout.index[key]] == 0.0}  # fmt: skip
    free = tuple(item for item in fit.free if item.key not in sticks)
    residual = search.problem.residual(fit.vector)
    matrix = jacobian(search.problem, fit.vector, free, residual)
    return replace(fit, free=free, residual=residual, jacobian=matrix)


def _numbers(
    effect: Effect, keys: tuple[str, ...], values: dict[str, Estimate], numbers: dict[str, float]
) -> dict[str, Estimate]:
    """What was fitted, with its interval; a count that a scan found is exact."""
    found = {}
    for parameter in effect.parameters:
        key = f"{effect.id}.{parameter.name}"
        if key in keys and key in values:
            found[parameter.name] = values[key]
        elif parameter.name == "count":
            number = numbers[parameter.name]
            found[parameter.name] = Estimate(number, number, number, parameter.unit)
    return found


def _share(search: Search, name: str) -> float:
    """How much an effect explains: the gain when it was added."""
    return next(i.comparison.gain for i in search.effects if i.start.candidate == name)


def _ranking(search: Search) -> tuple[RankLine, ...]:
    lines = []
    size = max(1, search.problem.size)
    chosen = {item.start.candidate for item in search.accepted}
    same = {name for item in search.accepted for name in item.equivalent}
    for item in search.ranking:
        if item.candidate in chosen:
            reason = "added"
        elif item.candidate in same:
            reason = "fits as well as what was added"
        elif not item.refitted:
            reason = f"predicted to explain {item.score:.1%} of the excess; not refitted"
        else:
            reason = f"refitted, it explains {item.score:.1%} of the excess on runs left out"
        error = float(np.sqrt(max(item.cost, 0.0) / size))
        lines.append(RankLine(item.candidate, item.score, item.p_value, error, reason))
    order = {name: k for k, name in enumerate(i.start.candidate for i in search.accepted)}
    return tuple(sorted(lines, key=lambda line: (order.get(line.id, 99), line.error_after)))


__all__ = ["Calibration", "Unknown", "calibrate", "diagnose", "run_diagnosis"]
