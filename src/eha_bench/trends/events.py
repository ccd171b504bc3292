"""Metrics that move together are one event: one cause, one line, with the nights on either side."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Final

from eha_bench.trends.index import Night
from eha_bench.trends.trend import Trend, TrendState

_NEAR: Final = 2
"""Nights by which the starts of two metrics may be apart whatever their intervals say."""


@dataclass(frozen=True)
class Event:
    """What happened to some metrics of a suite on a target at about the same night.

    Attributes:
        start: the first night of it, by the metric that shows it most sharply.
        before: the night before that; None where there is none.
        trends: the metrics, the one that moved most (in units of what matters) first.
        now: whether the newest run is not what was because of it.
    """

    start: Night
    before: Night | None
    trends: tuple[Trend, ...]
    now: bool


@dataclass(frozen=True)
class _Mark:
    """The start of a change of one metric, as places among the nights of its suite and target."""

    start: int
    earliest: int
    latest: int
    trend: Trend
    now: bool
    size: float

    def near(self, other: _Mark) -> bool:
        """Return whether both can have the same cause."""
        if abs(self.start - other.start) <= _NEAR:
            return True
        overlap = self.earliest <= other.latest and other.earliest <= self.latest
        return overlap and other.earliest <= self.start <= other.latest


def events_of(nights: Sequence[Night], trends: Sequence[Trend]) -> tuple[Event, ...]:
    """Return the events of all trends, the newest first.

    Args:
        nights: all runs, in order.
        trends: of the metrics over them.
    """
    order = {night.id: place for place, night in enumerate(nights)}
    found: list[tuple[int, Event]] = []
    grouped = sorted(trends, key=lambda trend: (trend.suite, trend.target))
    for (suite, target), members in groupby(grouped, lambda t: (t.suite, t.target)):
        own = [night for night in nights if (night.suite, night.target) == (suite, target)]
        places = {night.id: place for place, night in enumerate(own)}
        marks = [mark for trend in members for mark in _marks(trend, places)]
        for together in _together(marks):
            event = _event(together, own)
            found.append((order[event.start.id], event))
    found.sort(key=lambda entry: (not entry[1].now, -entry[0]))
    return tuple(event for _, event in found)


def _marks(trend: Trend, places: dict[int, int]) -> Iterator[_Mark]:
    at = [places[night.id] for night in trend.nights]
    since = places[trend.since.id] if trend.since is not None else None
    noted = False
    for change in trend.course.changes:
        start = at[change.start]
        now = start == since and trend.state is not TrendState.LOST
        noted = noted or now
        yield _Mark(
            start, at[change.earliest], at[change.latest], trend, now,
            _in_margins(trend, change.size if not now else trend.shift),
        )  # fmt: skip
    if since is not None and not noted:
        size = _in_margins(trend, trend.shift)
        yield _Mark(since, since, since, trend, now=True, size=size)


def _in_margins(trend: Trend, size: float) -> float:
    if math.isnan(size):
        return math.inf  # a metric that is lost moved furthest
    return abs(size) / trend.margin if trend.margin > 0.0 else abs(size)


def _together(marks: list[_Mark]) -> Iterator[list[_Mark]]:
    """Yield the marks that are near each other; the sharpest of them says where."""
    left = sorted(marks, key=lambda mark: (mark.latest - mark.earliest, mark.start, -mark.size))
    while left:
        near = [mark for mark in left if mark.near(left[0])]
        yield near
        kept = {id(mark) for mark in near}
        left = [mark for mark in left if id(mark) not in kept]


def _event(marks: list[_Mark], nights: Sequence[Night]) -> Event:
    sharpest = marks[0]
    largest: dict[int, _Mark] = {}
    for mark in sorted(marks, key=lambda mark: -mark.size):
        largest.setdefault(id(mark.trend), mark)
    before = nights[sharpest.start - 1] if sharpest.start > 0 else None
    return Event(
        nights[sharpest.start],
        before,
        tuple(mark.trend for mark in largest.values()),
        any(mark.now for mark in marks),
    )
