"""The static site of a history: an index of all metrics, a page a trend, links to each report."""

from __future__ import annotations

import hashlib
import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from urllib.parse import quote

from markupsafe import Markup

from eha_bench.report.causes_section import causes_view
from eha_bench.report.causes_text import causes_line
from eha_bench.report.engineering import (
    channel_name,
    decimals_for,
    metric_name,
    number,
    quantity,
)
from eha_bench.report.heat_map import MOST_METRICS, MOST_NIGHTS, heat_row
from eha_bench.report.page import Fact, write_page
from eha_bench.report.run_report import moment
from eha_bench.report.trend_plot import sparkline, trend_svg, unit_of
from eha_bench.report.units_page import UNITS_NAME, write_units
from eha_bench.trends.changes import FEWEST, Change
from eha_bench.trends.events import Event
from eha_bench.trends.history import History
from eha_bench.trends.index import Night
from eha_bench.trends.terms import Kind
from eha_bench.trends.trend import Trend, TrendState

INDEX_NAME: Final = "index.html"
_ALIKE: Final = 1.4  # widening from which on it is noted: nights correlated by a third
_DATE: Final = 10
_MOST_EVENTS: Final = 30
_SHARE_THAT_SAYS_SOMETHING = 10.0
_KELVIN: Final = 273.15
_NOTABLE: Final = (
    TrendState.NOT_SCORED,
    TrendState.SUSPECTED,
    TrendState.ONE_NIGHT_OUT,
    TrendState.CUT_OFF,
)
_LOOKS: Final = {
    TrendState.LOST: ("failed", "✕"),
    TrendState.OUT_OF_LIMITS: ("failed", "✕"),
    TrendState.STEPPED: ("failed", "⤒"),
    TrendState.DRIFTING: ("warned", "↗"),
    TrendState.SUSPECTED: ("undecided", "⤒"),
    TrendState.ONE_NIGHT_OUT: ("undecided", "•"),
    TrendState.NOT_SCORED: ("not_scored", "–"),
    TrendState.CUT_OFF: ("undecided", "?"),
    TrendState.STEADY: ("passed", "✓"),
    TrendState.TOO_FEW: ("undecided", "?"),
}
VERDICTS: Final = {
    "drifted": ("failed", "✕", "The newest run drifted"),
    "steady": ("passed", "✓", "Steady"),
    "undecided": ("undecided", "?", "Too few runs yet"),
}
"""Look, sign and word of what a history says."""


@dataclass(frozen=True)
class ChangeView:
    """A change as a table shows it."""

    when: str
    between: str
    kind: str
    size: str
    before: str
    after: str
    rig: str
    href: str


@dataclass(frozen=True)
class EventView:
    """Metrics that moved together, as a line of a table."""

    when: str
    href: str
    look: str
    sign: str
    first: TrendView
    others: tuple[TrendView, ...]
    revision: tuple[str, str]
    oil: str
    rig: str
    now: bool


@dataclass(frozen=True)
class TrendView:
    """A trend as the index and its own page show it."""

    page: str
    trial: str
    metric: str
    channel: str
    group: str
    newest: str
    unit: str
    level: str
    limits: str
    shift: str
    look: str
    sign: str
    state: str
    direction: str
    nights: int
    missed: int
    changes: tuple[ChangeView, ...]
    last: str
    spark: Markup


