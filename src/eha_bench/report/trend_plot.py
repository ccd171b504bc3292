"""A trend as an inline SVG: a point a night that links to its report, level, limits, changes.

Written out here and not by matplotlib: a site has hundreds of these, made again every night, and
every point is a link. The ticks are matplotlib's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from markupsafe import Markup, escape
from matplotlib.ticker import MaxNLocator

from eha_bench.core.arrays import FloatArray
from eha_bench.report.engineering import DisplayUnit, display_unit, number
from eha_bench.trends.terms import Kind
from eha_bench.trends.trend import Trend

WIDTH: Final = 920
HEIGHT: Final = 330
_LEFT, _RIGHT, _TOP, _BOTTOM = 62, 12, 22, 34
_MOST_LINKED: Final = 3000


def unit_of(trend: Trend) -> DisplayUnit:
    """Return the unit that a trend is shown in."""
    return display_unit(trend.unit, trend.values.tolist(), metric=trend.metric)


def trend_svg(trend: Trend, names: Sequence[str], links: Sequence[str], *, title: str) -> Markup:
    """Return the plot of a trend.

    Args:
        trend: of at least one night.
        names: what each night is called (date and revision).
        links: to each night's report; "" for none.
        title: what a screen reader says.
    """
    unit = unit_of(trend)
    values = unit.factor * trend.values + unit.offset
    line = unit.factor * trend.course.line + unit.offset
    limits = [unit.from_si(limit) for limit in trend.limits if math.isfinite(limit)]
    bounds = [unit.from_si(bound) for bound in trend.bounds if math.isfinite(bound)]
    low, high = _range(values, line, [*limits, *bounds])
    count = values.size
    wide = max(1, count - 1)

    def x(index: float) -> float:
        return _LEFT + (WIDTH - _LEFT - _RIGHT) * (index / wide if count > 1 else 0.5)

    def y(value: float) -> float:
        share = (min(max(value, low), high) - low) / (high - low)
        return HEIGHT - _BOTTOM - (HEIGHT - _TOP - _BOTTOM) * share

    parts = [
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="group" aria-labelledby="plot-title" '
        f'font-size="12"><title id="plot-title">{escape(title)}</title>'
    ]
    if limits:
        top, bottom = y(limits[1]), y(limits[0])
        left = x(trend.course.changes[-1].start if trend.course.changes else 0)
        parts.append(
            f'<rect x="{left:.1f}" y="{top:.1f}" width="{WIDTH - _RIGHT - left:.1f}" '
            f'height="{max(bottom - top, 1.0):.1f}" fill="var(--good)" fill-opacity="0.12"/>'
        )
    parts.append(axes(low, high, y, names, x))
    for change in trend.course.changes:
        at = x(change.start - 0.5)
        word = "step" if change.kind is Kind.STEP else "drift"
        parts.append(
            f'<line x1="{at:.1f}" x2="{at:.1f}" y1="{_TOP - 6}" y2="{HEIGHT - _BOTTOM}" '
            f'stroke="var(--limit)" stroke-dasharray="5 3"/>'
            f'<text x="{at:.1f}" y="{_TOP - 9}" text-anchor="middle" fill="var(--limit)">'
            f"{word}</text>"
        )
    for bound, beyond in zip(bounds, _accepted_sides(trend.bounds), strict=True):
        at = y(bound)
        places = _places(abs(float(f"{bound:.4g}")))
        label = f"accepted {beyond} {number(bound, places)}{unit.suffix}"
        if low <= bound <= high:
            parts.append(
                f'<line x1="{_LEFT}" x2="{WIDTH - _RIGHT}" y1="{at:.1f}" y2="{at:.1f}" '
                f'stroke="var(--safety)" stroke-dasharray="8 3 2 3"/>'
            )
        else:  # a line at the edge would stand for a value that it has not
            label = f"{'↑' if bound > high else '↓'} {label}"
        parts.append(
            f'<text x="{WIDTH - _RIGHT}" y="{at - 4:.1f}" text-anchor="end" '
            f'fill="var(--safety)">{label}</text>'
        )
    path = " ".join(
        f"{'L' if i else 'M'}{x(at):.1f} {y(v):.1f}"
        for i, (at, v) in enumerate(_corners(line, _steps(trend)))
    )
    parts.append(f'<path d="{path}" fill="none" stroke="var(--blue)" stroke-width="1.6"/>')
    parts.append(_points(values, unit, names, links, x, y, (low, high)))
    parts.append("</svg>")
    return Markup("".join(parts))


def sparkline(trend: Trend) -> Markup:
    """Return a small plot of the level and the newest value, for a table."""
    values = trend.values
    low, high = _range(values, trend.course.line, [])
    wide = max(1, values.size - 1)

    def place(index: int, value: float) -> str:
        share = (min(max(value, low), high) - low) / (high - low)
        return f"{100.0 * index / wide:.1f} {19.0 - 18.0 * share:.1f}"

    shown = np.unique(np.linspace(0, values.size - 1, min(values.size, 80)).astype(int))
    path = "M" + "L".join(place(int(i), float(values[i])) for i in shown)
    return Markup(
        '<svg class="gauge" viewBox="0 0 100 20" preserveAspectRatio="none" aria-hidden="true" '
        f'focusable="false"><path d="{path}" fill="none" stroke="var(--blue)" '
        'vector-effect="non-scaling-stroke"/></svg>'
    )


def _range(values: FloatArray, line: FloatArray, limits: Sequence[float]) -> tuple[float, float]:
    """Return what is shown: all but a few wild nights, and the limits unless they are far off."""
    drawn = np.concatenate((values[-1:], line, np.quantile(values, (0.005, 0.995))))
    low, high = float(drawn.min()), float(drawn.max())
    span = high - low
    low, high = (
        min([low, *(max(limit, low - span) for limit in limits)]),
        max([high, *(min(limit, high + span) for limit in limits)]),
    )
    pad = 0.06 * (high - low) or 0.05 * abs(high) or 1.0
    return low - pad, high + pad


def _accepted_sides(bounds: tuple[float, float]) -> list[str]:
    """Return on which side of each finite bound values are accepted."""
    sides = ("≥", "≤")
    return [side for side, bound in zip(sides, bounds, strict=True) if math.isfinite(bound)]


def _steps(trend: Trend) -> list[int]:
    return [change.start for change in trend.course.changes if change.kind is Kind.STEP]


def _corners(line: FloatArray, steps: Sequence[int]) -> list[tuple[float, float]]:
    """Return the points at which a piecewise straight line bends; a step is upright."""
    points: list[tuple[float, float]] = []
    scale = float(np.abs(line).max()) or 1.0
    ends = [0, *steps, line.size]
    for first, after in pairwise(ends):
        part = line[first:after]
        if not part.size:
            continue
        left = first - 0.5 if first else 0.0
        right = after - 0.5 if after < line.size else line.size - 1.0
        slopes = np.diff(part) if part.size > 1 else np.zeros(1)
        points.append((left, float(part[0] - slopes[0] * (first - left))))
        bends = np.flatnonzero(np.abs(np.diff(part, 2)) > 1e-9 * scale) + 1
        points += [(float(first + at), float(part[at])) for at in bends]
        points.append((right, float(part[-1] + slopes[-1] * (right - (after - 1)))))
    return points


def axes(low: float, high: float, y: object, names: Sequence[str], x: object) -> str:
    """Return grid and ticks: values on the left, the nights' names below."""
    assert callable(y)
    assert callable(x)
    parts = []
    ticks = [float(tick) for tick in MaxNLocator(5).tick_values(low, high)]
    places = _places(ticks[1] - ticks[0])
    for tick in ticks:
        if low <= tick <= high:
            at = y(tick)
            parts.append(
                f'<line x1="{_LEFT}" x2="{WIDTH - _RIGHT}" y1="{at:.1f}" y2="{at:.1f}" '
                f'stroke="var(--grid)"/><text class="tick-value" x="{_LEFT - 6}" y="{at + 4:.1f}" '
                f'text-anchor="end" fill="var(--muted)">{number(tick, places)}</text>'
            )
    count = len(names)
    shown = np.unique(np.linspace(0, count - 1, min(count, 6)).astype(int))
    for place, index in enumerate(shown):
        anchor = "start" if place == 0 else "end" if index == count - 1 else "middle"
        anchor = "middle" if count == 1 else anchor
        between = ' class="between"' if anchor == "middle" and count > 1 else ""
        parts.append(
            f'<text{between} x="{x(int(index)):.1f}" y="{HEIGHT - 12}" text-anchor="{anchor}" '
            f'fill="var(--muted)">{escape(names[index][:10])}</text>'
        )
    return "".join(parts)


def _places(step: float) -> int:
    """Return how many digits after the point tell ticks apart that are `step` apart."""
    for places in range(9):
        if abs(round(step, places) - step) <= 1e-6 * step:
            return places
    return 9


def _points(
    values: FloatArray,
    unit: DisplayUnit,
    names: Sequence[str],
    links: Sequence[str],
    x: object,
    y: object,
    shown: tuple[float, float],
) -> str:
    assert callable(x)
    assert callable(y)
    radius = 2.6 if values.size <= 400 else 1.8
    first = max(0, values.size - _MOST_LINKED)
    parts = []
    for index in range(first, values.size):
        value = float(values[index])
        outside = not shown[0] <= value <= shown[1]
        newest = index == values.size - 1
        colour = "var(--limit)" if outside else "var(--text)" if newest else "var(--muted)"
        circle = (
            f'<circle cx="{x(index):.1f}" cy="{y(value):.1f}" '
            f'r="{2.0 * radius if newest else radius}" fill="{colour}">'
            f"<title>{escape(names[index])}: {value:.5g}{unit.suffix}</title></circle>"
        )
        link = links[index]
        parts.append(f'<a href="{escape(link)}">{circle}</a>' if link else circle)
    return "".join(parts)
