"""What a plot marks besides its curves: levels, settling bands, limits and what was measured.

Everything here is read from the trial and its scores: nothing is computed from samples.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from eha_bench.core.limit import AcceptanceLimit
from eha_bench.core.result import TrialResult
from eha_bench.core.score import Score
from eha_bench.core.signal import Edge
from eha_bench.core.trial import Trial
from eha_bench.report.engineering import limit_text, metric_name, quantity

SETTLING_FRACTION: Final = 0.02
_TIMES: Final = ("response_time", "settling_time", "peak_time", "delay_time")
_LEVEL_AT: Final = {"response_time": 0.95, "delay_time": 0.5, "settling_time": 1.0}


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
class ValueBand:
    """A range of values (SI) of a channel, from `start` to `stop` (s)."""

    channel: str
    low: float
    high: float
    start: float
    stop: float
    role: Role
    label: str = ""


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


Mark = LevelLine | TimeLine | ValueBand | TimeBand | Point


def marks_of(trial: Trial, run: TrialResult) -> tuple[Mark, ...]:
    """Return what to draw over a run's curves, backgrounds first."""
    edges = trial.signal.edges
    found: list[Mark] = []
    if trial.settle > 0.0:
        found.append(TimeBand(-trial.settle, 0.0, Role.UNSCORED, "settling in, not scored"))
    for edge in edges:
        found += _edge_levels(trial, edge)
    for safety in trial.safety:
        for value in (safety.bounds.low, safety.bounds.high):
            if math.isfinite(value):
                found.append(_across(trial, safety.channel, value, Role.SAFETY, "safety limit"))
    for limit in trial.limits:
        found += _limit(trial, limit)
    if len(edges) == 1:
        for score in run.scores:
            found += _measured(edges[0], score)
    return tuple(dict.fromkeys(found))


def _across(trial: Trial, channel: str, value: float, role: Role, label: str) -> LevelLine:
    return LevelLine(channel, value, -trial.settle, trial.duration, role, label)


def _edge_levels(trial: Trial, edge: Edge) -> Iterator[Mark]:
    stop = min(edge.until, trial.duration)
    half = SETTLING_FRACTION * abs(edge.after - edge.before)
    yield ValueBand(
        trial.channel,
        edge.after - half,
        edge.after + half,
        edge.time,
        stop,
        Role.BAND,
        f"±{SETTLING_FRACTION:.0%} of the step".replace("%", " %"),
    )


def _limit(trial: Trial, limit: AcceptanceLimit) -> Iterator[Mark]:
    edges = trial.signal.edges
    # The upper side carries the label, of a limit with one side that one.
    label = f"{_short(limit.metric)} {limit_text(limit.text)}"
    low, high = limit.bounds.low, limit.bounds.high
    sides = [(high, label)] if math.isfinite(high) else []
    if math.isfinite(low):
        sides.append((low, "" if sides else label))
    if limit.metric in _TIMES and len(edges) == 1:
        for side, text in sides:
            if side > 0.0:
                yield TimeLine(limit.channel, edges[0].time + side, Role.LIMIT, text)
    elif limit.metric in ("peak", "holding_current"):
        channel = "current" if limit.metric == "holding_current" else limit.channel
        for side, text in sides:
            yield _across(trial, channel, side, Role.LIMIT, text)
    elif limit.metric == "overshoot" and len(edges) == 1:
        edge = edges[0]
        stop = min(edge.until, trial.duration)
        for side, text in sides:
            if side > 0.0:
                value = edge.after + side * (edge.after - edge.before)
                yield LevelLine(limit.channel, value, edge.time, stop, Role.LIMIT, text)


def _measured(edge: Edge, score: Score) -> Iterator[Mark]:
    value = score.value
    if not math.isfinite(value):
        return
    label = quantity(value, score.unit, metric=score.metric, written=score.limit)
    if score.metric in _LEVEL_AT:
        level = edge.before + _LEVEL_AT[score.metric] * (edge.after - edge.before)
        yield Point(score.channel, edge.time + value, level, f"{_short(score.metric)} {label}")
    elif score.metric in ("peak", "holding_current"):
        channel = "current" if score.metric == "holding_current" else score.channel
        yield LevelLine(
            channel,
            value,
            edge.time,
            edge.until,
            Role.MEASURED,
            f"{_short(score.metric)} {label}",
        )


def _short(metric: str) -> str:
    return metric_name(metric).partition(" (")[0].lower()