def write_site(out: Path, history: History, folder: Path, *, seen_at: Path | None = None) -> Path:
    """Write index.html and trends/*.html into a folder; return the index's path.

    Args:
        out: where the site goes; must exist.
        history: what to show.
        folder: that the nights' paths are relative to.
        seen_at: where its readers see it, which links to reports start from; `out` if None.
    """
    seen = out if seen_at is None else seen_at
    pages = out / "trends"
    pages.mkdir(exist_ok=True)
    several = len({(trend.suite, trend.target) for trend in history.trends}) > 1
    reports = {night.id: _report(night, folder) for night in history.nights}
    names = {night.id: _night_name(night) for night in history.nights}
    from_site, from_pages = (_links(reports, where) for where in (seen, seen / pages.name))
    views = []
    for trend in history.trends:
        view = _view(trend, names, from_pages, several=several)
        views.append(view)
        _write_trend(pages, view, trend, names, from_pages)
    for stale in set(pages.glob("*.html")) - {pages / view.page for view in views}:
        stale.unlink()
    look, sign, word = VERDICTS[history.status]
    both = list(zip(views, history.trends, strict=True))
    shown = history.nights[-MOST_NIGHTS:]
    by_trend = {id(trend): view for view, trend in both}
    events = [_event(event, by_trend, names, from_site) for event in history.events[:_MOST_EVENTS]]
    content = {
        "history": history,
        "look": look,
        "sign": sign,
        "word": word,
        "headline": headline(history),
        "events": events,
        "causes": causes_view(history.causes),
        "units": UNITS_NAME if history.kin else "",
        "heat": [(view, heat_row(trend, shown)) for view, trend in both[:MOST_METRICS]],
        "heat_ends": [names[night.id][:_DATE] for night in (shown[0], shown[-1])],
        "notable": [view for view, trend in both
                    if trend.state.drifted or trend.state in _NOTABLE],
        "trends": views,
        "nights": [
            (names[night.id], night, from_site[night.id]) for night in reversed(history.nights)
        ][:100],
    }  # fmt: skip
    write_units(out, history.kin, {id(trend): view.page for view, trend in both})
    return write_page(out / INDEX_NAME, "history.html.j2", content, title="History")


def headline(history: History) -> str:
    """Return what was found, as a sentence."""
    drifted, total = history.drifted, len(history.trends)
    nights = len(history.nights)
    runs = f"{nights} run{'' if nights == 1 else 's'}, {total} metric{'' if total == 1 else 's'}"
    too_few, missed = len(history.of(TrendState.TOO_FEW)), len(history.of(TrendState.NOT_SCORED))
    hidden = len(history.of(TrendState.CUT_OFF))
    found = _drift(drifted) if total > too_few + missed + hidden else ""
    # a metric is followed over the runs of its own suite on its own target
    own = " of the same suite and target" if nights >= FEWEST else ""
    needed = f"({FEWEST}{own} are needed)"
    alone = len(history.of(TrendState.ONE_NIGHT_OUT))
    suspected = len(history.of(TrendState.SUSPECTED))
    parts = [
        found,
        f"the sensor's end cut off the newest value of {_share(hidden, total)}" if hidden else "",
        f"a step suspected in {_share(suspected, total)}, to be confirmed" if suspected else "",
        f"one night outside its limits in {_share(alone, total)}, to be confirmed" if alone else "",
        f"too few runs to judge {_share(too_few, total)} {needed}" if too_few else "",
        f"the newest run has no value of {_share(missed, total)}" if missed else "",
        "no run has a value of any" if not total else "",
        causes_line(history),
    ]
    return f"{runs}: {'; '.join(part for part in parts if part)}."


def _share(count: int, total: int) -> str:
    return f"{count} of them" if count < total else "any of them" if total > 1 else "it"


def _drift(drifted: tuple[Trend, ...]) -> str:
    if not drifted:
        return "none drifted in the newest run"
    worse = sum(trend.worse is True for trend in drifted)
    better = sum(trend.worse is False for trend in drifted)
    neither = len(drifted) - worse - better
    parts = [
        f"{worse} for the worse" if worse else "",
        f"{better} for the better" if better else "",
        f"{neither} with no better side" if neither < len(drifted) and neither else "",
    ]
    listed = ", ".join(part for part in parts if part)
    return f"{len(drifted)} drifted{f' ({listed})' if listed else ''}"


def _event(
    event: Event, views: dict[int, TrendView], names: dict[int, str], links: dict[int, str]
) -> EventView:
    first, *others = (views[id(trend)] for trend in event.trends)
    before = event.before or event.start
    return EventView(
        when=names[event.start.id],
        href=links[event.start.id],
        look=first.look if event.now else "same",
        sign=first.sign if event.now else "",
        first=first,
        others=tuple(others),
        revision=(before.revision[:12], event.start.revision[:12]),
        oil=_oil(before, event.start),
        rig=_rig(before, event.start),
        now=event.now,
    )


