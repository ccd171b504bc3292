"""The static plot of a run: panels over one time axis, with levels, bands, limits and labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from eha_bench.core.recording import Recording
from eha_bench.report.embed_svg import SHADES
from eha_bench.report.engineering import DisplayUnit
from eha_bench.report.envelope import envelope_indices
from eha_bench.report.figures import plot_style, render_svg
from eha_bench.report.labels import Box, LabelPlacer
from eha_bench.report.marks import LevelLine, Mark, Point, Role, TimeBand, TimeLine, ValueBand
from eha_bench.report.panels import Panel
from eha_bench.report.scene import Scene

FloatArray = NDArray[np.float64]

WIDTH: Final = 9.2
LEFT: Final = 0.62
RIGHT: Final = 0.12
FIRST_HEIGHT: Final = 2.7
OTHER_HEIGHT: Final = 1.2
POINTS: Final = 2000
LABEL_SIZE: Final = 7.5
CURVES: Final = 2.5
MILLISECONDS_BELOW: Final = 2.0

_ROLE_SHADE: Final = {
    Role.LEVEL: "muted",
    Role.BAND: "good",
    Role.LIMIT: "limit",
    Role.SAFETY: "safety",
    Role.MEASURED: "text",
    Role.UNSCORED: "muted",
}
_DASHES: Final[dict[Role, tuple[float, tuple[float, ...]]]] = {
    Role.LEVEL: (0, (1, 2)),
    Role.BAND: (0, (1, 2)),
    Role.LIMIT: (0, (6, 2)),
    Role.SAFETY: (0, (6, 2, 1, 2)),
    Role.MEASURED: (0, (1, 2)),
    Role.UNSCORED: (0, (1, 2)),
}


@dataclass(frozen=True)
class TimeAxis:
    """Start and stop of what is shown in s, and the unit it is shown in."""

    start: float
    stop: float

    @property
    def unit(self) -> DisplayUnit:
        """Milliseconds for short stretches."""
        short = self.stop - self.start <= MILLISECONDS_BELOW
        return DisplayUnit("ms", 1e3) if short else DisplayUnit("s")


def scene_svg(scene: Scene, *, key: str, title: str, points: int = POINTS) -> Markup:
    """Draw a recording: one panel below the other over one time axis, with its marks.

    Args:
        scene: of at least one panel.
        key: unique on its page.
        title: what a screen reader says.
        points: kept of each curve, about; see `envelope_indices`.
    """
    recording, panels, marks = scene.recording, scene.panels, scene.marks
    axis = TimeAxis(float(recording.time[0]), float(recording.time[-1]))
    heights = [FIRST_HEIGHT] + [OTHER_HEIGHT] * (len(panels) - 1)
    with plot_style():
        gap, top, bottom = 0.36, 0.30, 0.44
        height = sum(heights) + gap * (len(panels) - 1) + top + bottom
        figure = Figure(figsize=(WIDTH, height))
        lower = height - top
        first: Axes | None = None
        for panel, tall in zip(panels, heights, strict=True):
            lower -= tall
            place = (LEFT / WIDTH, lower / height, 1.0 - (LEFT + RIGHT) / WIDTH, tall / height)
            axes = figure.add_axes(place, sharex=first, label=panel.heading)
            lower -= gap
            _draw_panel(axes, recording, panel, axis, points)
            _draw_marks(axes, panel, marks, axis)
            axes.tick_params(bottom=panel is panels[-1], labelbottom=panel is panels[-1])
            axes.set_xlim(axis.unit.shown(axis.start), axis.unit.shown(axis.stop))
            first = first or axes
        for axes, panel in zip(figure.axes, panels, strict=True):
            _draw_labels(axes, panel, marks, axis)
        figure.axes[-1].set_xlabel(f"time / {axis.unit.symbol}")
        return render_svg(figure, key, title=title)


def _draw_panel(
    axes: Axes, recording: Recording, panel: Panel, axis: TimeAxis, points: int
) -> None:
    unit = f" / {panel.unit.symbol}" if panel.unit.symbol else ""
    axes.set_title(panel.heading + unit)
    axes.locator_params(axis="y", nbins=5 if axes.get_position().height > 0.3 else 3)
    axes.margins(y=0.08)
    lines: list[Line2D] = []
    for trace in panel.traces:
        values = recording[trace.channel]
        keep = envelope_indices(values, points)
        lines += axes.plot(
            axis.unit.shown(1.0) * recording.time[keep],
            panel.unit.factor * values[keep] + panel.unit.offset,
            color=SHADES[trace.colour],
            linestyle=(0, (4, 2)) if trace.dashed else "-",
            linewidth=1.1 if trace.dashed else 1.4,
            label=trace.label,
            zorder=CURVES + (0.5 if trace.dashed else 0.0),
        )
    low, high = axes.get_ylim()
    lacking = panel.unit.difference(panel.least_span) - (high - low)
    if lacking > 0.0:
        axes.set_ylim(low - lacking / 2.0, high + lacking / 2.0)
    if len(lines) > 1:
        axes.legend(
            handles=lines,
            loc="lower right",
            bbox_to_anchor=(1.0, 0.99),
            ncols=len(lines),
            borderaxespad=0.0,
            borderpad=0.2,
            handlelength=1.8,
            columnspacing=1.4,
        )


def _draw_marks(axes: Axes, panel: Panel, marks: Sequence[Mark], axis: TimeAxis) -> None:
    seconds, shown = axis.unit.shown(1.0), panel.unit.shown
    own = [mark for mark in marks if isinstance(mark, TimeBand) or mark.channel in panel.channels]
    low, high = axes.get_ylim()
    for mark in own:
        match mark:
            case TimeBand():
                span = (max(mark.start, axis.start) * seconds, mark.stop * seconds)
                shade = SHADES[_ROLE_SHADE[mark.role]]
                axes.axvspan(*span, color=shade, alpha=0.10, linewidth=0, zorder=0.5)
            case ValueBand():
                axes.fill_between(
                    [mark.start * seconds, min(mark.stop, axis.stop) * seconds],
                    shown(mark.low),
                    shown(mark.high),
                    color=SHADES[_ROLE_SHADE[mark.role]],
                    alpha=0.16,
                    linewidth=0,
                    zorder=0.8,
                )
            case LevelLine():
                # A safety limit far outside of what happened would flatten the curve.
                if mark.role is not Role.SAFETY or low <= shown(mark.value) <= high:
                    span = (
                        max(mark.start, axis.start) * seconds,
                        min(mark.stop, axis.stop) * seconds,
                    )
                    _line(axes, span, (shown(mark.value), shown(mark.value)), mark.role)
            case TimeLine() if mark.time <= axis.stop:
                axes.axvline(
                    mark.time * seconds,
                    color=SHADES[_ROLE_SHADE[mark.role]],
                    linestyle=_DASHES[mark.role],
                    linewidth=1.0,
                    zorder=2,
                )
            case Point():
                axes.plot(
                    [mark.time * seconds],
                    [shown(mark.value)],
                    marker="o",
                    markersize=5.0,
                    color=SHADES["text"],
                    markerfacecolor=SHADES["paper"],
                    markeredgewidth=1.2,
                    linestyle="none",
                    zorder=4,
                )
            case _:
                pass


def _line(axes: Axes, x: tuple[float, float], y: tuple[float, float], role: Role) -> None:
    axes.plot(
        x, y, color=SHADES[_ROLE_SHADE[role]], linestyle=_DASHES[role], linewidth=1.0, zorder=2
    )


def _draw_labels(axes: Axes, panel: Panel, marks: Sequence[Mark], axis: TimeAxis) -> None:
    """Label the marks once the axes' ranges are final."""
    dpi = axes.figure.dpi
    corners = axes.get_window_extent().get_points() * 72.0 / dpi
    area = Box(corners[0, 0] + 2, corners[0, 1] + 2, corners[1, 0] - 2, corners[1, 1] + 2)
    curves = [
        _followed(line, dpi) for line in axes.get_lines() if line.get_transform() == axes.transData
    ]
    placer = LabelPlacer(area, LABEL_SIZE, np.concatenate(curves))
    seconds, shown = axis.unit.shown(1.0), panel.unit.shown
    low, high = axes.get_ylim()

    def at(time: float, value: float) -> tuple[float, float]:
        x, y = axes.transData.transform((time * seconds, shown(value))) * 72.0 / dpi
        return float(x), float(y)

    for mark in marks:
        if isinstance(mark, TimeBand) or mark.channel not in panel.channels or not mark.label:
            continue
        match mark:
            case Point():
                box = placer.beside(mark.label, *at(mark.time, mark.value))
                _write(axes, mark.label, box, "text")
            case TimeLine() if mark.time <= axis.stop:
                x, _ = at(mark.time, 0.0)
                box = placer.along(mark.label, x + 3, area.bottom, align="left")
                _write(axes, mark.label, box, _ROLE_SHADE[mark.role])
            case LevelLine() if low <= shown(mark.value) <= high:
                x, y = at(min(mark.stop, axis.stop), mark.value)
                box = placer.along(mark.label, x - 2, y + 1, align="right")
                _write(axes, mark.label, box, _ROLE_SHADE[mark.role])
            case _:
                pass


def _followed(line: Line2D, dpi: float) -> FloatArray:
    """Points of a curve no further apart than a letter is wide, in points of the figure."""
    corners = line.get_transform().transform(line.get_xydata()) * 72.0 / dpi
    corners = corners[np.isfinite(corners).all(axis=1)]
    if len(corners) < 2:
        return np.zeros((0, 2))
    length = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))))
    places = np.linspace(0.0, length[-1], min(4000, int(length[-1] / 3.0) + 2))
    return np.column_stack([np.interp(places, length, corners[:, i]) for i in (0, 1)])


def _write(axes: Axes, text: str, box: Box, shade: str) -> None:
    axes.annotate(
        text,
        (box.left, box.bottom),
        xycoords="figure points",
        fontsize=LABEL_SIZE,
        color=SHADES[shade],
        va="bottom",
        ha="left",
        annotation_clip=False,
    )
