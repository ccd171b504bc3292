"""What a plot marks besides its curves: levels, settling bands, limits and what was measured.

Everything here is read from the trial, its scores and the levels that it was scored by.
"""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from eha_bench.core.limit import AcceptanceLimit
from eha_bench.core.result import TrialResult
from eha_bench.core.score import Score
from eha_bench.core.trial import Trial
from eha_bench.metrics.settling_time import BAND
from eha_bench.metrics.step_response import FINAL_SHARE
from eha_bench.report.engineering import limit_text, metric_label, quantity

_SHARE_AT: Final = {"delay_time": 0.5, "response_time": 0.95, "settling_time": 1.0}
_TIMES: Final = (*_SHARE_AT, "peak_time")
_LEVELS: Final = ("peak", "holding_current")


class Role(StrEnum):
    """What a mark tells; decides its colour."""

    LEVEL = "level"
    BAND = "band"
    LIMIT = "limit"
    SAFETY = "safety"
    MEASURED = "measured"
    UNSCORED = "unscored"


@dataclass(frozen=True)
class LevelLine:
    """A line at a value (SI) of a channel, from `start` to `stop` (s)."""

    channel: str
    value: float
    start: float
    stop: float
    role: Role
    label: str = ""


@dataclass(frozen=True)
class TimeLine:
    """A line at an instant (s); `channel` is the one it was scored on."""

    channel: str
    time: float
    role: Role
    label: str = ""


@dataclass(frozen=True)
class _Between(ABC):
    """From `low` to `high` (SI) on a channel, from `start` to `stop` (s)."""

    channel: str
    low: float
    high: float
    start: float
    stop: float
    role: Role
    label: str = ""


class ValueBand(_Between):
    """A range of values of a channel."""


class Tube(_Between):
    """Lines at two distances from what the reference asks."""


@dataclass(frozen=True)
class TimeBand:
    """A stretch of time (s) over every channel."""

    start: float
    stop: float
    role: Role
    label: str = ""


@dataclass(frozen=True)
class Point:
    """A measured point of a channel: time in s, value in SI."""

    channel: str
    time: float
    value: float
    label: str


Mark = LevelLine | TimeLine | ValueBand | TimeBand | Point | Tube


@dataclass(frozen=True)
class StepMark:
    """An edge of the reference and the levels around it.

    Attributes:
        time, until: from the edge to the end of its hold, s.
        initial, final: levels of the followed channel, SI: measured if `settled`, else commanded.
        asked: the level that the reference goes to, SI.
        settled: whether the response settled, so that there is a band to draw.
    """

    time: float
    until: float
    initial: float
    final: float
    asked: float
    settled: bool

    @property
    def size(self) -> float:
        """Signed height of the step, SI."""
        return self.final - self.initial

    @property
    def final_start(self) -> float:
        """Where the window begins that the final level is taken from, s."""
        return self.until - FINAL_SHARE * (self.until - self.time)


def marks_of(trial: Trial, run: TrialResult, steps: Sequence[StepMark]) -> tuple[Mark, ...]:
    """Return what to draw over a run's curves, backgrounds first."""
    found: list[Mark] = []
    if trial.settle > 0.0:
        found.append(TimeBand(-trial.settle, 0.0, Role.UNSCORED, "settling in, not scored"))
    found += [_settling_band(trial.channel, step) for step in steps if step.settled]
    for safety in trial.safety:
        for value in (safety.bounds.low, safety.bounds.high):
            if math.isfinite(value):
                found.append(_across(trial, safety.channel, value, Role.SAFETY, "safety limit"))
    for limit in trial.limits:
        found += _limit(trial, limit, steps)
    # Of several edges a score is the worst one's; the plot cannot know which.
    if len(steps) == 1:
        found += _score_marks(steps[0], run.scores, trial.channel)
    return tuple(dict.fromkeys(found))


def _across(trial: Trial, channel: str, value: float, role: Role, label: str) -> LevelLine:
    return LevelLine(channel, value, -trial.settle, trial.duration, role, label)


def _settling_band(channel: str, step: StepMark) -> ValueBand:
    half = BAND * abs(step.size)
    label = f"±{100 * BAND:.0f} % of the step"
    low, high = step.final - half, step.final + half
    return ValueBand(channel, low, high, step.time, step.until, Role.BAND, label)


def _limit(trial: Trial, limit: AcceptanceLimit, steps: Sequence[StepMark]) -> Iterator[Mark]:
    label = f"{metric_label(limit.metric)} {limit_text(limit.text)}"
    low, high = limit.bounds.low, limit.bounds.high
    # The upper side carries the label; of a limit with one side, that one.
    sides = [(high, label)] if math.isfinite(high) else []
    if math.isfinite(low):
        sides.append((low, "" if sides else label))
    if limit.metric in _LEVELS:
        for side, text in sides:
            yield _across(trial, limit.channel, side, Role.LIMIT, text)
    elif limit.metric in _TIMES:
        for number, step in enumerate(steps):
            for side, text in sides:
                if side > 0.0:
                    shown = "" if number else text
                    yield TimeLine(limit.channel, step.time + side, Role.LIMIT, shown)
    elif limit.metric == "tracking_max":
        if math.isfinite(high):
            yield Tube(limit.channel, -high, high, 0.0, trial.duration, Role.LIMIT, label)
    elif limit.channel == trial.channel:
        yield from _step_levels(limit, sides, steps)


def _step_levels(
    limit: AcceptanceLimit, sides: Sequence[tuple[float, str]], steps: Sequence[StepMark]
) -> Iterator[LevelLine]:
    """Limits that are levels about where a step ends; the first step's carry the label."""
    for number, step in enumerate(steps):
        for side, text in sides:
            if limit.metric == "overshoot" and side > 0.0:
                start, value = step.time, step.final + side * step.size
            elif limit.metric == "steady_state_error":
                start, value = step.final_start, step.asked - side
            else:
                continue
            label = "" if number else text
            yield LevelLine(limit.channel, value, start, step.until, Role.LIMIT, label)


def _score_marks(step: StepMark, scores: Sequence[Score], followed: str) -> Iterator[Mark]:
    found = {(score.metric, score.channel): score for score in scores}
    for score in scores:
        if not math.isfinite(score.value):
            continue
        value = quantity(
            score.value,
            score.unit,
            metric=score.metric,
            written=score.limit,
            spread=(score.measure.high - score.measure.low) / 2.0,
        )
        label = f"{metric_label(score.metric)} {value}"
        if score.metric in _SHARE_AT and score.channel == followed:
            level = step.initial + _SHARE_AT[score.metric] * step.size
            yield Point(score.channel, step.time + score.value, level, label)
        elif score.metric == "holding_current":
            yield LevelLine(
                score.channel, score.value, step.final_start, step.until, Role.MEASURED, label
            )
        elif score.metric == "peak":
            at = found.get(("peak_time", score.channel))
            if at is not None and math.isfinite(at.value):
                yield Point(score.channel, step.time + at.value, score.value, label)
            else:
                yield LevelLine(
                    score.channel, score.value, step.time, step.until, Role.MEASURED, label
                )
