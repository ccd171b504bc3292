"""The page of P(pass): every limit's probability, what each unknown costs, bands of the draws."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from markupsafe import Markup, escape

from eha_bench.core.arrays import FloatArray
from eha_bench.core.per_cent import per_cent
from eha_bench.report.engineering import (
    DisplayUnit,
    channel_name,
    display_unit,
    limit_text,
    metric_name,
    number,
)
from eha_bench.report.page import Fact, write_page
from eha_bench.report.ticks import Ticks, ticks_between
from eha_bench.sweeps.chance import Chance
from eha_bench.sweeps.probability import Probability, ResponseBand

PAGE: Final = "probability.html"
_WIDTH: Final = 920


@dataclass(frozen=True)
class ChanceRow:
    """A limit, or the whole suite, with its probability."""

    name: str
    about: str
    chance: str
    interval: str
    margin: str
    look: str
    bar: Markup


@dataclass(frozen=True)
class UnknownRow:
    """An unknown and what it costs."""

    name: str
    share: str
    lower: str
    upper: str


def write_probability_page(
    found: Probability, folder: Path, suite: str, target: str, facts: tuple[Fact, ...] = ()
) -> Path:
    """Write probability.html into a folder; return its path.

    Args:
        found: what is shown. folder: where. suite, target: their names. facts: for the foot.
    """
    whole = found.suite
    content = {
        "suite": suite,
        "target": target,
        "look": _look(whole),
        "word": f"P(pass) {whole.value:.3f}",
        "headline": f"{whole.kept} of {whole.draws} draws keep all limits; 95 % interval "
        f"{whole.low:.3f} … {whole.high:.3f}.",
        "limits": [_row(found, place) for place in range(len(found.limits))],
        "unknowns": [
            UnknownRow(
                item.key,
                per_cent(item.share),
                f"{item.lower.value:.2f}",
                f"{item.upper.value:.2f}",
            )
            for item in found.unknowns
        ],
        "bands": [(band.trial, _heading(band), band_svg(band)) for band in found.bands],
        "notes": found.notes,
        "report": (folder / "report.html").is_file(),
        "facts": facts,
    }
    title = f"P(pass) of {suite}"
    return write_page(folder / PAGE, "probability.html.j2", content, title=title)


def _heading(band: ResponseBand) -> str:
    symbol = band_unit(band).symbol
    return channel_name(band.channel) + (f" / {symbol}" if symbol else "")


def _look(chance: Chance) -> str:
    if chance.kept == chance.draws:
        return "passed"
    return "failed" if chance.value < 0.5 else "warned"


def _row(found: Probability, place: int) -> ChanceRow:
    limit, chance = found.limits[place], found.of(place)
    margins = found.margins[:, place]
    scored = margins[np.isfinite(margins)]
    unscored = f"; {margins.size - scored.size} not scored" if scored.size < margins.size else ""
    name = metric_name(limit.metric)
    ends = np.quantile(scored, (0.025, 0.975)) if scored.size else (math.nan, math.nan)
    return ChanceRow(
        limit.trial,
        f"{name} ({channel_name(limit.channel)}) {limit_text(limit.text)}",
        f"{chance.value:.3f}",
        f"{chance.low:.3f} … {chance.high:.3f}",
        " … ".join(number(float(end), 3, sign=True) for end in ends) + unscored,
        _look(chance),
        _bar(chance),
    )


def _bar(chance: Chance) -> Markup:
    low, high, value = (100.0 * item for item in (chance.low, chance.high, chance.value))
    return Markup(
        '<svg class="gauge" viewBox="0 0 100 12" preserveAspectRatio="none" aria-hidden="true" '
        'focusable="false"><rect class="track" y="5.2" width="100" height="1.6"/>'
        f'<rect class="within" x="{low:.1f}" y="2" width="{max(high - low, 0.6):.1f}" height="8"/>'
        f'<rect class="needle" x="{min(value, 97.6):.1f}" width="2.4" height="12"/></svg>'
    )


def band_svg(band: ResponseBand) -> Markup:
    """Return the band of a trial's channel over its reference, as one SVG."""
    height, left, right, top, bottom = 320, 70, 14, 12, 40
    unit = band_unit(band)
    curves = [
        np.array([unit.from_si(float(value)) for value in item])
        for item in (band.reference, band.low, band.middle, band.high)
    ]
    whole = np.concatenate(curves)
    low, high = float(np.nanmin(whole)), float(np.nanmax(whole))
    pad = 0.06 * (high - low) or 1.0
    low, high = low - pad, high + pad
    start, stop = float(band.time[0]), float(band.time[-1])

    def x(time: float) -> float:
        return left + (_WIDTH - left - right) * (time - start) / (stop - start or 1.0)

    def y(value: float) -> float:
        return height - bottom - (height - top - bottom) * (value - low) / (high - low)

    def path(values: FloatArray) -> str:
        return "L".join(
            f"{x(float(t)):.1f} {y(float(v)):.1f}"
            for t, v in zip(band.time, values, strict=True)
            if math.isfinite(v)
        )

    reference, lower, middle, upper = curves
    backwards = "L".join(reversed(path(lower).split("L")))
    parts = [
        f'<svg viewBox="0 0 {_WIDTH} {height}" role="img" font-size="12" aria-label="'
        f'{escape(band.trial)}: 95 % band of {escape(channel_name(band.channel))}">',
        *(_level(y(value), label, left) for value, label in _ticks(low, high, 5)),
        f'<path d="M{path(upper)}L{backwards}Z" fill="var(--blue)" fill-opacity="0.3"/>',
        f'<path d="M{path(middle)}" fill="none" stroke="var(--blue)" stroke-width="1.5"/>',
        f'<path d="M{path(reference)}" fill="none" stroke="var(--reference)" '
        'stroke-dasharray="5 3"/>',
    ]
    clock = display_unit("s", (start, stop))
    moments = _ticks(clock.from_si(start), clock.from_si(stop), 8)
    for place, (time, label) in enumerate(moments):
        between = "" if place in (0, len(moments) - 1) else ' class="between"'
        parts.append(
            f'<text{between} x="{x(time / clock.factor):.1f}" y="{height - 22}" '
            f'text-anchor="middle" fill="var(--muted)">{escape(label)}</text>'
        )
    parts.append(
        f'<text class="axis-name" x="{0.5 * (left + _WIDTH):.0f}" y="{height - 4}" '
        f'text-anchor="middle" fill="var(--muted)">time / {escape(clock.symbol)}</text></svg>'
    )
    return Markup("".join(parts))


def _ticks(low: float, high: float, most: int) -> list[tuple[float, str]]:
    """Return round values of an axis with their labels."""
    found = ticks_between(low, high, most) if high > low else Ticks((low,), 3)
    return list(zip(found.values, found.labels, strict=True))


def _level(at: float, label: str, left: int) -> str:
    """Return a line across the plot, and its value at the left."""
    return (
        f'<line x1="{left}" x2="{_WIDTH}" y1="{at:.1f}" y2="{at:.1f}" stroke="var(--grid)"/>'
        f'<text class="tick-value" x="{left - 6}" y="{at + 4:.1f}" text-anchor="end" '
        f'fill="var(--muted)">{escape(label)}</text>'
    )


def band_unit(band: ResponseBand) -> DisplayUnit:
    """Return the unit in which a band is drawn."""
    return display_unit(band.unit, [float(np.nanmax(np.abs(band.middle)))])