def _oil(before: Night, after: Night) -> str:
    """Return the oil's temperature before and after; "" where it was not logged."""
    both = [
        "?" if night.oil_temperature is None else f"{night.oil_temperature - _KELVIN:.1f}"
        for night in (before, after)
    ]
    return "" if both == ["?", "?"] else f"{both[0]} → {both[1]} °C"


def event_sentence(event: Event) -> str:
    """Return an event in a line, for a console or a message."""
    first = event.trends[0]
    nights = (event.before or event.start, event.start)
    revisions = [night.revision[:12] for night in nights]
    about = [f"since {moment(event.start.started) or event.start.path}"]
    if any(revisions):
        about.append(" → ".join(dict.fromkeys(revisions)))
    about += [part for part in (_oil(*nights), _rig(*nights)) if part]
    count = len(event.trends) - 1
    also = f" and {count} more metric{'' if count == 1 else 's'}" if count else ""
    return f"{_change_text(first)}{also} ({'; '.join(about)})"


def _change_text(trend: Trend) -> str:
    name = f"{trend.trial}: {metric_name(trend.metric)} {trend.state.value}"
    worse = {True: ", for the worse", False: ", for the better", None: ""}[trend.worse]
    if not trend.state.drifted or not math.isfinite(trend.shift):
        return name if trend.state.drifted else f"{trend.trial}: {metric_name(trend.metric)}"
    now = float(trend.values[-1])
    shown = [quantity(value, trend.unit, metric=trend.metric) for value in (now - trend.shift, now)]
    return f"{name}: {shown[0]} -> {shown[1]}{worse}"


def _report(night: Night, folder: Path) -> Path | None:
    report = (folder / night.path).with_name("report.html")
    return report.resolve() if report.is_file() else None


def _links(reports: dict[int, Path | None], where: Path) -> dict[int, str]:
    base = where.resolve()
    return {
        key: quote(Path(os.path.relpath(path, base)).as_posix(), safe="/") if path else ""
        for key, path in reports.items()
    }


def _night_name(night: Night) -> str:
    parts = [moment(night.started) or night.path, night.revision[:12]]
    return ", ".join(part for part in parts if part)


def _view(
    trend: Trend, names: dict[int, str], links: dict[int, str], *, several: bool
) -> TrendView:
    unit = unit_of(trend)
    newest = float(trend.values[-1])
    places = decimals_for(unit.from_si(newest), unit.difference(trend.course.sigma))

    def shown(value: float) -> str:
        return number(unit.from_si(value), places) if math.isfinite(value) else number(math.nan)

    def moved(value: float) -> str:
        share = value / abs(trend.level) if trend.level else math.nan
        text = number(round(unit.difference(value), places), places, sign=True)
        if unit.symbol == "%":
            return f"{text}\N{NO-BREAK SPACE}points"
        text += unit.suffix
        if abs(share) < _SHARE_THAT_SAYS_SOMETHING:  # not of a value that should be zero
            text += f" ({number(round(100.0 * share, 1), 1, sign=True)}\N{NO-BREAK SPACE}%)"
        return text

    changes = tuple(
        ChangeView(
            when=names[trend.nights[change.start].id],
            between=_between(trend, change, names),
            kind="Step"
            if change.kind is Kind.STEP
            else trend.course.kink_word(change).capitalize(),
            size=moved(change.size) + ("" if change.kind is Kind.STEP else " a night"),
            before=trend.nights[change.start - 1].revision[:12],
            after=trend.nights[change.start].revision[:12],
            rig=_rig(trend.nights[change.start - 1], trend.nights[change.start]),
            href=links[trend.nights[change.start].id],
        )
        for change in trend.course.changes
    )
    look, sign = _LOOKS[trend.state]
    if trend.state.drifted and trend.worse is False:
        look = "warned"
    low, high = trend.limits
    worse = {True: "for the worse", False: "for the better", None: ""}[trend.worse]
    return TrendView(
        page=_slug(trend),
        trial=trend.trial,
        metric=metric_name(trend.metric),
        channel=channel_name(trend.channel) if trend.channel else "",
        group=f"{trend.suite} on {trend.target}" if several else "",
        newest=shown(newest),
        unit=unit.symbol,
        level=shown(trend.level),
        limits=f"{shown(low)} … {shown(high)}" if math.isfinite(low + high) else "",
        shift=moved(trend.shift) if trend.state.drifted and math.isfinite(trend.shift) else "",
        look=look,
        sign=sign,
        state=trend.state.value,
        direction=worse if trend.state.drifted else "",
        nights=len(trend.nights),
        missed=trend.missed,
        changes=changes,
        last=names[trend.nights[-1].id],
        spark=sparkline(trend),
    )


