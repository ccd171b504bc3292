"""Steady-state error and holding current: means over the end of the hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.channels import unit_of
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.signal import Edge
from eha_bench.core.trial import Trial
from eha_bench.metrics.coverage import reach, type_b
from eha_bench.metrics.levels import level
from eha_bench.metrics.metric import Metric, NotScored, spec_of
from eha_bench.metrics.noise import detrended
from eha_bench.metrics.resolution import dithering
from eha_bench.metrics.samples import Samples, samples
from eha_bench.metrics.step_response import (
    FINAL_SHARE,
    final_window,
    has_steps,
    held_noise,
    initial_window,
    magnitude,
    require_finite,
    require_hold,
)
from eha_bench.metrics.window import Timeline, edges_of, timeline

_FEWEST = 20  # samples before the edge that tell of noise
_RATIO = 4.0  # of variances, up to which levels scatter alike
_WINDOW = f"mean of the last {100 * FINAL_SHARE:.0f} % of the hold"


class SteadyStateError(Metric):
    """Reference minus final level, in the channel's unit."""

    spec = spec_of("steady_state_error")

    def applies(self, trial: Trial) -> bool:
        """Whether the signal has an edge."""
        return has_steps(trial)

    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:
        """Return the error of the largest magnitude over the edges."""
        if channel != trial.channel:
            raise NotScored(f"{channel} is not what the reference asks for ({trial.channel} is)")
        line = timeline(recording, trial)
        data = samples(recording, trial, channel)
        edges = _held_edges(recording, trial, line)
        return _largest(line, data, edges, [edge.after for edge in edges])


class HoldingCurrent(Metric):
    """Mean motor current while the final level is held, in A.

    Friction sticks: which current holds a level depends on how it was reached, so the value is
    that of this recording; a drift along the window is noted.
    """

    spec = spec_of("holding_current")

    def applies(self, trial: Trial) -> bool:
        """Whether the signal has an edge to hold after."""
        return has_steps(trial)

    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:
        """Return the mean over the window, the largest magnitude over the edges."""
        if (recording.unit(channel) or unit_of(channel)) != "A":
            raise NotScored(f"{channel} is not a current")
        line = timeline(recording, trial)
        data = samples(recording, trial, channel)
        edges = _held_edges(recording, trial, line)
        return _largest(line, data, edges, [None] * len(edges))


def _held_edges(recording: Recording, trial: Trial, line: Timeline) -> Sequence[Edge]:
    """Return the edges as recorded, all of which are held for as long as their end is scored."""
    edges = edges_of(recording, trial)
    for edge, asked in zip(edges, trial.signal.edges, strict=True):
        require_hold(line, edge, asked, trial.duration)
    return edges


def _value(line: Timeline, data: Samples, edge: Edge, target: float | None) -> float:
    """Return the mean of an edge's final window, or what is missing from it to `target`."""
    window = final_window(line, edge)
    if window.stop <= window.start:
        raise NotScored("no sample at the end of the hold")
    require_finite(line, data.values, window)
    scale = magnitude(data.values[window]) or 1.0
    found = float((data.values[window] / scale).mean()) * scale
    return found if target is None else target - found


def _mean(
    line: Timeline, data: Samples, edges: Sequence[Edge], place: int, target: float | None
) -> Measure:
    """Return the value of an edge with its interval."""
    edge = edges[place]
    window, values = final_window(line, edge), data.values
    scale = magnitude(values[window]) or 1.0
    last = values[window] / scale
    held = values[line.between(edge.time, edge.until)] / scale
    start = edges[place - 1].time if place else float(line.time[0])
    before = values[initial_window(line, edge, start)] / scale
    noise = held_noise(held, [last], [], [before] if _alike(before, last) else [])
    found = level(last, noise)
    budget = found.budget(
        data.resolution / scale, dithering((last,), data.resolution / scale)
    ).scaled(scale)
    budget += type_b("sensor", data.calibration(found.value * scale))
    own = reach(budget)
    value = found.value * scale if target is None else target - found.value * scale
    notes = [_WINDOW, line.how] if line.how else [_WINDOW]
    if found.drifts and abs(found.drift) > 0.01:
        notes.append(f"not stationary: drifts by {found.drift * scale:.3g} along it")
    notes += data.notes(line, window)
    return Measure(value, value - own, value + own, "; ".join(notes), budget.merged())


def _alike(before: FloatArray, last: FloatArray) -> bool:
    """Return whether both levels scatter alike, so that either tells of the other's noise."""
    if before.size < _FEWEST or last.size < _FEWEST or not np.all(np.isfinite(before)):
        return False
    ratio = np.var(detrended(before)) / max(float(np.var(detrended(last))), 1e-300)
    return bool(1.0 / _RATIO <= ratio <= _RATIO)


def _largest(
    line: Timeline, data: Samples, edges: Sequence[Edge], targets: Sequence[float | None]
) -> Measure:
    """Return the edge of the largest magnitude; an interval is needed of that alone."""
    values = [_value(line, data, *pair) for pair in zip(edges, targets, strict=True)]
    place = max(range(len(values)), key=lambda index: abs(values[index]))
    chosen = _mean(line, data, edges, place, targets[place])
    if len(values) == 1:
        return chosen
    return replace(chosen, reason=f"largest of {len(values)} edges; {chosen.reason}")
