"""The static plot of a run: panels over one time axis, with levels, bands, limits and labels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from markupsafe import Markup

from eha_bench.core.arrays import FloatArray
from eha_bench.core.recording import Recording
from eha_bench.report.drawing import Drawing
from eha_bench.report.engineering import DisplayUnit
from eha_bench.report.envelope import envelope_indices
from eha_bench.report.figures import plot_style
from eha_bench.report.labels import CHARACTER_WIDTH, Box, LabelPlacer
from eha_bench.report.marks import LevelLine, Mark, Point, Role, TimeBand, TimeLine, Tube, ValueBand
from eha_bench.report.panels import Panel
from eha_bench.report.scene import Scene
from eha_bench.report.ticks import Ticks, ticks_between

# In points: 1/72 inch. The page shows the drawing as wide as its column.
WIDTH: Final = 662.0
LEFT: Final = 45.0
RIGHT: Final = 9.0
FIRST_HEIGHT: Final = 194.0
OTHER_HEIGHT: Final = 86.0
GAP: Final = 26.0
TOP: Final = 22.0
BOTTOM: Final = 32.0
POINTS: Final = 800
LABEL_SIZE: Final = 7.5
TEXT_SIZE: Final = 9.0
HEADING_SIZE: Final = 9.5
MILLISECONDS_BELOW: Final = 2.0
REACH: Final = 0.6  # of the curves' height: how far off a level may lie and still be shown
PAD: Final = 0.08

_ROLE_SHADE: Final = {
    Role.LEVEL: "muted",
    Role.BAND: "good",
    Role.LIMIT: "limit",
    Role.SAFETY: "safety",
    Role.MEASURED: "text",
    Role.UNSCORED: "muted",
}
_DASHES: Final[dict[Role, tuple[float, ...]]] = {
    Role.LEVEL: (1, 2),
    Role.BAND: (1, 2),
    Role.LIMIT: (6, 2),
    Role.SAFETY: (6, 2, 1, 2),
    Role.MEASURED: (1, 2),
    Role.UNSCORED: (1, 2),
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

    @property
    def ticks(self) -> Ticks:
        """Round instants, in the unit shown."""
        return ticks_between(self.unit.from_si(self.start), self.unit.from_si(self.stop), 14)


@dataclass(frozen=True)
class Area:
    """Where a panel is drawn, in points, and the values (display unit) at its edges."""

    top: float
    bottom: float
    low: float
    high: float
    axis: TimeAxis
    panel: Panel

    left: Final = LEFT
    right: Final = WIDTH - RIGHT

    def x(self, time: float) -> float:
        """Place of an instant in s; beyond the axis, its end."""
        span = self.axis.stop - self.axis.start
        share = min(1.0, max(0.0, (time - self.axis.start) / span))
        return self.left + share * (self.right - self.left)

    def y(self, value: float) -> float:
        """Place of a value in SI."""
        return self.y_shown(self.panel.unit.from_si(value))

    def y_shown(self, value: float) -> float:
        """Place of a value in the panel's unit."""
        share = (value - self.low) / (self.high - self.low)
        return self.bottom - share * (self.bottom - self.top)

    def holds(self, value: float) -> bool:
        """Whether a value (SI) lies within the area."""
        return self.low <= self.panel.unit.from_si(value) <= self.high

    def points(self, time: FloatArray, values: FloatArray) -> FloatArray:
        """Return the places (n, 2) of values in SI; what lies outside is cut to the edge."""
        unit = self.panel.unit
        shown = (unit.factor * values + unit.offset - self.low) / (self.high - self.low)
        along = (time - self.axis.start) / (self.axis.stop - self.axis.start)
        return np.column_stack(
            (
                self.left + along * (self.right - self.left),
                self.bottom - np.clip(shown, 0.0, 1.0) * (self.bottom - self.top),
            )
        )


def scene_svg(scene: Scene, *, key: str, title: str, points: int = POINTS) -> Markup:
    """Draw a recording: one panel below the other over one time axis, with its marks.

    Args:
        scene: of at least one panel.
        key: unique on its page.
        title: what a screen reader says.
        points: kept of each curve, about; see `envelope_indices`.
    """
    recording, panels = scene.recording, scene.panels
    axis = TimeAxis(float(recording.time[0]), float(recording.time[-1]))
    heights = [FIRST_HEIGHT] + [OTHER_HEIGHT] * (len(panels) - 1)
    height = TOP + sum(heights) + GAP * (len(panels) - 1) + BOTTOM
    with plot_style():
        drawing = Drawing(WIDTH, height)
        top = TOP
        for panel, tall in zip(panels, heights, strict=True):
            own = [
                mark
                for mark in scene.marks
                if isinstance(mark, TimeBand) or mark.channel in panel.channels
            ]
            low, high = _range(recording, panel, own)
            area = Area(top, top + tall, low, high, axis, panel)
            _draw_panel(drawing, area, recording, own, points, last=panel is panels[-1])
            top += tall + GAP
        return drawing.svg(key, title=title)