def _between(trend: Trend, change: Change, names: dict[int, str]) -> str:
    """Return between which nights a change began, "" where it is known to the night."""
    if change.earliest == change.latest:
        return ""
    first, last = (names[trend.nights[at].id] for at in (change.earliest, change.latest))
    if first[:_DATE] != last[:_DATE]:
        first, last = first[:_DATE], last[:_DATE]
    return f"{first} … {last}"


def _rig(before: Night, after: Night) -> str:
    """Return the rig at a change, and what else changed with it."""
    rig = f"{after.target}, {after.host}" if after.host else after.target
    parts = [rig]
    if before.host and after.host and before.host != after.host:
        parts.append(f"before: {before.host}")
    for key, word in (
        ("suite_sha256", "suite"),
        ("model_sha256", "model"),
        ("controller_sha256", "controller"),
        ("version", "eha-bench"),
    ):
        if getattr(before, key) != getattr(after, key):
            parts.append(f"another {word}" if key != "version" else "another eha-bench")
    return "; ".join(parts)


def _write_trend(
    folder: Path,
    view: TrendView,
    trend: Trend,
    names: dict[int, str],
    links: dict[int, str],
) -> None:
    title = f"{view.metric} of {view.trial}"
    called = [names[night.id] for night in trend.nights]
    own = [links[night.id] for night in trend.nights]
    facts: Sequence[Fact] = (
        Fact("Suite", trend.suite),
        Fact("Target", trend.target),
        Fact("Trial", trend.trial),
        Fact("Metric", trend.metric, code=True),
        Fact("Channel", trend.channel, code=True),
        Fact("Nights", f"{view.nights}, and {view.missed} without a value"),
    )
    content = {
        "view": view,
        "plot": trend_svg(trend, called, own, title=f"{title} over {view.nights} nights"),
        "facts": facts,
        "margin": number(unit_of(trend).difference(trend.margin)) + unit_of(trend).suffix,
        "sigma": number(unit_of(trend).difference(trend.course.sigma)) + unit_of(trend).suffix,
        "swing": _swing(trend),
        "correlated": trend.course.widening > _ALIKE,
    }
    write_page(folder / view.page, "trend.html.j2", content, title=title)


def _swing(trend: Trend) -> str:
    """Return a slow swing in words, "" where there is none."""
    swing = trend.judged.swing
    if swing is None:
        return ""
    unit = unit_of(trend)
    size = number(unit.difference(swing.amplitude)) + unit.suffix
    return f"about {swing.period:.0f} nights, ± {size}"


def _slug(trend: Trend) -> str:
    """Return a file name of a trend, unique also where names differ in odd letters only."""
    key = (trend.suite, trend.target, trend.trial, trend.metric, trend.channel, trend.unit)
    digest = hashlib.sha256("\0".join(key).encode()).hexdigest()[:8]
    readable = re.sub(r"[^A-Za-z0-9_.-]+", "_", f"{trend.trial}-{trend.metric}")[:80]
    return f"{readable}-{digest}.html"
