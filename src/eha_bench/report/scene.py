"""What a plot of a run shows: the scored part of its recording, its panels and its marks.

The levels that scores are relative to are asked of the metrics that scored, so that what is
marked is what was judged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

from eha_bench.core.errors import EhaBenchError
from eha_bench.core.recording import Recording
from eha_bench.core.result import TrialResult
from eha_bench.core.trial import Trial
from eha_bench.metrics.recorded import bind
from eha_bench.metrics.step_response import step_responses
from eha_bench.metrics.window import commanded_edges, timeline
from eha_bench.report.marks import Mark, StepMark, marks_of
from eha_bench.report.panels import Panel, panels_of
from eha_bench.report.sine_marks import sine_marks, swing_of

# Of what was recorded before and after the scored part this share of its length is shown.
_MARGIN: Final = 0.1


@dataclass(frozen=True)
class Scene:
    """What a plot shows.

    Attributes:
        recording: time in s on the clock of the trial's signal (its own clock where unknown
            where the signal lies), cut to the scored part with a margin.
        panels: channels that are drawn together, from top to bottom; empty if there is nothing.
        marks: levels, limits, bands and measured points on the same clock.
        steps: the edges of the reference, with the levels before and after.
    """

    recording: Recording
    panels: tuple[Panel, ...]
    marks: tuple[Mark, ...] = ()
    steps: tuple[StepMark, ...] = ()


def scene_of(recording: Recording, run: TrialResult, trial: Trial | None) -> Scene:
    """Return what to show of a run; without its trial, the recording alone."""
    if trial is None:
        return Scene(recording, _panels(recording, ""))
    bound, trial = bind(recording, trial)
    try:
        line = timeline(bound, trial)
    except EhaBenchError:
        return Scene(recording, _panels(recording, trial.channel))
    steps = tuple(_steps(bound, trial))
    placed = _shown_part(replace(bound, time=line.time), trial.duration)
    marks = marks_of(trial, run, steps)
    swing = swing_of(bound, trial, line)
    if swing is not None:
        marks += tuple(sine_marks(swing, trial.limits, run.scores))
    limited = {limit.channel for limit in trial.limits}
    panels = tuple(
        replace(panel, quiet=panel.quiet and not limited.intersection(panel.channels))
        for panel in _panels(placed, trial.channel)
    )
    return Scene(placed, tuple(sorted(panels, key=lambda panel: panel.quiet)), marks, steps)


def _panels(recording: Recording, followed: str) -> tuple[Panel, ...]:
    return panels_of(recording, followed) if len(recording) > 1 else ()


def _shown_part(recording: Recording, duration: float) -> Recording:
    if not math.isfinite(duration):
        return recording
    part = recording.between(-_MARGIN * duration, (1.0 + _MARGIN) * duration)
    return part if len(part) > 1 else recording


def _steps(recording: Recording, trial: Trial) -> Iterator[StepMark]:
    try:
        for response in step_responses(recording, trial, trial.channel):
            edge = response.edge
            yield StepMark(
                edge.time, edge.until, response.initial, response.final, edge.after, True
            )
    except EhaBenchError:
        # Not settled, say: then only what was commanded is known.
        yield from _commanded_steps(recording, trial)


def _commanded_steps(recording: Recording, trial: Trial) -> Iterator[StepMark]:
    try:
        edges = commanded_edges(timeline(recording, trial), trial)
    except EhaBenchError:
        edges = trial.signal.edges
    for edge in edges:
        yield StepMark(
            edge.time, min(edge.until, trial.duration), edge.before, edge.after, edge.after, False
        )