def _range(recording: Recording, panel: Panel, marks: Sequence[Mark]) -> tuple[float, float]:
    """The values (display unit) at the panel's edges: its curves, and the marks near to them."""
    unit = panel.unit
    ends = [unit.from_si(v) for name in panel.channels for v in _extremes(recording[name])]
    low, high = min(ends), max(ends)
    reach = REACH * max(high - low, unit.difference(panel.least_span))
    near = [unit.from_si(v) for mark in marks for v in _values(mark)]
    near = [v for v in near if low - reach <= v <= high + reach]
    low, high = min([low, *near]), max([high, *near])
    least = unit.difference(panel.least_span) or (1.0 if low == high else 0.0)
    pad = PAD * (high - low) + max(0.0, least - (high - low)) / 2.0
    # of huge values a span of 1 may be nothing
    pad = max(pad, 1e-9 * max(abs(low), abs(high)))
    return low - pad, high + pad


def _extremes(values: FloatArray) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    return float(finite.min()), float(finite.max())


def _values(mark: Mark) -> Iterator[float]:
    match mark:
        case LevelLine() if mark.role is not Role.SAFETY:
            yield mark.value
        case Point():
            yield mark.value
        case ValueBand():
            yield from (mark.low, mark.high)
        case _:
            pass


def _draw_panel(
    drawing: Drawing,
    area: Area,
    recording: Recording,
    marks: Sequence[Mark],
    points: int,
    *,
    last: bool,
) -> None:
    _draw_bands(drawing, area, marks)
    _draw_axes(drawing, area, last=last)
    _draw_lines(drawing, area, recording, marks)
    followed: list[FloatArray] = []
    for trace in area.panel.traces:
        values = recording[trace.channel]
        keep = envelope_indices(values, points)
        places = area.points(recording.time[keep], values[keep])
        followed.append(_dense_points(places))
        width, dash = (1.1, (4.0, 2.0)) if trace.dashed else (1.4, ())
        drawing.curve(places, trace.colour, width=width, dash=dash)
    for mark in marks:
        if isinstance(mark, Point):
            drawing.ring(area.x(mark.time), area.y(mark.value), 2.5, "text")
    _draw_heading(drawing, area)
    _draw_labels(drawing, area, marks, np.concatenate(followed))


def _draw_axes(drawing: Drawing, area: Area, *, last: bool) -> None:
    across = ticks_between(area.low, area.high, 8 if area.bottom - area.top > 120.0 else 4)
    along = area.axis.ticks
    times = [area.x(value / area.axis.unit.factor) for value in along.values]
    levels = [area.y_shown(value) for value in across.values]
    drawing.ruling(
        [(area.left, y, area.right, y) for y in levels]
        + [(x, area.top, x, area.bottom) for x in times],
        "grid",
    )
    drawing.ruling(
        [
            (area.left, area.top, area.left, area.bottom),
            (area.left, area.bottom, area.right, area.bottom),
            *((x, area.bottom, x, area.bottom + 3.0) for x in times if last),
        ],
        "axis",
    )
    for y, label in zip(levels, across.labels, strict=True):
        drawing.text(label, area.left - 4.0, y + 3.2, "muted", size=TEXT_SIZE, anchor="right")
    if not last:
        return
    for x, label in zip(times, along.labels, strict=True):
        drawing.text(label, x, area.bottom + 13.0, "muted", size=TEXT_SIZE, anchor="center")
    middle = (area.left + area.right) / 2.0
    name = f"time / {area.axis.unit.symbol}"
    drawing.text(name, middle, area.bottom + 26.0, "muted", size=TEXT_SIZE, anchor="center")


