"""What wears, in sentences: for the page, a console, a message."""

from __future__ import annotations

import math

from eha_bench.report.engineering import DisplayUnit, display_unit, limit_text, metric_name, number
from eha_bench.report.run_report import moment
from eha_bench.trends.history import History
from eha_bench.trends.wear import Causes, CauseTrend, Number, Wear

_DAY = 10


def unit_of_cause(trend: CauseTrend) -> DisplayUnit:
    """Return the unit that a cause is shown in."""
    return display_unit(trend.unit, [trend.healthy, *trend.values.tolist()])


def wear_sentence(wear: Wear) -> str:
    """Return what a cause does, since when, how fast, and what is left."""
    unit, trend = unit_of_cause(wear.trend), wear.trend
    now = trend.healthy + wear.moved.value
    parts = [
        f"{trend.name}: {number(unit.from_si(trend.healthy))} → {number(unit.from_si(now))}"
        f"{unit.suffix} since {_day(wear)}"
    ]
    if wear.rate is not None:
        rate = _interval(wear.rate, unit.difference)
        parts.append(f"{rate}{unit.suffix} a night")
    parts.append(nights_left_text(wear))
    if math.isfinite(wear.share):
        share = f"{100.0 * min(wear.share, 1.0):.0f}\N{NO-BREAK SPACE}%"
        parts.append(f"explains {share} of the change")
    if wear.rivals:
        parts.append(f"not distinguishable from {', '.join(wear.rivals)}")
    return "; ".join(part for part in parts if part)


def nights_left_text(wear: Wear) -> str:
    """Return how many nights are left and to which limit, "" where no limit is forecast."""
    at = wear.crossing
    if at is None:
        return ""
    limit = f"{at.trial}: {metric_name(at.metric)} {limit_text(at.limit)}"
    left = wear.nights_left
    if left is None:
        return f"it does not clearly go on towards its first limit ({limit})"
    if left.value <= 0.0:
        return f"its first limit is reached ({limit})"
    return f"{_interval(left, lambda value: value, 0)} nights left to {limit}"


def causes_line(history: History) -> str:
    """Return what stands of the causes in a headline; "" where not requested."""
    causes = history.causes
    if causes is None:
        return ""
    alarms = causes.alarms
    if alarms:
        return f"cause: {', '.join(item.trend.name for item in alarms)}"
    if causes.wear:
        names = ", ".join(item.trend.name for item in causes.wear)
        return f"{names} moves, by less than matters"
    return "no cause moves" if causes.trends else "no cause can be named yet"


def untold_sentence(causes: Causes) -> tuple[str, ...]:
    """Return nights without an estimate, a sentence each, the newest first."""
    return tuple(
        f"{moment(night.started) or night.path}: {why}" for night, why in reversed(causes.untold)
    )


def _day(wear: Wear) -> str:
    nights = (wear.since, wear.earliest, wear.latest)
    whole = [moment(night.started) or night.path for night in nights]
    days = [text[:_DAY] for text in whole]
    known = wear.trend.nights
    several = bool(known) and known[0].started[:_DAY] != known[-1].started[:_DAY]
    since, *ends = days if several else whole
    return since if ends[0] == ends[1] else f"{since} ({ends[0]} … {ends[1]})"


def _interval(found: Number, shown: object, decimals: int | None = None) -> str:
    assert callable(shown)
    value, low, high = (
        number(shown(item), decimals) for item in (found.value, found.low, found.high)
    )
    return f"{value} ({low} … {high})"
