"""What `charts.js` draws of a run: panels, marks and packed curves, as data in the page."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from eha_bench.core.recording import Recording
from eha_bench.report.engineering import DisplayUnit
from eha_bench.report.marks import LevelLine, Mark, Point, Role, TimeBand, TimeLine, Tube, ValueBand
from eha_bench.report.packing import packed_clock, packed_curve, stretches
from eha_bench.report.scene import Scene


@dataclass(frozen=True)
class ChartData:
    """The data blocks of a run's charts.

    Attributes:
        scene: panels, marks and the clock, small; read when the page opens.
        curves: packed curves in the order of the panels' traces; read when they are drawn.
        first: how many of them the first panel needs.
    """

    scene: dict[str, Any]
    curves: tuple[str, ...]
    first: int


def chart_data(scene: Scene) -> ChartData:
    """Pack a scene for the page; values become those of the panels' display units."""
    recording = scene.recording
    parts = stretches(recording.time, sorted(set(_events(scene))))
    curves: list[str] = []
    panels = []
    for panel in scene.panels:
        traces = []
        for trace in panel.traces:
            curve = packed_curve(
                panel.unit.factor * recording[trace.channel] + panel.unit.offset, parts
            )
            curves.append(curve.pop("data"))
            traces.append({**asdict(trace), **curve, "curve": len(curves) - 1})
        panels.append(
            {
                "heading": panel.heading,
                "unit": panel.unit.symbol,
                "quiet": panel.quiet,
                "band": [panel.channels.index(name) for name in panel.band],
                "leastSpan": panel.unit.difference(panel.least_span),
                "traces": traces,
                "marks": [
                    _mark(mark, panel.unit, recording)
                    for mark in scene.marks
                    if isinstance(mark, TimeBand) or mark.channel in panel.channels
                ],
            }
        )
    return ChartData(
        {
            "start": float(recording.time[0]),
            "stop": float(recording.time[-1]),
            "clock": packed_clock(recording.time, parts),
            "panels": panels,
        },
        tuple(curves),
        len(scene.panels[0].traces),
    )


def _mark(mark: Mark, unit: DisplayUnit, recording: Recording) -> dict[str, Any]:
    data: dict[str, Any] = {"kind": type(mark).__name__, **asdict(mark)}
    shown = unit.difference if isinstance(mark, Tube) else unit.from_si
    for name in ("value", "low", "high"):
        if name in data:
            data[name] = shown(data[name])
    # JSON has no infinity: what lasts for ever lasts to the end of the recording.
    if "stop" in data:
        data["start"] = max(data["start"], float(recording.time[0]))
        data["stop"] = min(data["stop"], float(recording.time[-1]))
    return data


def _events(scene: Scene) -> Iterator[float]:
    """Instants worth every sample: edges, measured points, limits in time, limits left."""
    for step in scene.steps:
        yield step.time
    for mark in scene.marks:
        match mark:
            case Point() | TimeLine():
                yield mark.time
            case LevelLine() if mark.role in (Role.LIMIT, Role.SAFETY):
                yield from _crossings(scene.recording, mark)
            case ValueBand() | TimeBand() | LevelLine() | Tube():
                pass


def _crossings(recording: Recording, mark: LevelLine) -> Iterator[float]:
    if mark.channel not in recording:
        return
    beyond = recording[mark.channel] > mark.value
    places = np.flatnonzero(np.diff(beyond.astype(np.int8)))
    if places.size:
        yield float(recording.time[places[0]])
