"""Plots for notebooks and scripts: matplotlib figures in the page's panels, units and names."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eha_bench.core.errors import InputError, MissingChannelError, Place
from eha_bench.core.recording import Recording
from eha_bench.core.result import Result, TrialResult
from eha_bench.recordings import read
from eha_bench.report.panels import Panel, panels_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = {
    "reference": "0.45", "blue": "#0068b5", "vermilion": "#c14a12", "green": "#0a7d5d",
    "purple": "#93478d", "sky": "#2a86c0", "orange": "#b26a00",
}  # fmt: skip
_HEIGHT = 1.9


def plot_recording(recording: Recording, *channels: str) -> Figure:
    """Return a figure of a recording, channels that belong together in one pair of axes.

    Args:
        recording: what to draw.
        channels: those to draw; all that show more than noise if none is named.

    Raises:
        MissingChannelError: a channel is not there.
        InputError: there is nothing to draw.
    """
    for name in channels:
        if name not in recording:
            raise MissingChannelError(
                name, where=Place(file=recording.source), have=tuple(recording)
            )
    panels = [panel for panel in panels_of(recording) if not channels or set(channels) & set(
        panel.channels
    )]  # fmt: skip
    telling = [panel for panel in panels if channels or not panel.quiet] or panels
    if not telling or not len(recording):
        raise InputError("the recording holds no samples", where=Place(file=recording.source))
    return _draw(recording, telling, set(channels))


def plot_trial(result: Result, trial: str, repeat: int = 0) -> Figure:
    """Return a figure of a trial's recording.

    Raises:
        InputError: there is no such trial, or its recording is not there.
    """
    run = _find_run(result, trial, repeat)
    if result.folder is None or not run.recording:
        raise InputError(f"trial '{trial}' has no recording", hint="give the run a folder: out=...")
    figure = plot_recording(read(result.folder / run.recording))
    figure.suptitle(f"{trial}: {run.status.value}")
    return figure


def _find_run(result: Result, trial: str, repeat: int) -> TrialResult:
    from eha_bench.core.near_miss import suggest

    for run in result.trials:
        if (run.id, run.repeat) == (trial, repeat):
            return run
    known = [run.id for run in result.trials]
    if trial in known:
        raise InputError(f"trial '{trial}' has no repeat {repeat}")
    raise InputError(f"no trial '{trial}' in the result", hint=suggest(trial, known))


def _draw(recording: Recording, panels: list[Panel], wanted: set[str]) -> Figure:
    # pyplot makes notebooks show the figure; closed there, it is not shown twice
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(
        len(panels), 1, sharex=True, squeeze=False, figsize=(9.0, 0.8 + _HEIGHT * len(panels)),
        layout="constrained",
    )  # fmt: skip
    for axis, panel in zip(axes[:, 0], panels, strict=True):
        for trace in panel.traces:
            if wanted and trace.channel not in wanted:
                continue
            values = np.asarray(recording[trace.channel]) * panel.unit.factor + panel.unit.offset
            axis.plot(
                recording.time, values, label=trace.label, linewidth=1.2,
                color=_COLOURS.get(trace.colour), linestyle="--" if trace.dashed else "-",
            )  # fmt: skip
        unit = f" / {panel.unit.symbol}" if panel.unit.symbol else ""
        axis.set_title(f"{panel.heading}{unit}", loc="left", fontsize=9)
        axis.grid(visible=True, alpha=0.3)
        if len(panel.traces) > 1:
            axis.legend(fontsize=8, frameon=False, loc="upper right")
    axes[-1, 0].set_xlabel("time / s")
    pyplot.close(figure)
    return figure
