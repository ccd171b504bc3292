"""Whether a recording's reference is plainly another one than its trial asks for.

Where a trial lies in a log is found by the shape of its signal, and metrics take the levels that
were really commanded: a step of 5 MPa is scored as one of 10 MPa, and may keep all of its limits.
So the levels between which nearly all samples lie are compared. Levels are what a drifting clock, a
setpoint that is limited in its rate, and single samples that are wrong leave as they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.common_units import COMMON
from eha_bench.core.recording import Recording
from eha_bench.core.signal import FromRecording
from eha_bench.core.trial import Trial
from eha_bench.metrics.metric import NotScored
from eha_bench.metrics.window import timeline

_SAME = 0.05
"""Share of a signal's span by which its levels may be missed: what `window` takes for one level."""
_ENDS = (0.05, 0.95)
"""Shares of the samples below a level: single ones do not count."""
_ABOUT = 0.03
"""Shares that differ by as much are the same: an edge comes at another sample."""
_FLICKER = 0.01
"""Share of a level by which it may be off where it is all that there is."""
_FEWEST = 8
_SHOWN = {"Pa": "MPa", "rad": "deg", "m": "mm"}
"""Units of people, for units of ours."""


@dataclass(frozen=True)
class ReferenceLevels:
    """Levels between which a reference lies, SI.

    Attributes:
        low, high: levels below which few and nearly all samples are, each from one to another, as
            an edge may come at another sample. ends: least and largest value. unit: SI.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    ends: tuple[float, float]
    unit: str

    @staticmethod
    def of(recording: Recording) -> ReferenceLevels | None:
        """Return the levels of a recording's reference, None where it has none."""
        values = recording.values.get("reference")
        if values is None or np.count_nonzero(good := np.isfinite(values)) < _FEWEST:
            return None
        low, high = (np.quantile(values[good], [share - _ABOUT, share + _ABOUT]) for share in _ENDS)
        return ReferenceLevels(
            (float(low[0]), float(low[1])),
            (float(high[0]), float(high[1])),
            _ends(values[good]),
            recording.unit("reference"),
        )

    def differ_from(self, other: ReferenceLevels) -> bool:
        """Whether they are plainly others: two such recordings are no repeats of one trial."""
        span = max(one.high[1] - one.low[0] for one in (self, other))
        level = max(abs(end) for one in (self, other) for end in one.ends)
        # what flickers about one level has hardly a span of its own
        slack = max(_SAME * span, _FLICKER * level)
        pairs = ((self.low, other.low), (self.high, other.high))
        return any(max(own[0], its[0]) - min(own[1], its[1]) > slack for own, its in pairs)

    def __str__(self) -> str:
        """Say all of it in a unit of people."""
        return _between(self.ends, self.unit)


@dataclass(frozen=True)
class OtherReference:
    """Levels of a recorded reference, and those that its trial asks for, each low and high, SI."""

    recorded: tuple[float, float]
    asked: tuple[float, float]
    unit: str

    def __str__(self) -> str:
        """Say both, as a clause."""
        recorded, asked = (_between(item, self.unit) for item in (self.recorded, self.asked))
        return f"its reference goes {recorded}, and the trial asks for {asked}"


def other_reference(recording: Recording, trial: Trial) -> OtherReference | None:
    """Return the levels of both, where they are plainly others; None where they agree.

    A log without a reference, or in which the trial is not found, says nothing; its scores do.
    """
    if isinstance(trial.signal, FromRecording):
        return None
    found = _levels(recording, trial)
    if found is None:
        return None
    recorded, asked = found
    if _same(recorded, asked):
        return None
    unit = recording.unit("reference") or trial.mode.unit
    return OtherReference(_ends(recorded), _ends(asked), unit)


def is_of_trial(recording: Recording, trial: Trial) -> bool:
    """Whether a recording's reference is the one that a trial asks for, by its levels."""
    unit, asked = recording.unit("reference"), trial.mode.unit
    if isinstance(trial.signal, FromRecording) or (unit and asked and unit != asked):
        return False
    found = _levels(recording, trial)
    return found is not None and _same(*found)


def _levels(recording: Recording, trial: Trial) -> tuple[FloatArray, FloatArray] | None:
    """Return what was asked for by a recording, and by its trial at the same times; None for none.

    A trial that is not found in it asks for nothing.
    """
    if "reference" not in recording.values:
        return None
    try:
        line = timeline(recording, trial)
    except NotScored:
        return None
    within = line.between(0.0, trial.duration)
    time, reference = line.time[within], line.reference[within]
    good = np.isfinite(reference)
    if np.count_nonzero(good) < _FEWEST:
        return None
    return reference[good], trial.signal(time[good])


def _same(recorded: FloatArray, asked: FloatArray) -> bool:
    span = float(np.ptp(asked)) or float(np.abs(asked).max())
    return all(_agree(recorded, asked, share, _SAME * span) for share in _ENDS)


def _agree(recorded: FloatArray, asked: FloatArray, share: float, slack: float) -> bool:
    """Whether the recorded level of a share of the samples is the one that is asked for."""
    level = float(np.quantile(recorded, share))
    low, high = np.quantile(asked, [share - _ABOUT, share + _ABOUT])
    return bool(low - slack <= level <= high + slack)


def _ends(values: FloatArray) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def _between(ends: tuple[float, float], unit: str) -> str:
    """Write levels in a unit of people."""
    shown = _SHOWN.get(unit, unit)
    _, factor, _ = COMMON.get(shown, (unit, 1.0, 0.0)) if shown != unit else (unit, 1.0, 0.0)
    low, high = (f"{value / factor:.4g}" for value in ends)
    return f"{low} {shown}".rstrip() if low == high else f"{low} to {high} {shown}".rstrip()
