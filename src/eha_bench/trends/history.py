"""A history: the trends of every metric over many results, and its versioned JSON."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

from eha_bench.core.atomic_file import write_text
from eha_bench.core.errors import EhaBenchError, InputError, Place
from eha_bench.core.finite import finite_or_none
from eha_bench.core.lazy import later
from eha_bench.core.margin import parse_margin
from eha_bench.core.metric import Better, metric_spec
from eha_bench.core.workers import IN_PROCESS, Workers
from eha_bench.suites.acceptance.grammar import parse_bounds, split_stated
from eha_bench.trends.changes import FEWEST
from eha_bench.trends.events import Event, events_of
from eha_bench.trends.index import Entry, Index, Night
from eha_bench.trends.specimens import Kin, kin_of
from eha_bench.trends.swing import Swing
from eha_bench.trends.terms import Kind
from eha_bench.trends.trend import Trend, TrendState, cut_off, judge
from eha_bench.trends.wear import Causes

SCHEMA_VERSION: Final = 1
DEFAULT_SHARE: Final = 0.005
"""Of the level: the smallest change that matters where the suite does not say."""

_SIGNS: Final = {Better.LOWER: -1, Better.HIGHER: 1}
_AIMS: Final = {Better.NEARER_ZERO: 0.0, Better.NEARER_ONE: 1.0}
_GRAVITY: Final = list(TrendState)

Key = tuple[str, str, str, str, str, str]

_html = later("eha_bench.report.notebook", "history_html")


@dataclass(frozen=True)
class History:
    """Trends of all metrics, the most serious state first.

    Attributes:
        folder: what was watched.
        nights: all runs, in order.
        trends: of every metric of every trial, suite and target.
        problems: results that could not be read, a sentence each.
        causes: what is behind the newest nights; None where not requested.
    """

    folder: str
    nights: tuple[Night, ...]
    trends: tuple[Trend, ...]
    problems: tuple[str, ...] = ()
    causes: Causes | None = None

    @property
    def drifted(self) -> tuple[Trend, ...]:
        """Metrics that changed in the newest run."""
        return tuple(trend for trend in self.trends if trend.state.drifted)

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """Metrics that moved together, those of the newest run first."""
        return events_of(self.nights, self.trends)

    @cached_property
    def kin(self) -> tuple[Kin, ...]:
        """Metrics of units of one kind, side by side."""
        return kin_of(self.trends)

    def of(self, state: TrendState) -> tuple[Trend, ...]:
        """Metrics in whose course the newest run is this."""
        return tuple(trend for trend in self.trends if trend.state is state)

    @property
    def status(self) -> str:
        """`drifted`, `steady`, or `undecided` where no metric can be judged."""
        if self.drifted or (self.causes is not None and self.causes.alarms):
            return "drifted"
        quiet = (TrendState.STEADY, TrendState.SUSPECTED, TrendState.ONE_NIGHT_OUT)
        return "steady" if any(self.of(state) for state in quiet) else "undecided"

    def exit_status(self, *, only_worse: bool = False) -> int:
        """1 where the newest run drifted (`only_worse`: not for the better), else 0.

        A cause that has come far enough towards a limit counts as well.
        """
        found = [trend for trend in self.drifted if not only_worse or trend.worse is not False]
        return int(bool(found or (self.causes is not None and self.causes.alarms)))

    def __repr__(self) -> str:
        """What it is in one line: how many runs and metrics, and what drifted."""
        runs, metrics = len(self.nights), len(self.trends)
        return (
            f"<History of {self.folder}: {runs} run{'' if runs == 1 else 's'}, "
            f"{metrics} metric{'' if metrics == 1 else 's'}, {self.status}>"
        )

    def _repr_html_(self) -> str:
        """What a notebook shows: a line a metric, what drifted first."""
        return str(_html(self))

    def to_json(self) -> str:
        """Return the history as JSON; NaN becomes null."""
        places = {night.id: place for place, night in enumerate(self.nights)}
        content = {
            "schema_version": SCHEMA_VERSION,
            "folder": self.folder,
            "status": self.status,
            "too_few": len(self.of(TrendState.TOO_FEW)),
            "fewest_nights": FEWEST,
            "problems": list(self.problems),
            "nights": [_night(night) for night in self.nights],
            "events": [_event(event) for event in self.events],
            "units": [_kin(kin) for kin in self.kin],
            "causes": None if self.causes is None else self.causes.to_dict(),
            "trends": [_trend(trend, places) for trend in self.trends],
        }
        return json.dumps(content, ensure_ascii=False, allow_nan=False) + "\n"

    def write(self, path: Path) -> None:
        """Write the JSON whole or not at all."""
        write_text(path, self.to_json())


def history_of(index: Index, folder: str, workers: Workers = IN_PROCESS) -> History:
    """Return the trends of an index, each judged by itself, wherever the workers are.

    Raises:
        InputError: there is no run in it.
        WorkError: a metric could not be judged.
    """
    if not index.nights:
        raise InputError(
            "holds no result"
            + (f" that can be read ({index.problems[0]})" if index.problems else ""),
            where=Place(file=folder),
            hint="give a folder of result folders, e.g. the one that `run --out` writes into",
        )
    trends = sorted(
        workers.map(_trend_of, _watched_metrics(index)),
        key=lambda t: (_GRAVITY.index(t.state), -abs(_share(t)), t.suite, t.trial, t.metric),
    )
    return History(folder, index.nights, tuple(trends), index.problems)


def _share(trend: Trend) -> float:
    share = trend.shift / trend.margin if trend.margin > 0.0 and trend.state.drifted else 0.0
    return share if math.isfinite(share) else 0.0


@dataclass(frozen=True)
class _Watched:
    """A metric with its values over the nights, not judged yet.

    Attributes:
        key: suite, target, trial, metric, channel, unit.
        entries: in the order of the nights. nights: the same ones.
        missing: newest nights in a row of its suite and target that have no value, and nights
            without one before them, since its first.
        lost: the first of the newest nights without a value; None for none.
        family: how many metrics are watched.
    """

    key: Key
    entries: tuple[Entry, ...]
    nights: tuple[Night, ...]
    missing: tuple[int, int]
    lost: Night | None
    family: int


def _watched_metrics(index: Index) -> list[_Watched]:
    nights = {night.id: night for night in index.nights}
    order = {night.id: place for place, night in enumerate(index.nights)}
    by_group: dict[tuple[str, str], list[Night]] = {}
    for night in index.nights:
        by_group.setdefault((night.suite, night.target), []).append(night)
    grouped: dict[Key, list[Entry]] = {}
    for entry in index.entries:
        night = nights[entry.run]
        key = (night.suite, night.target, entry.trial, entry.metric, entry.channel, entry.unit)
        grouped.setdefault(key, []).append(entry)
    known = {
        key: [e for e in entries if math.isfinite(e.value)] for key, entries in grouped.items()
    }
    family = sum(bool(entries) for entries in known.values()) or 1
    found = []
    for key, entries in known.items():
        if not entries:
            continue  # never scored: there is nothing to watch
        entries.sort(key=lambda entry: order[entry.run])
        all_nights = by_group[key[:2]]
        seen = tuple(nights[entry.run] for entry in entries)
        since = [night for night in all_nights if order[night.id] >= order[seen[0].id]]
        gone = [night for night in since if order[night.id] > order[seen[-1].id]]
        missing = (len(gone), len(since) - len(seen) - len(gone))
        lost = gone[0] if gone else None
        found.append(_Watched(key, tuple(entries), seen, missing, lost, family))
    return found


def _trend_of(metric: _Watched) -> Trend:
    values = np.array([entry.value for entry in metric.entries])
    better, aim = _direction(metric.key[3])
    margin = _margin(metric.entries[-1], float(np.median(values)))
    spreads = np.array([entry.spread for entry in metric.entries])
    known = spreads[np.isfinite(spreads)]
    judged = judge(
        values,
        family=metric.family,
        margin=margin,
        own=float(np.median(known)) if known.size else math.nan,
        missing=metric.missing,
    )
    sides = tuple(entry.open for entry in metric.entries)
    if judged.state is not TrendState.LOST:
        judged = cut_off(judged, sides[-1])
    return Trend(
        *metric.key, better, aim, metric.nights, values, judged, margin, sum(metric.missing),
        metric.lost, _bounds(metric.entries), sides if any(sides) else (),
    )  # fmt: skip


def _bounds(entries: tuple[Entry, ...]) -> tuple[float, float]:
    """Return the newest acceptance limit in SI; infinite where there is none that is absolute."""
    text = next((entry.bound for entry in reversed(entries) if entry.bound), "")
    try:
        words = split_stated(text)
        if not words.bounds or words.relative:
            return -math.inf, math.inf
        bounds = parse_bounds(words.bounds, entries[-1].unit)
    except EhaBenchError:
        return -math.inf, math.inf  # it is there to be drawn: nothing depends on it
    return bounds.low, bounds.high


def _direction(metric: str) -> tuple[int, float]:
    try:
        better = metric_spec(metric).better
    except EhaBenchError:
        return 0, math.nan
    return _SIGNS.get(better, 0), _AIMS.get(better, math.nan)


def _margin(entry: Entry, level: float) -> float:
    if entry.matters:
        try:
            return parse_margin(entry.matters, entry.unit).about(level)
        except EhaBenchError:
            pass  # written for the metric on another channel
    return DEFAULT_SHARE * abs(level)


def _event(event: Event) -> dict[str, Any]:
    return {
        "now": event.now,
        "since": _place(event.start),
        "before": _place(event.before) if event.before is not None else None,
        "metrics": [
            {
                "trial": trend.trial,
                "metric": trend.metric,
                "channel": trend.channel,
                "state": trend.state.value,
                "shift": finite_or_none(trend.shift) if event.now else None,
                "worse": trend.worse if event.now else None,
                "unit": trend.unit,
            }
            for trend in event.trends
        ],
    }


def _kin(kin: Kin) -> dict[str, Any]:
    return {
        "suite": kin.suite,
        "trial": kin.trial,
        "metric": kin.metric,
        "channel": kin.channel,
        "unit": "" if kin.relative else kin.unit,
        "relative": kin.relative,
        "targets": [
            {
                "target": one.trend.target,
                "first": finite_or_none(one.first),
                "change": finite_or_none(one.change),
                "low": finite_or_none(one.low),
                "high": finite_or_none(one.high),
                "odd": one.odd,
            }
            for one in kin.specimens
        ],
    }


def _night(night: Night) -> dict[str, Any]:
    return {
        "path": night.path,
        "started": night.started,
        "suite": night.suite,
        "target": night.target,
        "host": night.host,
        "revision": night.revision,
        "version": night.version,
        "status": night.status,
        "oil_temperature": night.oil_temperature,
    }


def _trend(trend: Trend, places: dict[int, int]) -> dict[str, Any]:
    return {
        "suite": trend.suite,
        "target": trend.target,
        "trial": trend.trial,
        "metric": trend.metric,
        "channel": trend.channel,
        "unit": trend.unit,
        "state": trend.state.value,
        "worse": trend.worse if trend.state.drifted else None,
        "count": len(trend.nights),
        "missed": trend.missed,
        "newest": finite_or_none(float(trend.values[-1])),
        "level": finite_or_none(trend.level),
        "limits": [finite_or_none(limit) for limit in trend.limits],
        "sigma": finite_or_none(trend.course.sigma),
        "drift_since_change": finite_or_none(trend.judged.drift),
        "since": _place(trend.since) if trend.since is not None else None,
        "shift": finite_or_none(trend.shift),
        "swing": _swing(trend.judged.swing),
        "acceptance": [finite_or_none(bound) for bound in trend.bounds],
        "slope_per_night": finite_or_none(trend.course.slope),
        "matters": finite_or_none(trend.margin),
        "changes": [
            {
                "night": change.start,
                "kind": "step" if change.kind is Kind.STEP else trend.course.kink_word(change),
                "size": finite_or_none(change.size),
                "p_value": finite_or_none(change.p_value),
                "earliest_night": change.earliest,
                "latest_night": change.latest,
                "before": _place(trend.nights[change.start - 1]),
                "at": _place(trend.nights[change.start]),
            }
            for change in trend.course.changes
        ],
        "values": [finite_or_none(float(value)) for value in trend.values],
        "at": [places[night.id] for night in trend.nights],
    } | ({"open": list(trend.open)} if trend.open else {})


def _swing(swing: Swing | None) -> dict[str, float] | None:
    if swing is None:
        return None
    return {"period_nights": round(swing.period, 1), "amplitude": swing.amplitude}


def _place(night: Night) -> dict[str, str | float | None]:
    return {
        "result": night.path,
        "started": night.started,
        "revision": night.revision,
        "rig": night.target,
        "host": night.host,
        "suite_sha256": night.suite_sha256,
        "oil_temperature": night.oil_temperature,
    }
