"""Nights by metrics as a heat map: a row a metric, a cell a night, how far off and which way.

A row is one small SVG with a path a colour, so that a hundred metrics stay a small page.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from markupsafe import Markup

from eha_bench.trends.index import Night
from eha_bench.trends.trend import Trend

MOST_NIGHTS: Final = 90
MOST_METRICS: Final = 200
LEVELS: Final = (2.0, 4.0, 8.0)
"""Standard deviations from the usual level from which on a cell has its next colour."""

_OPACITIES: Final = (0.3, 0.6, 1.0)
_COLOURS: Final = {"worse": "var(--vermilion)", "better": "var(--blue)", "off": "var(--purple)"}


@dataclass(frozen=True)
class HeatRow:
    """A metric's row.

    Attributes:
        cells: the drawing.
        title: description for screen readers.
    """

    cells: Markup
    title: str


def heat_row(trend: Trend, nights: Sequence[Night]) -> HeatRow:
    """Return the row of a trend over nights (at most `MOST_NIGHTS`, in order)."""
    by_night = {night.id: place for place, night in enumerate(trend.nights)}
    usual = float(np.median(trend.values))
    spread = trend.course.sigma
    squares: dict[tuple[str, int], list[int]] = {}
    missing, off = [], 0
    first = next((at for at, night in enumerate(nights) if night.id in by_night), len(nights))
    for at, night in enumerate(nights):
        place = by_night.get(night.id)
        if place is None:
            if at > first and (night.suite, night.target) == (trend.suite, trend.target):
                missing.append(at)
            continue
        away = float(trend.values[place]) - usual
        level = _level(away, spread)
        if level >= 0:
            off += 1
            squares.setdefault((_way(trend, usual, away), level), []).append(at)
    paths = [
        f'<path d="{_cells(places)}" fill="{_COLOURS[way]}" fill-opacity="{_OPACITIES[level]}"/>'
        for (way, level), places in sorted(squares.items())
    ]
    if missing:
        marks = "".join(f"M{at + 0.3} .3h.4v.4h-.4z" for at in missing)
        paths.append(f'<path d="{marks}" fill="var(--muted)"/>')
    title = (
        f"{off} of {len(by_night)} nights {LEVELS[0]:g} standard deviations or more from the "
        "usual value"
    )
    title += f", no value in {len(missing)}" if missing else ""
    return HeatRow(
        Markup(
            f'<svg class="heat" viewBox="0 0 {len(nights)} 1" preserveAspectRatio="none" '
            f'role="img" aria-label="{title}"><rect width="{len(nights)}" height="1" '
            f'fill="var(--raised)"/>{"".join(paths)}</svg>'
        ),
        title,
    )


def _level(away: float, spread: float) -> int:
    """Return the index of the colour, -1 for none."""
    if away == 0.0:
        return -1
    deviations = abs(away) / spread if spread > 0.0 else math.inf
    return sum(deviations >= level for level in LEVELS) - 1


def _way(trend: Trend, usual: float, away: float) -> str:
    if not math.isnan(trend.aim):
        return "worse" if abs(usual + away - trend.aim) > abs(usual - trend.aim) else "better"
    if trend.better == 0:
        return "off"
    return "worse" if away * trend.better < 0.0 else "better"


def _cells(places: Sequence[int]) -> str:
    """Return the outline of cells, neighbours as one rectangle."""
    parts, start = [], places[0]
    for at, after in zip(places, [*places[1:], -1], strict=True):
        if after != at + 1:
            parts.append(f"M{start} 0h{at + 1 - start}v1h-{at + 1 - start}z")
            start = after
    return "".join(parts)
