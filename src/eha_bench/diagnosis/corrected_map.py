"""Calibrates with channels read otherwise than their map says, where that explains the error.

A sign, or two columns for one another, is the commonest mistake of a new log, and no parameter
takes it up: a valve cylinder whose position counted the other way was 154 times its noise off, with
four parameters at their bounds. A suspected channel (`channel_mistakes`) is read the other way, and
everything is calibrated anew: the mistake is one where most of the error goes with it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Final, NamedTuple

from eha_bench.core.errors import InputError
from eha_bench.core.progress import ProgressHook
from eha_bench.diagnosis.fit.baseline import (
    Baseline,
    CalibrationInterrupted,
    calibrated_baseline,
)
from eha_bench.diagnosis.fit.channel_mistakes import Suspect, suspects

_LEFT: Final = 0.1
"""Largest share of the mean square error that a correction leaves."""
_AS_GOOD: Final = 1.5
"""Mean square error over that of the best correction up to which another does as well."""
_WORSE: Final = 2.0
"""Mean square error of a channel over what it was, from which a correction spoils it."""


class _Corrected(NamedTuple):
    """A correction, the calibration with it, and the share of the mean square error it leaves."""

    suspect: Suspect
    base: Baseline
    left: float


def with_corrected_map(base: Baseline, progress: ProgressHook) -> Baseline:
    """Return a calibration with mistaken channels corrected, or the same where none is.

    Args:
        base: a calibration whose error is far above the noise.
        progress: called with the stage and the fraction of it done.

    Raises:
        CalibrationInterrupted: Ctrl-C; with the best calibration so far.
    """
    found: list[_Corrected] = []
    try:
        for suspect in suspects(base):
            # a reading that cannot be fitted is no better one
            with suppress(InputError):
                other = calibrated_baseline(suspect.corrects(base.dataset), progress)
                found.append(_Corrected(suspect, other, _left(base, other)))
    except KeyboardInterrupt as stop:
        raise CalibrationInterrupted(_best(base, found)) from stop
    return _best(base, found)


def _best(base: Baseline, found: Sequence[_Corrected]) -> Baseline:
    """Return the calibration of the correction that explains the error, or as it was."""
    helping = [item for item in found if item.left < _LEFT]
    if not helping:
        return base
    least = min(item.left for item in helping)
    as_good = [item for item in helping if item.left <= _AS_GOOD * least]
    as_good.sort(key=lambda item: (len(item.suspect.correction.channels), item.left))
    best, *others = as_good
    note = best.suspect.correction.note(1.0 / math.sqrt(best.left), best.suspect.where)
    words = dict.fromkeys(item.suspect.correction.words for item in others)
    words.pop(best.suspect.correction.words, None)  # in other maps
    if words:
        note += f"; {' or '.join(words)} would do as well"
    return best.base.noting_its_map(note)


def _left(base: Baseline, other: Baseline) -> float:
    """Return the share of the mean square error that another calibration leaves.

    All of it where it loses a channel or a run, or spoils a channel.
    """
    before, after = _errors(base), _errors(other)
    noise = base.problem.noise
    if not before or not before.keys() <= after.keys() or len(other.left_out) > len(base.left_out):
        return 1.0
    if any(after[name] > _WORSE * before[name] + noise[name] ** 2 for name in before):
        return 1.0
    return sum(after[name] / noise[name] ** 2 for name in before) / sum(
        before[name] / noise[name] ** 2 for name in before
    )


def _errors(base: Baseline) -> Mapping[str, float]:
    """Return each channel's mean square error over all windows, SI squared."""
    problem = base.problem
    return problem.mean_squares(problem.in_readings(base.fit.residual) * problem.scale)
