"""The page of units side by side: every metric of a kind, each unit from its own first nights."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from markupsafe import Markup, escape
from matplotlib.ticker import MaxNLocator

from eha_bench.report.engineering import (
    DisplayUnit,
    channel_name,
    decimals_for,
    display_unit,
    metric_name,
    number,
)
from eha_bench.report.page import write_page
from eha_bench.trends.specimens import FIRST, JUDGED, Kin, Specimen

UNITS_NAME: Final = "units.html"

_WIDTH, _HEIGHT = 920, 240
_LEFT, _RIGHT, _TOP, _BOTTOM = 62, 12, 12, 34
_MOST: Final = 60
_COLOURS: Final = ("blue", "vermilion", "green", "purple", "orange", "sky")
_DASHES: Final = ("", "6 3", "2 2", "8 3 2 3")


@dataclass(frozen=True)
class UnitRow:
    """A unit in a metric's table."""

    name: str
    page: str
    look: str
    colour: str
    dash: str
    nights: int
    first: str
    change: str
    interval: str
    odd: bool


@dataclass(frozen=True)
class KinView:
    """A metric on all units: its plot and its table."""

    trial: str
    metric: str
    channel: str
    suite: str
    plot: Markup
    rows: tuple[UnitRow, ...]


def write_units(out: Path, kin: Sequence[Kin], pages: Mapping[int, str]) -> Path | None:
    """Write `units.html`, or remove one where there is nothing side by side; return its path.

    Args:
        out: folder of the site.
        kin: the metrics of several units.
        pages: file name of each trend's page, by the trend's `id`.
    """
    path = out / UNITS_NAME
    if not kin:
        path.unlink(missing_ok=True)
        return None
    names = sorted({one.trend.target for group in kin for one in group.specimens})
    odd_first = sorted(kin, key=lambda group: not any(one.odd for one in group.specimens))
    several = len({group.suite for group in kin}) > 1
    odd = {one.trend.target for group in kin for one in group.specimens if one.odd}
    judged = any(group.judged for group in kin)
    content = {
        "names": names,
        "first": FIRST,
        "headline": _headline(odd, judged=judged),
        "judged": judged,
        "views": [_view(group, names, pages, several=several) for group in odd_first[:_MOST]],
    }
    return write_page(path, "units.html.j2", content, title="Units side by side")


def _headline(odd: set[str], *, judged: bool) -> str:
    if not judged:
        needed = f"{JUDGED} with more than {FIRST} nights are needed"
        return f"Too few units to call one different: {needed}"
    if not odd:
        return "No unit changed differently from the others"
    listed = ", ".join(sorted(odd))
    return f"{listed} changed differently from the others"


def _style(names: Sequence[str], name: str) -> tuple[str, str]:
    place = names.index(name)
    colour = f"var(--{_COLOURS[place % len(_COLOURS)]})"
    return colour, _DASHES[place // len(_COLOURS) % len(_DASHES)]


def _view(kin: Kin, names: Sequence[str], pages: Mapping[int, str], *, several: bool) -> KinView:
    title = f"{metric_name(kin.metric)} of {kin.trial}"
    return KinView(
        trial=kin.trial,
        metric=metric_name(kin.metric),
        channel=channel_name(kin.channel) if kin.channel else "",
        suite=kin.suite if several else "",
        plot=_plot(kin, names, title),
        rows=tuple(_row(kin, one, names, pages) for one in kin.specimens),
    )


def _shown_in(kin: Kin) -> DisplayUnit:
    values = [float(value) for one in kin.specimens for value in one.trend.values]
    return display_unit(kin.unit, values, metric=kin.metric)


def _row(kin: Kin, one: Specimen, names: Sequence[str], pages: Mapping[int, str]) -> UnitRow:
    unit = _shown_in(kin)
    sigma = one.trend.course.sigma
    places = decimals_for(unit.from_si(one.first), unit.difference(sigma))
    colour, dash = _style(names, one.trend.target)
    return UnitRow(
        name=one.trend.target,
        page=pages[id(one.trend)],
        look="failed" if one.odd else "same",
        colour=colour,
        dash=dash,
        nights=len(one.trend.nights),
        first=number(unit.from_si(one.first), places) + unit.suffix,
        change=_change_text(kin, one.change, places, unit),
        interval=f"{_change_text(kin, one.low, places, unit)} … "
        f"{_change_text(kin, one.high, places, unit)}"
        if math.isfinite(one.low + one.high)
        else "",
        odd=one.odd,
    )


def _change_text(kin: Kin, value: float, places: int, unit: DisplayUnit) -> str:
    if not math.isfinite(value):
        return "too few nights"
    if kin.relative:
        return number(round(100.0 * value, 1), 1, sign=True) + "\N{NO-BREAK SPACE}%"
    return number(round(unit.difference(value), places), places, sign=True) + unit.suffix


def _plot(kin: Kin, names: Sequence[str], title: str) -> Markup:
    """Return all units' levels over the nights since each one's first, as one SVG."""
    unit = _shown_in(kin)
    factor = 100.0 if kin.relative else unit.difference(1.0)
    courses = [factor * one.moved for one in kin.specimens]
    whole = np.concatenate(courses)
    low, high = min(0.0, float(whole.min())), max(0.0, float(whole.max()))
    pad = 0.08 * (high - low) or 1.0
    low, high = low - pad, high + pad
    longest = max(2, *(course.size for course in courses))

    def x(night: float) -> float:
        return _LEFT + (_WIDTH - _LEFT - _RIGHT) * night / (longest - 1)

    def y(value: float) -> float:
        return _HEIGHT - _BOTTOM - (_HEIGHT - _TOP - _BOTTOM) * (value - low) / (high - low)

    suffix = "\N{NO-BREAK SPACE}%" if kin.relative else unit.suffix
    parts = [
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" font-size="12" '
        f'aria-label="{escape(title)} on {len(courses)} units">'
    ]
    for tick in (float(tick) for tick in MaxNLocator(4).tick_values(low, high)):
        if low <= tick <= high:
            parts.append(
                f'<line x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{y(tick):.1f}" y2="{y(tick):.1f}" '
                f'stroke="var(--grid)"/><text class="tick-value" x="{_LEFT - 6}" '
                f'y="{y(tick) + 4:.1f}" '
                f'text-anchor="end" fill="var(--muted)">{_tick(tick)}{suffix}</text>'
            )
    for at in np.unique(np.linspace(0, longest - 1, 6).astype(int)):
        between = ' class="between"' if 0 < at < longest - 1 else ""
        parts.append(
            f'<text{between} x="{x(int(at)):.1f}" y="{_HEIGHT - 12}" text-anchor="middle" '
            f'fill="var(--muted)">{int(at) + 1}</text>'
        )
    for one, course in zip(kin.specimens, courses, strict=True):
        colour, dash = _style(names, one.trend.target)
        points = " ".join(f"{x(i):.1f},{y(float(v)):.1f}" for i, v in enumerate(course))
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        parts.append(
            f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2"{dashed}>'
            f"<title>{escape(one.trend.target)}</title></polyline>"
        )
    parts.append("</svg>")
    return Markup("".join(parts))


def _tick(value: float) -> str:
    """Write a change at an axis: with its sign, zero without."""
    return f"{value:+.3g}".replace("-", "\N{MINUS SIGN}") if value else "0"
