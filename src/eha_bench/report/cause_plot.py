"""A cause over the nights as an inline SVG: estimates with intervals, its course, its limit."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from markupsafe import Markup, escape

from eha_bench.core.arrays import FloatArray
from eha_bench.report.causes_text import unit_of_cause
from eha_bench.report.engineering import DisplayUnit, metric_name
from eha_bench.report.run_report import moment
from eha_bench.report.trend_plot import HEIGHT, WIDTH, axes
from eha_bench.trends.wear import CauseTrend, Wear

_LEFT, _RIGHT, _TOP, _BOTTOM = 62, 12, 22, 34  # as in a trend of a metric
_HALF_WIDTH: Final = 1.959963984540054


def cause_svg(trend: CauseTrend, wear: Wear | None, *, number: int) -> Markup:
    """Return the plot of a cause.

    Args:
        trend: of at least one night. wear: the finding about it, None where it does not move.
        number: of the plot on its page, which makes its title's id unique.
    """
    unit = scaled_unit(trend)
    values = unit.factor * trend.values + unit.offset
    half = abs(unit.factor) * _HALF_WIDTH * trend.deviations
    line = unit.factor * trend.line + unit.offset
    crossing = wear.crossing if wear is not None else None
    low, high = _range(values, half, line, math.nan if crossing is None else
                       unit.from_si(crossing.value))  # fmt: skip
    count = values.size
    wide = max(1, count - 1)
    names = [moment(night.started) or night.path for night in trend.nights]

    def x(index: float) -> float:
        return _LEFT + (WIDTH - _LEFT - _RIGHT) * (index / wide if count > 1 else 0.5)

    def y(value: float) -> float:
        share = (min(max(value, low), high) - low) / (high - low)
        return HEIGHT - _BOTTOM - (HEIGHT - _TOP - _BOTTOM) * share

    title = f"{trend.name} over {count} nights"
    if unit.symbol:
        title += f", {unit.symbol}"
    parts = [
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-labelledby="cause-{number}" '
        f'font-size="12"><title id="cause-{number}">{escape(title)}</title>',
        axes(low, high, y, names, x),
    ]
    if crossing is not None and math.isfinite(crossing.value):
        at = y(unit.from_si(crossing.value))
        label = f"first limit: {crossing.trial}, {metric_name(crossing.metric)}"
        parts.append(
            f'<line x1="{_LEFT}" x2="{WIDTH - _RIGHT}" y1="{at:.1f}" y2="{at:.1f}" '
            f'stroke="var(--safety)" stroke-dasharray="8 3 2 3"/>'
            f'<text x="{WIDTH - _RIGHT}" y="{at + 14:.1f}" text-anchor="end" '
            f'fill="var(--safety)">{escape(label)}</text>'
        )
    if wear is not None and wear.since in trend.nights:
        at = x(trend.nights.index(wear.since) - 0.5)
        parts.append(
            f'<line x1="{at:.1f}" x2="{at:.1f}" y1="{_TOP - 6}" y2="{HEIGHT - _BOTTOM}" '
            f'stroke="var(--limit)" stroke-dasharray="5 3"/>'
            f'<text x="{at:.1f}" y="{_TOP - 9}" text-anchor="middle" fill="var(--limit)">'
            f"change</text>"
        )
    path = " ".join(f"{'L' if i else 'M'}{x(i):.1f} {y(v):.1f}" for i, v in enumerate(line))
    parts.append(f'<path d="{path}" fill="none" stroke="var(--blue)" stroke-width="1.6"/>')
    for place, (value, width) in enumerate(zip(values, half, strict=True)):
        night = f"{names[place]}: {value:.5g} ± {width:.2g}{unit.suffix}"
        parts.append(
            f'<g><title>{escape(night)}</title><line x1="{x(place):.1f}" x2="{x(place):.1f}" '
            f'y1="{y(value - width):.1f}" y2="{y(value + width):.1f}" stroke="var(--muted)"/>'
            f'<circle cx="{x(place):.1f}" cy="{y(value):.1f}" r="2.6" fill="var(--text)"/></g>'
        )
    parts.append("</svg>")
    return Markup("".join(parts))


def scaled_unit(trend: CauseTrend) -> DisplayUnit:
    """Return the unit of a plot's axis: with a power of ten where numbers are tiny or huge."""
    unit = unit_of_cause(trend)
    shown = unit.factor * np.append(trend.values, trend.healthy) + unit.offset
    largest = float(np.abs(shown).max())
    if not 0.0 < largest < math.inf or 1e-2 <= largest < 1e5 or unit.offset:
        return unit
    power = 3 * math.floor(math.log10(largest) / 3.0)
    return DisplayUnit(
        f"1e{power} {unit.symbol}".replace("-", "−").strip(), unit.factor * 10.0**-power
    )


def _range(
    values: FloatArray, half: FloatArray, line: FloatArray, limit: float
) -> tuple[float, float]:
    """Return what is shown: the nights with their usual interval, and the limit if it is near."""
    usual = float(np.median(half)) if half.size else 0.0
    drawn = np.concatenate((line, np.quantile(values, (0.01, 0.99)), values[-1:]))
    low, high = float(drawn.min()) - usual, float(drawn.max()) + usual
    span = max(high - low, 1e-300)
    if math.isfinite(limit):
        low, high = min(low, max(limit, low - 9.0 * span)), max(high, min(limit, high + 9.0 * span))
    pad = 0.06 * (high - low) or 0.05 * abs(high) or 1.0
    return low - pad, high + pad
