"""A Bode plot as a page embeds it: static for every reader, with the data that bode.js draws."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from eha_bench.core.arrays import FloatArray
from eha_bench.report.bode import Bode, BodeCurve, BodePanel
from eha_bench.report.embed_svg import SHADES
from eha_bench.report.engineering import number
from eha_bench.report.figures import plot_style, render_svg
from eha_bench.report.marks import Role

_WIDTH: Final = 662.0 / 72.0
_HEIGHTS: Final = (190.0, 130.0, 90.0)
_SHADES: Final = {Role.LEVEL: "muted", Role.MEASURED: "text", Role.LIMIT: "limit"}


@dataclass(frozen=True)
class BodeView:
    """What the macro `bode_plot` of `parts/bode.html.j2` shows.

    Attributes:
        key: unique on its page.
        svg: the static plot.
        data: what bode.js draws in its place.
        left_out: frequency as text, and the reason, of every point that no score rests on.
        method: how the response was found.
    """

    key: str
    svg: Markup
    data: dict[str, Any]
    left_out: tuple[tuple[str, str], ...]
    method: str


def bode_view(bode: Bode, *, key: str, title: str) -> BodeView:
    """Draw a Bode plot and pack its curves.

    Args:
        bode: what to show.
        key: unique on its page; letters, digits and dashes.
        title: what a screen reader says.
    """
    left_out = tuple(
        (f"{number(frequency)}\N{NO-BREAK SPACE}Hz", why) for frequency, why in bode.left_out
    )
    return BodeView(key, bode_svg(bode, key=key, title=title), _data(bode), left_out, bode.method)


def bode_svg(bode: Bode, *, key: str, title: str) -> Markup:
    """Draw gain, phase and coherence one below the other over a logarithmic frequency axis."""
    with plot_style():
        figure = Figure(figsize=(_WIDTH, (sum(_HEIGHTS) + 110.0) / 72.0), layout="constrained")
        rows = figure.subplots(3, 1, sharex=True, height_ratios=_HEIGHTS)
        for axes, panel in zip(rows, bode.panels, strict=True):
            _draw(axes, bode.frequency, panel)
        low, high = float(bode.frequency[0]), float(bode.frequency[-1])
        rows[-1].set_xlim(low / 1.08, high * 1.08)
        rows[-1].set_xlabel("frequency / Hz")
        few = high / low < 300.0
        rows[-1].xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
        rows[-1].xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        rows[-1].xaxis.set_minor_formatter(NullFormatter())
        return render_svg(figure, key, title=title)


def _draw(axes: Axes, frequency: FloatArray, panel: BodePanel) -> None:
    axes.set_xscale("log")
    axes.set_title(panel.heading + (f" / {panel.unit}" if panel.unit else ""))
    if panel.low is not None and panel.high is not None:
        axes.set_ylim(panel.low, panel.high + 0.03 * (panel.high - panel.low))
    for curve in panel.curves:
        _draw_curve(axes, frequency, curve)
    for mark in panel.marks:
        shade = SHADES[_SHADES[mark.role]]
        if mark.level is not None:
            axes.axhline(mark.level, color=shade, linewidth=0.9, linestyle=(0, (1, 2)))
            axes.annotate(
                mark.label, (0.0, mark.level), xycoords=axes.get_yaxis_transform(),
                xytext=(4, 2), textcoords="offset points", fontsize=7.5, color=shade,
            )  # fmt: skip
        if mark.frequency is not None:
            axes.axvline(mark.frequency, color=shade, linewidth=0.9, linestyle=(0, (1, 2)))
            left = mark.frequency > math.sqrt(float(frequency[0] * frequency[-1]))
            axes.annotate(
                mark.label, (mark.frequency, 1.0), xycoords=axes.get_xaxis_transform(),
                xytext=(-4 if left else 4, -9), textcoords="offset points", fontsize=7.5,
                color=shade, ha="right" if left else "left",
            )  # fmt: skip
    if panel.low is None:
        axes.set_ylim(*_span(panel))
    if len(panel.curves) > 1:
        axes.legend(loc="lower left", ncols=len(panel.curves))


def _span(panel: BodePanel) -> tuple[float, float]:
    """Return the ends of the axis: all curves, intervals not, which may reach down to nothing."""
    values = np.concatenate([curve.values for curve in panel.curves])
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    pad = 0.12 * max(high - low, 1.0)
    return low - pad, high + pad


def _draw_curve(axes: Axes, frequency: FloatArray, curve: BodeCurve) -> None:
    shade = SHADES[curve.colour]
    there = np.isfinite(curve.values)
    where, values = frequency[there], curve.values[there]
    if curve.rings:
        axes.plot(where, values, "o", mfc="none", mec=shade, ms=4.0, label=curve.label)
        return
    low, high = curve.low[there], curve.high[there]
    known = np.isfinite(high)
    if np.any(known):
        floor = np.where(np.isfinite(low), low, values - 60.0)
        axes.vlines(where[known], floor[known], high[known], color=shade, linewidth=2.2, alpha=0.35)
    (line,) = axes.plot(where, values, color=shade, linewidth=1.1, label=curve.label)
    if curve.dashed:
        line.set_linestyle((0, (4, 2)))
    else:
        line.set_marker("o")
        line.set_markersize(2.6)


def _data(bode: Bode) -> dict[str, Any]:
    """Return the plot as JSON: numbers with five digits, null for what is not known."""
    return {
        "frequency": _numbers(bode.frequency),
        "panels": [
            {
                "heading": panel.heading,
                "unit": panel.unit,
                "low": panel.low,
                "high": panel.high,
                "curves": [
                    {
                        "label": curve.label,
                        "colour": curve.colour,
                        "dashed": curve.dashed,
                        "rings": curve.rings,
                        "values": _numbers(curve.values),
                        "low": _numbers(curve.low),
                        "high": _numbers(curve.high),
                    }
                    for curve in panel.curves
                ],
                "marks": [{**asdict(mark), "role": _SHADES[mark.role]} for mark in panel.marks],
            }
            for panel in bode.panels
        ],
    }


def _numbers(values: FloatArray) -> list[float | None]:
    return [float(f"{value:.5g}") if math.isfinite(value) else None for value in values.tolist()]
