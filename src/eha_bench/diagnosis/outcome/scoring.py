"""Scores a diagnosis: every run replayed freely by the declared, recalibrated and revised model.

Runs for holdout are read here, for the first time, when everything is decided.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.errors import EhaBenchError
from eha_bench.diagnosis.data.dataset import Dataset, Use
from eha_bench.diagnosis.data.gate import Measured, admit
from eha_bench.diagnosis.data.quiet import coloured_like
from eha_bench.diagnosis.data.windows import cut
from eha_bench.diagnosis.fit.baseline import STEP, Baseline, thinned
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.start_angles import angles_of, counts_on, estimated, said, starts_of
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis
from eha_bench.diagnosis.replay.errors_by_channel import (
    ChannelError,
    floors,
    replay_errors,
    replay_notes,
    rms_by_channel,
)
from eha_bench.diagnosis.replay.replay import replay

FloatArray = NDArray[np.float64]
Progress = Callable[[str, float], None]


def scored(
    found: Diagnosis,
    dataset: Dataset,
    base: Baseline,
    vectors: tuple[FloatArray, FloatArray],
    progress: Progress,
) -> Diagnosis:
    """Return a diagnosis with its replays and errors on training and on held-out runs.

    Args:
        found: what was decided. dataset: all runs. base: what it was fitted on.
        vectors: parameters of the recalibrated and of the revised model.
        progress: called with the stage and the fraction of it done.
    """
    noise = base.problem.noise
    held_out, notes = _read(dataset)
    held_out = [coloured_like(item, base.measured) for item in held_out]
    begun = starts_of(base.problem)
    if begun and counts_on(dataset.model.plant.layout, vectors[-1]):
        seen = angles_of(base.problem)
        for item in (*base.measured, *held_out):
            alone = None if item.run.name in seen else _windows_of(dataset, [item], noise)
            if alone is not None:
                begun |= estimated(alone, vectors[-1])
        base = base.begun(begun)
        held_out = [item.begun(begun) for item in held_out]
        notes.append(said(begun))
    models = (dataset.model, found.recalibrated, found.revised)
    runs = (*base.measured, *held_out)
    replays = replay(runs, models, noise, lambda done: progress("replay", done))
    errors: list[dict[str, ChannelError]] = []
    for use, problem in (
        (Use.TRAIN, base.problem),
        (Use.HOLDOUT, _windows_of(dataset, held_out, noise)),
    ):
        own = [item for item in replays if item.use is use]
        before, after = ({}, {}) if problem is None else (
            rms_by_channel(problem, vector) for vector in vectors
        )  # fmt: skip
        errors.append(replay_errors(own, floors(noise), (before, after)))
        notes += replay_notes(own, errors[-1])
    return replace(
        found,
        train=errors[0],
        holdout=errors[1],
        replays=replays,
        notes=(*found.notes, *dict.fromkeys(notes)),
    )


def _read(dataset: Dataset) -> tuple[list[Measured], list[str]]:
    """Read the held-out runs; one that cannot be read costs its score, not the diagnosis."""
    found, notes = [], []
    compared = dataset.model.plant.determined(dataset.inputs)
    for run in dataset.holdout:
        try:
            recording = run.read()
            found.append(admit(run, recording, dataset.inputs, compared, strict=False))
        except EhaBenchError as error:
            notes.append(f"held-out run {run.name} is not scored: {error}")
    return found, notes


def _windows_of(dataset: Dataset, runs: list[Measured], noise: dict[str, float]) -> Problem | None:
    windows = [window for item in runs if item.outputs for window in cut(item, noise)]
    return Problem(dataset.model.plant, thinned(windows), noise, STEP) if windows else None
