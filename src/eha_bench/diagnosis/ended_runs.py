"""Calibrates on training runs up to where their delay jumps.

What follows a jump of a run's delay (`delay_jump`) tells of a bus or a clock. Fitted, it hides what
is missing elsewhere: eight seconds of 540 were a quarter of the cost of a servo's calibration, and
friction then explained a tenth of it where it explains half. A calibration that such seconds bend
(80 ms late at 2 Hz: a torque constant of a twelfth) no longer shows when they begin; the model as
declared does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from eha_bench.core.progress import ProgressHook
from eha_bench.diagnosis.corrected_map import with_corrected_map
from eha_bench.diagnosis.data.dataset import Dataset
from eha_bench.diagnosis.data.pauses import parted_at_pauses
from eha_bench.diagnosis.fit.baseline import (
    Baseline,
    CalibrationInterrupted,
    calibrated_baseline,
    no_progress,
)
from eha_bench.diagnosis.fit.evidence import SOFT_MEAN
from eha_bench.diagnosis.late_topics import with_late_topics
from eha_bench.diagnosis.outcome.revise import revised_model
from eha_bench.diagnosis.replay.delay_jump import delay_jump, jump_note
from eha_bench.diagnosis.replay.replay import rough_replay

_LOUD: Final = 1.5
"""Cost over that of the noise from which a jump may be hidden in it."""


def baseline_up_to_jumps(dataset: Dataset, progress: ProgressHook = no_progress) -> Baseline:
    """Calibrate; where the delay of a training run jumps, once more with that run up to there.

    The parts of a training log that pauses are runs of their own, topics that are plainly stamped
    late are read earlier, and channels whose map is plainly mistaken are read the other way.

    Raises:
        InputError: nothing to calibrate with.
        CalibrationInterrupted: Ctrl-C once the data were read.
    """
    dataset = _parted(dataset)
    base = calibrated_baseline(dataset, progress)
    base = with_late_topics(base, progress, loud=_is_loud(base))
    if not _is_loud(base):
        return base
    base = with_corrected_map(base, progress)
    if not _is_loud(base):
        return base
    try:
        ends, notes = _ends(base)
    except KeyboardInterrupt as stop:
        raise CalibrationInterrupted(base) from stop
    if not ends:
        return base
    runs = tuple(replace(run, until=ends.get(run.name, run.until)) for run in base.dataset.runs)
    again = calibrated_baseline(replace(base.dataset, runs=runs), progress)
    return replace(again, notes=(*again.notes, *notes))


def _is_loud(base: Baseline) -> bool:
    """Whether a calibration leaves more than noise in which something may be hidden."""
    return base.fit.cost >= _LOUD * SOFT_MEAN * base.problem.size


def _parted(dataset: Dataset) -> Dataset:
    """Return a dataset whose training runs end where their logs pause."""
    held_out = dataset.held_out
    training = parted_at_pauses(dataset.training, [run.name for run in held_out])
    if training == dataset.training:
        return dataset
    return replace(dataset, runs=(*training, *held_out))


def _ends(base: Baseline) -> tuple[Mapping[str, float], tuple[str, ...]]:
    """Return training runs whose delay jumps with the time of the jump, and a sentence on each."""
    ends, notes = {}, []
    places, noise, vector = base.problem.places, base.problem.noise, base.fit.vector
    models = (base.dataset.model, revised_model(base.dataset.model, vector, base.keys))
    own, late = places.values(vector), places.lateness(vector)
    for measured in base.measured:
        if not measured.outputs:
            continue
        item = rough_replay(measured, models, own, late)
        if (jump := delay_jump(item, noise)) is not None:
            ends[item.run] = jump.time
            notes.append(jump_note(item, jump, "it is fitted"))
    return ends, tuple(notes)
