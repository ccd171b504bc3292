"""What the plots of a diagnosis show: a run as measured, as two models replay it, and residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.recording import Recording
from eha_bench.diagnosis.replay.replay import Replay
from eha_bench.report.engineering import channel_name, display_unit
from eha_bench.report.marks import Mark, Role, TimeBand, ValueBand
from eha_bench.report.panels import Panel, Trace
from eha_bench.report.scene import Scene

BEFORE, AFTER = "recalibrated", "revised"
_MEASURED = "measured"


def gap(replay: Replay, name: str, floors: dict[str, float]) -> float:
    """Return how far the recalibrated model is off in a channel, RMS, in noise floors."""
    error = replay.errors(name)[1]
    error = error[~np.isnan(error)]
    floor = floors.get(name, math.nan)
    if not error.size or not floor > 0.0:
        return 0.0
    return float(np.sqrt(np.mean(np.clip(error / floor, -1e9, 1e9) ** 2)))


def worst_first(replay: Replay, floors: dict[str, float]) -> tuple[str, ...]:
    """Return a run's channels, the one that the recalibrated model misses most first."""
    return tuple(sorted(replay.measured, key=lambda name: (-gap(replay, name, floors), name)))


def diagnosis_scene(
    replay: Replay,
    floors: dict[str, float],
    when: Sequence[tuple[float, float]] = (),
    *,
    is_revised: bool = True,
) -> Scene:
    """Return two panels for each channel: its curves, and its residuals within the noise's band.

    Args:
        replay: by the declared, the recalibrated and the revised model.
        floors: channel -> standard deviation of its noise, SI.
        when: (start, stop) times in s at which something unknown acts.
        is_revised: whether the revised model differs from the recalibrated one.
    """
    values: dict[str, FloatArray] = {}
    units: dict[str, str] = {}
    panels: list[Panel] = []
    marks: list[Mark] = [
        TimeBand(start, stop, Role.LIMIT) for start, stop in when if start < float(replay.time[-1])
    ]
    for name in worst_first(replay, floors):
        curves = {
            _MEASURED: replay.measured[name],
            BEFORE: _drawable(replay.simulated[1][name], replay.measured[name]),
        }
        residuals = {BEFORE: _finite(replay.errors(name)[1])}
        if is_revised:
            curves[AFTER] = _drawable(replay.simulated[2][name], replay.measured[name])
            residuals[AFTER] = _finite(replay.errors(name)[2])
        unit = replay.unit(name)
        for heading, prefix, drawn in (
            (channel_name(name), f"{name}: ", curves),
            (f"{channel_name(name)}, residual", f"{name}: residual, ", residuals),
        ):
            own = {prefix + word: line for word, line in drawn.items()}
            values |= own
            units |= dict.fromkeys(own, unit)
            panels.append(_panel(heading, unit, prefix, drawn))
        floor = floors.get(name, math.nan)
        if floor > 0.0:
            start, stop = float(replay.time[0]), float(replay.time[-1])
            channel = f"{name}: residual, {AFTER if is_revised else BEFORE}"
            marks.append(ValueBand(channel, -floor, floor, start, stop, Role.BAND))
    recording = Recording(replay.time, values, units)
    return Scene(recording, tuple(panels), tuple(marks))


def _panel(heading: str, si: str, prefix: str, curves: dict[str, FloatArray]) -> Panel:
    """Return a panel of curves by their words; a channel is called `prefix` and the word."""
    finite = [part[np.isfinite(part)] for part in curves.values()]
    unit = display_unit(si, [v for part in finite if part.size for v in (part.min(), part.max())])
    colours = {_MEASURED: "reference", BEFORE: "vermilion", AFTER: "blue"}
    traces = [Trace(prefix + word, word, colours[word], dashed=False) for word in curves]
    # no SI unit: a residual of micrometres is to fill its panel
    return Panel(heading, "", unit, tuple(traces))


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nan)


def _drawable(values: FloatArray, measured: FloatArray) -> FloatArray:
    """Return a simulation cut where it runs away, so that it does not flatten what was measured."""
    there = measured[np.isfinite(measured)]
    low, high = float(there.min()), float(there.max())
    reach = 5.0 * (high - low) + 1e-300
    with np.errstate(invalid="ignore"):
        near = np.isfinite(values) & (values > low - reach) & (values < high + reach)
    return np.where(near, values, np.nan)
