"""Plots of a sweep that show without JavaScript: heat map, parallel coordinates, Pareto front."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from markupsafe import Markup, escape

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray
from eha_bench.core.per_cent import per_cent
from eha_bench.report.engineering import number

_WIDTH: Final = 920
_MOST_BINS: Final = 12
_MOST_LINES: Final = 400
_OPACITY: Final = (0.25, 0.5, 0.75, 1.0)
_FULL: Final = 0.4
"""Margin from which on a colour is at its fullest."""


@dataclass(frozen=True)
class Axis:
    """A factor or a margin as an axis.

    Attributes:
        name, unit: what it is called. values: (points,) as shown, places of words for words.
        words: what the places stand for; empty for numbers. log: whether equal ratios are equal
            distances.
    """

    name: str
    unit: str
    values: FloatArray
    words: tuple[str, ...] = ()
    log: bool = False

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name} / {self.unit}" if self.unit else self.name

    def bins(self) -> tuple[IndexArray, tuple[str, ...]]:
        """Return the bin of every point, and the bins' labels: levels where they are few."""
        levels, places = np.unique(self.values, return_inverse=True)
        if levels.size <= _MOST_BINS:
            return places, tuple(self.text(float(level)) for level in levels)
        scaled = np.log(self.values) if self.log else self.values
        edges = np.linspace(float(scaled.min()), float(scaled.max()), _MOST_BINS + 1)
        found = np.clip(np.searchsorted(edges, scaled, side="right") - 1, 0, _MOST_BINS - 1)
        middles = 0.5 * (edges[1:] + edges[:-1])
        middles = np.exp(middles) if self.log else middles
        return found, tuple(self.text(float(middle)) for middle in middles)

    def text(self, value: float) -> str:
        """Return a value for people."""
        return self.words[round(value)] if self.words else f"{value:.4g}".replace("-", "−")

    def short_number(self, value: float) -> str:
        """Return a value to three digits, for where there is little room."""
        return self.text(value) if self.words else self.text(float(f"{value:.3g}"))

    def shares(self) -> FloatArray:
        """Return where the points lie on the axis, 0 ... 1."""
        scaled = np.log(self.values) if self.log else self.values
        finite = scaled[np.isfinite(scaled)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
        return np.asarray((scaled - low) / (high - low or 1.0))


def paint(margin: float) -> str:
    """Return the attributes of what has this margin: colour by its sign, opacity by its size."""
    if not math.isfinite(margin):
        return 'fill="var(--grid)"'
    colour = "blue" if margin >= 0.0 else "vermilion"
    level = min(int(abs(margin) / _FULL * len(_OPACITY)), len(_OPACITY) - 1)
    return f'fill="var(--{colour})" fill-opacity="{_OPACITY[level]}"'


def heat_svg(x: Axis, y: Axis, margins: FloatArray) -> Markup:
    """Return the largest margin in every cell of two factors, whatever the others are there."""
    columns, across = x.bins()
    rows, up = y.bins()
    left, bottom, top = 92, 40, 8
    height = top + bottom + max(24 * len(up), 120)
    wide, tall = (_WIDTH - left - 8) / len(across), (height - top - bottom) / len(up)
    best = np.full((len(up), len(across)), np.nan)
    for column, row, margin in zip(columns, rows, margins, strict=True):
        best[row, column] = np.fmax(best[row, column], margin)
    parts = [_svg(height, f"Largest margin over {x.label} and {y.label}")]
    for row, name in enumerate(up):
        at = height - bottom - tall * (row + 1)
        parts.append(_text(left - 6, at + 0.5 * tall + 4, name, "end"))
        for column in range(len(across)):
            value = float(best[row, column])
            title = f"{across[column]}, {name}: " + (
                number(value, 3, sign=True) if math.isfinite(value) else "nothing scored"
            )
            parts.append(
                f'<rect x="{left + wide * column:.1f}" y="{at:.1f}" width="{wide - 1:.1f}" '
                f'height="{tall - 1:.1f}" {paint(value)}><title>{escape(title)}</title></rect>'
            )
    for column, name in enumerate(across):
        parts.append(_text(left + wide * (column + 0.5), height - bottom + 16, name, "middle"))
    parts.append(_text(left + 0.5 * (_WIDTH - left), height - 6, x.label, "middle"))
    parts.append(_text(4, top + 10, y.label, "start"))
    return Markup("".join([*parts, "</svg>"]))


def parallel_svg(axes: Sequence[Axis], passed: BoolArray) -> Markup:
    """Return a line a point over all axes; those that pass lie above."""
    height, top, bottom, side = 314, 58, 24, 60
    gap = (_WIDTH - 2 * side) / max(1, len(axes) - 1)
    shares = np.array([axis.shares() for axis in axes])
    order = np.argsort(passed, kind="stable")
    shown = order if order.size <= _MOST_LINES else order[:: -(-order.size // _MOST_LINES)]
    parts = [_svg(height, "Every point over all factors and margins")]
    for place in shown:
        line = [
            f"{side + gap * k:.0f} {top + (height - top - bottom) * (1.0 - share):.1f}"
            for k, share in enumerate(shares[:, place])
            if math.isfinite(share)
        ]
        colour, opacity = ("blue", 0.8) if passed[place] else ("vermilion", 0.25)
        parts.append(
            f'<path d="M{"L".join(line)}" fill="none" stroke="var(--{colour})" '
            f'stroke-opacity="{opacity}"/>'
        )
    for k, axis in enumerate(axes):
        x = side + gap * k
        finite = axis.values[np.isfinite(axis.values)]
        ends = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
        parts.append(f'<path d="M{x:.0f} {top}V{height - bottom}" stroke="var(--axis)"/>')
        # an outer label starts or ends at the picture's edge: centred it would be cut off
        edge, anchor = {0: (4, "start"), len(axes) - 1: (_WIDTH - 4, "end")}.get(k, (x, "middle"))
        parts.append(_text(edge, 12 + 16 * (k % 2), axis.label, anchor))
        parts.append(_text(x, height - 8, axis.short_number(ends[0]), "middle"))
        parts.append(_text(x, top - 5, axis.short_number(ends[1]), "middle"))
    return Markup("".join([*parts, "</svg>"]))


def pareto_svg(x: Axis, y: Axis, passed: BoolArray) -> Markup:
    """Return the points over two margins, and the front on which neither grows for nothing."""
    height, left, bottom, top = 336, 70, 44, 28
    finite = np.isfinite(x.values) & np.isfinite(y.values)
    parts = [_svg(height, f"{x.name} against {y.name}")]
    if not finite.any():
        return Markup("".join([*parts, "</svg>"]))

    def scale(values: FloatArray, start: float, end: float) -> FloatArray:
        low, high = float(values[finite].min()), float(values[finite].max())
        return start + (end - start) * (values - low) / (high - low or 1.0)

    across = scale(x.values, left, _WIDTH - 20)
    up = scale(y.values, height - bottom, top)
    places = np.flatnonzero(finite)
    shown = places if places.size <= _MOST_LINES else places[:: -(-places.size // _MOST_LINES)]
    for place in shown:
        colour = "blue" if passed[place] else "vermilion"
        parts.append(
            f'<circle cx="{across[place]:.1f}" cy="{up[place]:.1f}" r="3.5" '
            f'fill="var(--{colour})" fill-opacity="0.6"/>'
        )
    best = front(x.values, y.values)
    line = "L".join(f"{across[place]:.1f} {up[place]:.1f}" for place in best)
    parts.append(f'<path d="M{line}" fill="none" stroke="var(--text)" stroke-width="1.5"/>')
    frame = f"M{left - 8} {top}V{height - bottom + 8}H{_WIDTH - 12}"
    parts.append(f'<path d="{frame}" fill="none" stroke="var(--axis)"/>')
    for axis, ends in ((x, (left, _WIDTH - 20)), (y, (height - bottom, top))):
        low, high = float(axis.values[finite].min()), float(axis.values[finite].max())
        for value, at in ((low, ends[0]), (high, ends[1])):
            place_ = (
                (at, height - bottom + 24, "middle") if axis is x else (left - 14, at + 4, "end")
            )
            parts.append(_text(place_[0], place_[1], number(value, 3, sign=True), place_[2]))
    parts.append(_text(0.5 * (left + _WIDTH), height - 8, f"margin of {x.name}", "middle"))
    parts.append(_text(4, 12, f"margin of {y.name}", "start"))
    return Markup("".join([*parts, "</svg>"]))


def front(first: FloatArray, second: FloatArray) -> list[int]:
    """Return the points that no other beats in both, by growing `first`; both larger is better."""
    finite = np.flatnonzero(np.isfinite(first) & np.isfinite(second))
    order = finite[np.lexsort((-second[finite], -first[finite]))]
    found, most = [], -math.inf
    for place in order:
        if second[place] > most:
            found.append(int(place))
            most = float(second[place])
    return found[::-1]


def pass_share_bars(axis: Axis, margins: FloatArray) -> Markup:
    """Return a small bar a bin of a factor: the share of points there that keep a limit."""
    places, names = axis.bins()
    width = 100.0 / len(names)
    parts = []
    for k, name in enumerate(names):
        own = margins[places == k]
        share = float(np.mean(own >= 0.0)) if own.size else 0.0
        tall = 12.0 * share
        parts.append(
            f'<rect x="{width * k:.1f}" y="0" width="{width - 1:.1f}" height="12" '
            f'fill="var(--vermilion)" fill-opacity="0.35"><title>{escape(name)}: kept by '
            f"{per_cent(share)}</title></rect>"
            f'<rect x="{width * k:.1f}" y="{12 - tall:.1f}" width="{width - 1:.1f}" '
            f'height="{tall:.1f}" fill="var(--blue)"><title>{escape(name)}: kept by '
            f"{per_cent(share)}</title></rect>"
        )
    shares = [
        float(np.mean(margins[places == k] >= 0.0)) if (places == k).any() else 0.0
        for k in range(len(names))
    ]
    title = ", ".join(
        f"{name} {per_cent(share)}" for name, share in zip(names, shares, strict=True)
    )
    return Markup(
        f'<svg class="gauge" viewBox="0 0 100 12" preserveAspectRatio="none" role="img" '
        f'aria-label="kept: {escape(title)}">{"".join(parts)}</svg>'
    )


def conflict(margins: FloatArray) -> tuple[int, int] | None:
    """Return the two limits whose margins go against each other most; None where none are two.

    By Spearman's rank correlation of the points where both are scored.
    """
    from scipy.stats import rankdata

    count = margins.shape[1]
    worst: tuple[float, tuple[int, int]] | None = None
    for a in range(count):
        for b in range(a + 1, count):
            both = np.isfinite(margins[:, a]) & np.isfinite(margins[:, b])
            ranks = [rankdata(margins[both, k]) for k in (a, b)]
            if both.sum() < 3 or any(np.ptp(rank) == 0.0 for rank in ranks):
                continue
            found = float(np.corrcoef(ranks[0], ranks[1])[0, 1])
            if worst is None or found < worst[0]:
                worst = found, (a, b)
    return worst[1] if worst is not None else None


def _svg(height: float, label: str) -> str:
    return (
        f'<svg viewBox="0 0 {_WIDTH} {height:.0f}" role="img" font-size="12" '
        f'aria-label="{escape(label)}">'
    )


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return (
        f'<text x="{x:.0f}" y="{y:.0f}" text-anchor="{anchor}" fill="var(--muted)">'
        f"{escape(text)}</text>"
    )
