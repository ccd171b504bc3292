"""Calibrates with channels read otherwise than their map says, where that explains the error.

A sign, or two columns for one another, is the commonest mistake of a new log, and no parameter
takes it up: a valve cylinder whose position counted the other way was 154 times its noise off, with
four parameters at their bounds. A suspected channel (`channel_mistakes`) is read the other way, and
everything is calibrated anew: the mistake is one where most of the error goes with it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from eha_bench.core.progress import ProgressHook
from eha_bench.diagnosis.fit.baseline import (
    Baseline,
    CalibrationInterrupted,
    calibrated_baseline,
)
from eha_bench.diagnosis.fit.channel_mistakes import Suspect, suspects

_LEFT: Final = 0.1
"""Most of the mean square error that may be left without a mistake."""
_AS_GOOD: Final = 1.5
"""Error over that of the best correction up to which another does as well."""


def with_corrected_map(base: Baseline, progress: ProgressHook) -> Baseline:
    """Return a calibration with mistaken channels corrected, or the same where none is.

    Args:
        base: a calibration whose error is far above the noise.
        progress: called with the stage and the fraction of it done.

    Raises:
        CalibrationInterrupted: Ctrl-C; with the calibration as it was.
    """
    try:
        found = [_calibrated(base, item, progress) for item in suspects(base)]
    except (CalibrationInterrupted, KeyboardInterrupt) as stop:
        raise CalibrationInterrupted(base) from stop
    helping = [item for item in found if item[2] < _LEFT]
    if not helping:
        return base
    least = min(left for _, _, left in helping)
    as_good = [item for item in helping if item[2] <= _AS_GOOD * least]
    as_good.sort(key=lambda item: len(item[0].correction.channels))
    (suspect, other, left), *others = as_good
    note = suspect.correction.note(1.0 / math.sqrt(left), suspect.where(base.dataset))
    if others:
        names = " or ".join(f"'{', '.join(item.correction.channels)}'" for item, _, _ in others)
        note += f"; {names} read the other way would do as well"
    dataset = replace(other.dataset, notes=(*other.dataset.notes, note))
    return replace(other, dataset=dataset, notes=(note, *other.notes))


def _calibrated(
    base: Baseline, suspect: Suspect, progress: ProgressHook
) -> tuple[Suspect, Baseline, float]:
    """Return a suspect, the calibration without the mistake, and the share of the error left."""
    other = calibrated_baseline(suspect.corrects(base.dataset), progress)
    before, after = _errors(base), _errors(other)
    noise = base.problem.noise
    shared = before.keys() & after.keys()
    left = sum(after[name] / noise[name] ** 2 for name in shared)
    return suspect, other, left / sum(before[name] / noise[name] ** 2 for name in shared)


def _errors(base: Baseline) -> Mapping[str, float]:
    """Return each channel's mean square error over all windows, SI squared."""
    problem = base.problem
    residual = problem.in_readings(base.fit.residual)
    names = problem.plant.outputs
    squares: dict[str, list[float]] = {}
    for piece in problem.pieces:
        rows = residual[piece.rows]
        for channel, mask in piece.by_channel():
            name = names[channel]
            squares.setdefault(name, []).extend((rows[mask] * problem.noise[name]) ** 2)
    return {name: float(np.mean(own)) for name, own in squares.items()}
