"""Scores a diagnosis: every run replayed freely by the declared, recalibrated and revised model.

Runs for holdout are read here, for the first time, when everything is decided.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import EhaBenchError
from eha_bench.core.progress import ProgressHook
from eha_bench.diagnosis.data.command_lead import led_like
from eha_bench.diagnosis.data.dataset import Dataset, Use
from eha_bench.diagnosis.data.gate import admit, restful_channels
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.onset import topics_from_onset
from eha_bench.diagnosis.data.pauses import parted_at_pauses
from eha_bench.diagnosis.data.quiet import coloured_like
from eha_bench.diagnosis.data.stamps import scattered_like
from eha_bench.diagnosis.data.ticks import on_ticks
from eha_bench.diagnosis.data.windows import cut_windows
from eha_bench.diagnosis.fit.baseline import STEP, Baseline
from eha_bench.diagnosis.fit.chosen_windows import thinned_windows
from eha_bench.diagnosis.fit.finish import fine_enough
from eha_bench.diagnosis.fit.first_part import first_part
from eha_bench.diagnosis.fit.own_parameters import OwnValues, like_clocks
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.start_angles import (
    angles_note,
    angles_of,
    counts_on,
    estimated_angles,
    own_angles,
    starts_of,
)
from eha_bench.diagnosis.fit.steady_windows import cut_alike, steady_problem
from eha_bench.diagnosis.fit.uncertainty import Estimate
from eha_bench.diagnosis.outcome.covered_ranges import covered_ranges
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis
from eha_bench.diagnosis.outcome.rival import Rival
from eha_bench.diagnosis.replay.delay_jump import ended_at_jumps
from eha_bench.diagnosis.replay.error_by_value import ErrorByValue, beyond_notes, errors_by_value
from eha_bench.diagnosis.replay.errors_by_channel import (
    ChannelError,
    bent_notes,
    floors,
    replay_errors,
    replay_notes,
    rms_by_channel,
    spoiled_notes,
)
from eha_bench.diagnosis.replay.replay import Replay, replay, rough_replay
from eha_bench.plants.model import Model
from eha_bench.posterior.covered import Covered
from eha_bench.posterior.posterior import Component

_KINDS = {Use.TRAIN: "training", Use.HOLDOUT: "held-out", Use.UNSEEN: "unseen"}


@dataclass(frozen=True)
class Scores:
    """Errors of three models on all runs.

    Attributes:
        errors: channel -> errors, by the runs' use. replays: what they are computed from.
        per_run: held-out run -> parameter of that run alone -> estimate by its first part.
        covered: where the training recordings have been. notes: one sentence each.
        by_value: errors of the last model by the value of each channel.
    """

    errors: Mapping[Use, Mapping[str, ChannelError]]
    replays: tuple[Replay, ...]
    per_run: Mapping[str, Mapping[str, Estimate]]
    covered: Covered
    notes: tuple[str, ...]
    by_value: tuple[ErrorByValue, ...]

    def fields(
        self, per_run: Mapping[str, Mapping[str, Estimate]], notes: Sequence[str]
    ) -> dict[str, Any]:
        """Return fields of a diagnosis or calibration; `per_run` and `notes` are what it has."""
        return {
            "train": self.errors[Use.TRAIN],
            "holdout": self.errors[Use.HOLDOUT],
            "unseen": self.errors[Use.UNSEEN],
            "covered": self.covered,
            "error_by_value": self.by_value,
            "per_run": {**per_run, **self.per_run},
            "notes": (*notes, *self.notes),
        }


def with_replay_errors(
    found: Diagnosis,
    dataset: Dataset,
    base: Baseline,
    recalibrated: FloatArray | None,
    progress: ProgressHook,
) -> Diagnosis:
    """Return a diagnosis with its replays and errors on training and on held-out runs.

    Args:
        found: what was decided. dataset: all runs. base: what it was fitted on.
        recalibrated: parameters of the recalibrated model, with the runs' own parameters; None
            where nothing was added to it.
        progress: called with the stage and the fraction of it done.
    """
    places = base.problem.places
    own = {run: {key: item.value for key, item in it.items()} for run, it in found.per_run.items()}
    late = places.beyond_reading({name: item.value for name, item in found.lateness.items()})
    revised = places.with_lateness(places.with_values(found.revised.vector(), own), late)
    before = revised if recalibrated is None else places.with_values(recalibrated, {})
    vectors = (before, revised)
    models = (dataset.model, found.recalibrated, found.revised)
    scores = scores_of(dataset, base, models, vectors, progress)
    fields = scores.fields(found.per_run, found.notes)
    return replace(found, replays=scores.replays, **fields)


def scores_of(
    dataset: Dataset,
    base: Baseline,
    models: tuple[Model, Model, Model],
    vectors: tuple[FloatArray, FloatArray],
    progress: ProgressHook,
) -> Scores:
    """Replay all runs by three models; held-out ones are read here.

    Args:
        dataset: all runs. base: what was fitted. models: declared, before, after.
        vectors: parameters of the last two, with the training runs' own parameters.
        progress: called with the stage and the fraction of it done.
    """
    noise = base.problem.noise
    held_out, notes = _read(dataset, base.measured)
    starts = starts_of(base.problem)
    if counts_on(dataset.model.plant.layout, vectors[-1]):
        seen = angles_of(base.problem) if starts else {}
        # where training runs begin alike, one that clearly does not is another one: as `predict`
        angles = estimated_angles if starts else own_angles
        # under another load a run's angle does not show
        loaded = [item.knowing(first_part(item, models[-1], noise).values) for item in held_out]
        for item in (*base.measured, *loaded):
            alone = None if item.run.name in seen else _windows_of(dataset, [item], noise)
            if alone is not None:
                starts |= angles(alone, vectors[-1])
        base = base.at_angles(starts)
        held_out = [item.at_angles(starts) for item in held_out]
        if starts:
            notes.append(angles_note(starts))
    parts = [[first_part(item, model, noise) for item in held_out] for model in models[1:]]
    trained = [base.problem.places.values(vector) for vector in vectors]
    own: tuple[OwnValues, ...] = (
        {},
        *({**known, **{item.run: item.values for item in part}}
          for known, part in zip(trained, parts, strict=True)),
    )  # fmt: skip
    notes += [note for item in parts[-1] for note in item.notes()]
    runs = (*base.measured, *held_out)
    late = [base.problem.places.lateness(vector) for vector in (vectors[0], *vectors)]
    replays = replay(runs, models, noise, lambda done: progress("replay", done), own, late)
    replays, jumps = ended_at_jumps(replays, noise)
    notes += jumps
    until = {item.run: item.until for item in replays}
    ended = [item.ended(until.get(item.run.name, math.inf)) for item in held_out]
    errors: dict[Use, dict[str, ChannelError]] = {}
    for use in Use:
        mine = [item for item in replays if item.use is use]
        before, after = _over_windows(dataset, base, use, ended, vectors, (own[1], own[2]))
        errors[use] = replay_errors(mine, floors(base.problem.floors), (before, after))
        notes += replay_notes(mine, errors[use], _KINDS[use])
        if use is not Use.TRAIN:
            notes += bent_notes(errors[use], _KINDS[use])
            notes += spoiled_notes(errors[use], _KINDS[use])
    per_run = {item.run: item.estimates for item in parts[-1] if item.estimates}
    covered = covered_ranges(base.measured, noise, errors[Use.TRAIN], dataset.source)
    notes += beyond_notes(replays, covered, noise)
    by_value = errors_by_value(replays, covered)
    return Scores(errors, replays, per_run, covered, tuple(dict.fromkeys(notes)), by_value)


def held_out_windows(dataset: Dataset, base: Baseline, model: Model) -> Problem | None:
    """Return the residuals of a model over windows of the held-out runs, None where they have none.

    Args:
        dataset: all runs. base: what was fitted. model: as fitted; a run's own parameters are
            estimated from its first part.
    """
    known = _held_out(dataset, base, model)
    problem = _windows_of(dataset, known, base.problem.noise)
    if problem is None or problem.size == 0:
        return None
    return _sure(problem, problem.places.lengthened(model.vector()))


def spread_of_replays(
    dataset: Dataset, base: Baseline, rival: Rival, late: Mapping[str, float]
) -> dict[str, float]:
    """Return what the fitted numbers, as uncertain as they are, change in whole held-out replays.

    The root mean square by channel, SI, over draws from the covariance C, to first order:
    S^2 = sum over k of mean((y(p + r_k) - y(p))^2), R = (r_1, r_2 ...), R R' = C (the law of
    propagation of uncertainty, JCGM 100:2008, 5.2).

    Args:
        dataset: all runs. base: what was fitted. rival: a model with its covariance.
        late: clock -> s by which its stamps are late.
    """
    fitted = Component(rival.id, rival.model, rival.covariance.parameters, rival.covariance.matrix)
    models = [rival.model, *fitted.one_deviation_off()]
    squares: dict[str, float] = {}
    counts: dict[str, int] = {}
    for run in _held_out(dataset, base, rival.model):
        replayed = rough_replay(run, models, {}, late)
        for name, column in replayed.measured.items():
            read = np.isfinite(column)
            at, *others = (values[name][read] for values in replayed.simulated)
            changed = sum(float(np.sum((other - at) ** 2)) for other in others)
            squares[name] = squares.get(name, 0.0) + changed
            counts[name] = counts.get(name, 0) + int(read.sum())
    return {name: math.sqrt(squares[name] / max(counts[name], 1)) for name in squares}


def _held_out(dataset: Dataset, base: Baseline, model: Model) -> list[Measured]:
    """Return the held-out runs, each with its own parameters as its first part tells them."""
    runs, _ = _read(dataset, base.measured)
    runs = [item for item in runs if item.run.use is Use.HOLDOUT]
    own = [first_part(item, model, base.problem.noise).values for item in runs]
    return [item.knowing(values) for item, values in zip(runs, own, strict=True)]


def _read(dataset: Dataset, fitted: Sequence[Measured]) -> tuple[list[Measured], list[str]]:
    """Read the held-out runs; one that cannot be read costs its score, not the diagnosis."""
    found, notes = [], []
    compared = dataset.model.plant.determined(dataset.inputs)
    columns = ((name, item.column(name)) for item in fitted for name in item.outputs)
    restful = restful_channels((name, column) for name, column in columns if column is not None)
    names = [run.name for run in dataset.training]
    for run in parted_at_pauses(dataset.held_out, names):
        try:
            topics = topics_from_onset(run, dataset.inputs, compared, dataset.model.plant.roles)
            recording = on_ticks(topics, dataset.inputs, compared, run.stamped_late)
            item = admit(
                run,
                recording,
                dataset.inputs,
                compared,
                strict=False,
                restful=restful,
                roles=dataset.model.plant.roles,
            )
            if not item.outputs:
                notes.append(
                    f"held-out run {run.name} is not scored: nothing that is compared changes in it"
                )
                continue
            item = led_like(scattered_like(coloured_like(item, fitted), fitted), fitted)
            found.append(like_clocks(item, fitted))
        except EhaBenchError as error:
            notes.append(f"held-out run {run.name} is not scored: {error}")
    return found, notes


def _over_windows(
    dataset: Dataset,
    base: Baseline,
    use: Use,
    held_out: list[Measured],
    vectors: tuple[FloatArray, FloatArray],
    own: tuple[OwnValues, OwnValues],
) -> tuple[dict[str, float], dict[str, float]]:
    """Return each channel's error over windows of the runs for one use, SI, by both models.

    Where a simulation by the last one is no longer sure its error says nothing of the model:
    held-out windows end there, as those of training do.
    """
    if use is Use.TRAIN:
        return _rms_at(base.problem, vectors[0]), _rms_at(base.problem, vectors[1])
    runs = [item for item in held_out if item.run.use is use]
    known = [[item.knowing(values.get(item.run.name, {})) for item in runs] for values in own]
    before, after = (_windows_of(dataset, items, base.problem.noise) for items in known)
    if before is None or after is None:
        return {}, {}
    after = _sure(after, vectors[1])
    before = cut_alike(before, after)
    return _rms_at(before, vectors[0]), rms_by_channel(after, vectors[1])


def _rms_at(problem: Problem, vector: FloatArray) -> dict[str, float]:
    problem.prepare(vector)
    return rms_by_channel(problem, vector)


def _sure(problem: Problem, vector: FloatArray) -> Problem:
    """Return a problem as far as its simulations are sure, at a step fine enough for them."""
    return fine_enough(steady_problem(problem, vector), vector)


def _windows_of(dataset: Dataset, runs: list[Measured], noise: dict[str, float]) -> Problem | None:
    windows = [window for item in runs if item.outputs for window in cut_windows(item, noise)]
    return Problem(dataset.model.plant, thinned_windows(windows), noise, STEP) if windows else None
