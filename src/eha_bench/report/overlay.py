"""Two recordings of one trial drawn over each other."""

from __future__ import annotations

from typing import Final

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import EhaBenchError
from eha_bench.core.recording import Recording
from eha_bench.core.result import TrialResult
from eha_bench.core.trial import Trial
from eha_bench.report.engineering import channel_name, display_unit
from eha_bench.report.panels import Panel, Trace
from eha_bench.report.scene import Scene, scene_of
from eha_bench.suites import trial_from_source

MOST_PANELS: Final = 5
_COLOURS: Final = ("blue", "vermilion")


def overlay(
    recordings: tuple[Recording, Recording],
    runs: tuple[TrialResult, TrialResult],
    names: tuple[str, str],
) -> Scene | None:
    """Return both recordings on one clock, a panel a channel; None if they share nothing.

    Args:
        recordings: of the same trial, which they carry if they are our own.
        runs: whose they are.
        names: what the curves are called, e.g. baseline and candidate.
    """
    trial = _trial(recordings)
    scenes = [scene_of(rec, run, trial) for rec, run in zip(recordings, runs, strict=True)]
    first, second = (scene.recording for scene in scenes)
    inside = (first.time >= second.time[0]) & (first.time <= second.time[-1]) if len(second) else []
    if np.count_nonzero(inside) < 2:
        return None
    time = first.time[inside]
    values: dict[str, FloatArray] = {}
    units: dict[str, str] = {}
    panels: list[Panel] = []
    for heading, channels in _shared_panels(scenes[0].panels, second):
        traces: list[Trace] = []
        if "reference" in channels:
            values["reference"] = first["reference"][inside]
            traces.append(Trace("reference", "reference", "reference", True))
        for channel in channels:
            if channel == "reference":
                continue
            units["reference"] = first.unit(channel) if traces else units.get("reference", "")
            both = first[channel][inside], np.interp(time, second.time, second[channel])
            for name, curve, colour in zip(names, both, _COLOURS, strict=True):
                key = f"{channel} ({name})"
                values[key], units[key] = curve, first.unit(channel)
                traces.append(Trace(key, name, colour, False))
            panels.append(_panel(heading or channel_name(channel), traces, values, units))
            traces = []
    if not panels:
        return None
    return Scene(Recording(time, values, units), tuple(panels[:MOST_PANELS]))


def _trial(recordings: tuple[Recording, Recording]) -> Trial | None:
    for recording in recordings:
        source = recording.attachments.get("trial.json")
        if source is not None:
            try:
                return trial_from_source(source.decode("utf-8", "replace"))
            except EhaBenchError:
                continue
    return None


def _shared_panels(panels: tuple[Panel, ...], second: Recording) -> list[tuple[str, list[str]]]:
    """Return heading and channels of each panel, as far as the other recording has them too."""
    found = []
    for panel in panels:
        channels = [name for name in panel.channels if name in second]
        # the command is what the controller does with the reference: worth its own panel
        heading = panel.heading if len(set(channels) - {"reference"}) == 1 else ""
        if set(channels) - {"reference"}:
            found.append((heading, channels))
    return found


def _panel(
    heading: str, traces: list[Trace], values: dict[str, FloatArray], units: dict[str, str]
) -> Panel:
    si = units[traces[-1].channel]
    drawn = np.concatenate([values[trace.channel] for trace in traces])
    finite = drawn[np.isfinite(drawn)]
    ends = (float(finite.min()), float(finite.max())) if finite.size else ()
    band = tuple(trace.channel for trace in traces[-2:])
    return Panel(heading, si, display_unit(si, ends), tuple(traces), band=band)