def _draw_heading(drawing: Drawing, area: Area) -> None:
    panel = area.panel
    unit = f" / {panel.unit.symbol}" if panel.unit.symbol else ""
    y = area.top - 6.0
    drawing.text(panel.heading + unit, area.left, y, "text", size=HEADING_SIZE, bold=True)
    if len(panel.traces) < 2:
        return
    right = area.right
    for trace in reversed(panel.traces):
        # A font may be wider than the mean letter says: there is room behind every word.
        right -= 1.15 * CHARACTER_WIDTH * TEXT_SIZE * len(trace.label)
        drawing.text(trace.label, right, y, "muted", size=TEXT_SIZE)
        stop = right - 5.0
        dash = (4.0, 2.0) if trace.dashed else ()
        drawing.line((stop - 16.0, y - 3.0), (stop, y - 3.0), trace.colour, width=1.4, dash=dash)
        right = stop - 28.0


def _draw_bands(drawing: Drawing, area: Area, marks: Sequence[Mark]) -> None:
    for mark in marks:
        match mark:
            case TimeBand():
                across = (area.top, area.bottom, 0.10)
            case ValueBand():
                edges = [area.y(mark.high), area.y(mark.low)]
                top, bottom = (min(max(y, area.top), area.bottom) for y in edges)
                across = (top, bottom, 0.16)
            case _:
                continue
        shade = _ROLE_SHADE[mark.role]
        left, right = area.x(mark.start), area.x(mark.stop)
        if right > left:
            drawing.rectangle(left, across[0], right, across[1], shade, opacity=across[2])


def _draw_lines(drawing: Drawing, area: Area, recording: Recording, marks: Sequence[Mark]) -> None:
    for mark in marks:
        match mark:
            # A level far outside of what happened would flatten the curve: it is not drawn.
            case LevelLine() if area.holds(mark.value):
                y = area.y(mark.value)
                start, stop = (area.x(mark.start), y), (area.x(mark.stop), y)
            case TimeLine() if area.axis.start <= mark.time <= area.axis.stop:
                x = area.x(mark.time)
                start, stop = (x, area.top), (x, area.bottom)
            case Tube() if "reference" in recording:
                _draw_tube(drawing, area, recording, mark)
                continue
            case _:
                continue
        drawing.line(start, stop, _ROLE_SHADE[mark.role], dash=_DASHES[mark.role])


def _draw_tube(drawing: Drawing, area: Area, recording: Recording, mark: Tube) -> None:
    inside = (recording.time >= mark.start) & (recording.time <= mark.stop)
    time, reference = recording.time[inside], recording["reference"][inside]
    for side in (mark.low, mark.high):
        keep = envelope_indices(reference, POINTS)
        places = area.points(time[keep], reference[keep] + side)
        # what is cut to the edge of the area is left out
        places[(places[:, 1] <= area.top) | (places[:, 1] >= area.bottom)] = np.nan
        drawing.curve(places, _ROLE_SHADE[mark.role], width=1.0, dash=_DASHES[mark.role])


def _draw_labels(drawing: Drawing, area: Area, marks: Sequence[Mark], curves: FloatArray) -> None:
    # The placer's heights grow upwards.
    room = Box(area.left + 2.0, -area.bottom + 2.0, area.right - 2.0, -area.top + 2.0)
    placer = LabelPlacer(room, LABEL_SIZE, curves * (1.0, -1.0))
    for mark in marks:
        if isinstance(mark, TimeBand | ValueBand) or not mark.label:
            continue
        shade = _ROLE_SHADE[mark.role] if not isinstance(mark, Point) else "text"
        match mark:
            case Point():
                box = placer.beside(mark.label, area.x(mark.time), -area.y(mark.value))
            case TimeLine() if area.axis.start <= mark.time <= area.axis.stop:
                place = (area.x(mark.time) + 3.0, room.bottom)
                box = placer.along(mark.label, *place, align="left")
            case LevelLine() if area.holds(mark.value):
                place = (area.x(mark.stop) - 2.0, 1.0 - area.y(mark.value))
                box = placer.along(mark.label, *place, align="right")
            case Tube():
                box = placer.along(mark.label, area.right - 2.0, room.top - 12.0, align="right")
            case _:
                continue
        drawing.text(mark.label, box.left, -box.bottom - 2.0, shade, size=LABEL_SIZE)


def _dense_points(places: FloatArray) -> FloatArray:
    """Points of a curve no further apart than a letter is wide."""
    corners = places[np.isfinite(places).all(axis=1)]
    if len(corners) < 2:
        return np.zeros((0, 2))
    length = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))))
    along = np.linspace(0.0, length[-1], min(4000, int(length[-1] / 3.0) + 2))
    return np.column_stack([np.interp(along, length, corners[:, i]) for i in (0, 1)])
