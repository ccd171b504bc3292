"""Causes over the nights: what was estimated of each, which of them wears, and for how long yet."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.finite import finite_or_none
from eha_bench.trends.index import Night

MATTERS: Final = 0.1
"""Part of the way from the healthy machine to the first limit that is worth an alarm."""


@dataclass(frozen=True)
class Number:
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float

    def to_dict(self) -> dict[str, float | None]:
        """Return it as it stands in JSON; what is not finite is null."""
        return {
            "value": finite_or_none(self.value),
            "low": finite_or_none(self.low),
            "high": finite_or_none(self.high),
        }


@dataclass(frozen=True)
class LimitCrossing:
    """Where a cause takes a metric to its acceptance limit first.

    Attributes:
        value: of the cause, SI. drawn: (draws,) where it may be, by what is not known of the
            metrics, SI, infinite where no limit is met; empty where it was read from a file.
        trial, metric, limit: which it is, most likely.
    """

    value: float
    drawn: FloatArray
    trial: str
    metric: str
    limit: str


@dataclass(frozen=True)
class CauseTrend:
    """One cause over the nights, SI.

    Attributes:
        name, unit: of the cause. healthy: its value on the first nights.
        nights: (n) those with an estimate of it. values, deviations: (n,) if it alone changed; its
            standard deviation by the night's own noise and by how machines vary.
        line: (n,) its course. state: what the newest night is in it, in words.
    """

    name: str
    unit: str
    healthy: float
    nights: tuple[Night, ...]
    values: FloatArray
    deviations: FloatArray
    line: FloatArray
    state: str


@dataclass(frozen=True)
class Wear:
    """A cause that moves.

    Attributes:
        trend: of the cause. rivals: names of others that explain the nights as well.
        share: of what changed that it explains, of 1.
        since, earliest, latest: the night it began, and its 95 % interval.
        moved: by how much the newest night is away from healthy, SI.
        rate: a night, SI; nights_left: to the crossing. Both None where it does not go on.
        crossing: the first limit on its way; None where there is none.
        alarm: whether it has come far enough to matter.
        chances: nights ahead -> probability that the limit is still kept.
    """

    trend: CauseTrend
    rivals: tuple[str, ...]
    share: float
    since: Night
    earliest: Night
    latest: Night
    moved: Number
    rate: Number | None
    crossing: LimitCrossing | None
    nights_left: Number | None
    alarm: bool
    chances: tuple[tuple[int, float], ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        at = self.crossing
        return {
            "cause": self.trend.name,
            "unit": self.trend.unit,
            "rivals": list(self.rivals),
            "explains": finite_or_none(self.share),
            "since": _night(self.since),
            "earliest": _night(self.earliest),
            "latest": _night(self.latest),
            "healthy": finite_or_none(self.trend.healthy),
            "moved": self.moved.to_dict(),
            "rate_per_night": None if self.rate is None else self.rate.to_dict(),
            "nights_left": None if self.nights_left is None else self.nights_left.to_dict(),
            "limit": None
            if at is None
            else {
                "trial": at.trial, "metric": at.metric, "limit": at.limit,
                "reached_at": finite_or_none(at.value),
            },
            "alarm": self.alarm,
            "p_kept": [{"nights": nights, "p": chance} for nights, chance in self.chances],
        }  # fmt: skip


@dataclass(frozen=True)
class Causes:
    """What is behind the nights of one suite on one target.

    Attributes:
        suite, target: whose nights. trends: of every cause, those that moved first.
        wear: causes that move, at most one for what began together.
        untold: nights without an estimate, each with why.
        notes: what was taken out, and what could not be.
    """

    suite: str
    target: str
    trends: tuple[CauseTrend, ...] = ()
    wear: tuple[Wear, ...] = ()
    untold: tuple[tuple[Night, str], ...] = ()
    notes: tuple[str, ...] = field(default=())

    @property
    def alarms(self) -> tuple[Wear, ...]:
        """Wear that has come far enough to matter."""
        return tuple(item for item in self.wear if item.alarm)

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        return {
            "suite": self.suite,
            "target": self.target,
            "wear": [item.to_dict() for item in self.wear],
            "untold": [{"night": _night(night), "reason": why} for night, why in self.untold],
            "notes": list(self.notes),
            "trends": [
                {
                    "cause": trend.name,
                    "unit": trend.unit,
                    "healthy": finite_or_none(trend.healthy),
                    "state": trend.state,
                    "nights": [_night(night) for night in trend.nights],
                    "values": [finite_or_none(float(value)) for value in trend.values],
                    "deviations": [finite_or_none(float(value)) for value in trend.deviations],
                    "line": [finite_or_none(float(value)) for value in trend.line],
                }
                for trend in self.trends
            ],
        }


def causes_from(data: Mapping[str, Any], nights: Sequence[Night]) -> Causes:
    """Return what `Causes.to_dict` gave; nights that are no more are left out.

    Args:
        data: of history.json. nights: that it may speak of.

    Raises:
        KeyError, TypeError, ValueError: it is nothing of the kind.
    """
    by_path = {night.path: night for night in nights}
    trends = {item["cause"]: _trend_from(item, by_path) for item in data["trends"]}
    return Causes(
        str(data["suite"]),
        str(data["target"]),
        tuple(trends.values()),
        tuple(
            _wear_from(item, trends[item["cause"]], by_path)
            for item in data["wear"]
            if all(item[key]["result"] in by_path for key in ("since", "earliest", "latest"))
        ),
        tuple(
            (by_path[item["night"]["result"]], str(item["reason"]))
            for item in data["untold"]
            if item["night"]["result"] in by_path
        ),
        tuple(map(str, data["notes"])),
    )


def _trend_from(data: Mapping[str, Any], nights: Mapping[str, Night]) -> CauseTrend:
    kept = [place for place, item in enumerate(data["nights"]) if item["result"] in nights]

    def column(key: str) -> FloatArray:
        return np.array([_float(data[key][place]) for place in kept], dtype=np.float64)

    return CauseTrend(
        str(data["cause"]), str(data["unit"]), _float(data["healthy"]),
        tuple(nights[data["nights"][place]["result"]] for place in kept),
        column("values"), column("deviations"), column("line"), str(data["state"]),
    )  # fmt: skip


def _wear_from(data: Mapping[str, Any], trend: CauseTrend, nights: Mapping[str, Night]) -> Wear:
    limit = data["limit"]
    since, earliest, latest = (
        nights[data[key]["result"]] for key in ("since", "earliest", "latest")
    )
    moved, rate, left = (data[key] for key in ("moved", "rate_per_night", "nights_left"))
    return Wear(
        trend,
        tuple(map(str, data["rivals"])),
        _float(data["explains"]),
        since, earliest, latest,
        _number_from(moved),
        None if rate is None else _number_from(rate),
        None
        if limit is None
        else LimitCrossing(
            _float(limit["reached_at"]), np.empty(0), str(limit["trial"]), str(limit["metric"]),
            str(limit["limit"]),
        ),
        None if left is None else _number_from(left),
        bool(data["alarm"]),
        tuple((int(item["nights"]), float(item["p"])) for item in data["p_kept"]),
    )  # fmt: skip


def _number_from(data: Mapping[str, Any]) -> Number:
    high = data["high"]
    return Number(
        _float(data["value"]), _float(data["low"]), math.inf if high is None else float(high)
    )


def _float(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _night(night: Night) -> dict[str, str]:
    return {"result": night.path, "started": night.started}
