"""Strokes of a motion back and forth, and how wide a loop another channel draws over them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from eha_bench.core.arrays import FloatArray
from eha_bench.core.budget import Budget
from eha_bench.core.recording import Recording
from eha_bench.core.trial import Trial
from eha_bench.metrics.coverage import between, type_a, type_b
from eha_bench.metrics.memo import remembered
from eha_bench.metrics.metric import NotScored
from eha_bench.metrics.noise import Noise, estimate
from eha_bench.metrics.polynomial import order, powers
from eha_bench.metrics.resolution import rounding_sd
from eha_bench.metrics.samples import Samples, samples
from eha_bench.metrics.step_response import magnitude, require_finite
from eha_bench.metrics.window import Timeline, timeline

LENGTHS = ("m", "rad")
"""SI units of a position."""

_MIDDLE = 0.6  # share of the travel that is used: a reversal is none of the stroke
_FEWEST = 20  # samples a stroke
_PARTS = 10  # that a stroke is divided into to see whether it halts ...
_HALTS = 5.0  # ... where one holds so many times as many samples as their median
_UNLIKE = (
    0.001  # probability by chance of a scatter from which strokes scatter by more than their noise
)
_FEWEST_ALIKE = 4  # strokes from which on their own scatter tells anything


@dataclass(frozen=True)
class Stroke:
    """One stroke's middle: samples [start, stop) of the recording; `sense` is +1 forth, -1 back."""

    start: int
    stop: int
    sense: float


@dataclass(frozen=True)
class HysteresisLoop:
    """The loop that a channel draws over a position that goes back and forth.

    Attributes:
        half: half the width of the loop, forth minus back, in the channel's unit, signed.
        slope: mean slope of the channel over the position, forth and back together.
        speed: mean speed of the position on the strokes, >= 0.
        budget: what moves `half`.
        strokes: how many it rests on.
        notes: what a reader of the score should know, one clause each.
    """

    half: float
    slope: float
    speed: float
    budget: Budget
    strokes: int
    notes: tuple[str, ...]


def loop(recording: Recording, trial: Trial, channel: str) -> HysteresisLoop:
    """Return the loop of a channel over the position that the trial asks for.

    With x the position, s = +1 forth and -1 back, the samples of the strokes are fitted by
    g(x) + h s: g a polynomial (what depends on the position alone: weight, spring, linkage; of a
    sine also inertia), h half the width of the loop.

    Raises:
        NotScored: no position is asked for, it does not go back and forth, it halts on the way, or
            samples without a value.
        MissingChannelError: no such channel.
    """
    return remembered(recording, trial, ("loop", channel), lambda: _loop(recording, trial, channel))


def _loop(recording: Recording, trial: Trial, channel: str) -> HysteresisLoop:
    moved = trial.channel
    unit = recording.unit(moved) if moved in recording else trial.mode.unit
    if unit not in LENGTHS:
        raise NotScored(f"the trial commands {moved}, which is not a position")
    if channel in (moved, "reference"):
        raise NotScored(f"{channel} is the motion itself: name another measured position")
    line = timeline(recording, trial)
    position, data = samples(recording, trial, moved), samples(recording, trial, channel)
    window = line.between(0.0, trial.duration)
    if window.stop - window.start < 2 * _FEWEST:
        raise NotScored(f"{max(window.stop - window.start, 0)} sample(s) in the scored time")
    require_finite(line, position.values, window)
    require_finite(line, data.values, window)
    found = strokes(position.values[window], moved)
    shifted = [Stroke(s.start + window.start, s.stop + window.start, s.sense) for s in found]
    return _fit_loop(line, position, data, shifted, _notes(line, data, window))


def _notes(line: Timeline, data: Samples, window: slice) -> tuple[str, ...]:
    return (*([line.how] if line.how else []), *data.notes(line, window))


def strokes(position: FloatArray, name: str = "the position") -> list[Stroke]:
    """Return the middle of every stroke of (n,) samples that goes from one end to the other.

    Raises:
        NotScored: there is no stroke forth, or none back, or one of them halts.
    """
    low, high = float(position.min()), float(position.max())
    margin = 0.5 * (1.0 - _MIDDLE) * (high - low)
    if not high > low:
        raise NotScored(f"{name} does not move")
    side = np.where(position < low + margin, -1, np.where(position > high - margin, 1, 0))
    ends = np.flatnonzero(side)
    turns = np.flatnonzero(np.diff(side[ends]))
    found = [
        Stroke(int(ends[k]) + 1, int(ends[k + 1]), float(side[ends[k + 1]]))
        for k in turns
        if ends[k + 1] - ends[k] - 1 >= _FEWEST
    ]
    forth = sum(stroke.sense > 0 for stroke in found)
    if forth == 0 or forth == len(found):
        raise NotScored(
            f"{name} does not go back and forth over the same travel with {_FEWEST} samples a "
            f"stroke ({forth} stroke(s) forth, {len(found) - forth} back)"
        )
    for stroke in found:
        counts, _ = np.histogram(
            position[stroke.start : stroke.stop], _PARTS, (low + margin, high - margin)
        )
        if counts.max() > _HALTS * max(float(np.median(counts)), 1.0):
            raise NotScored(f"{name} halts within a stroke")
    return found


def _fit_loop(
    line: Timeline,
    position: Samples,
    data: Samples,
    found: list[Stroke],
    notes: tuple[str, ...],
) -> HysteresisLoop:
    index = np.concatenate([np.arange(s.start, s.stop) for s in found])
    sense = np.concatenate([np.full(s.stop - s.start, s.sense) for s in found])
    x = position.values[index]
    middle, reach = 0.5 * (x.max() + x.min()), 0.5 * (x.max() - x.min())
    scale = magnitude(data.values[index]) or 1.0
    y = data.values[index] / scale
    bends = powers((x - middle) / reach)
    design = np.column_stack([sense, bends[:, : order(y, bends, sense[:, None]) + 1]])
    operator = np.linalg.pinv(design)
    coefficients = operator @ y
    rest = y - design @ coefficients
    noise = _noise(rest, found, data.resolution / scale)
    weights = np.zeros(int(index[-1] - index[0]) + 1)
    weights[index - index[0]] = operator[0]
    budget = type_a("noise", noise.variance(weights), noise.slow)
    budget += _between_strokes(rest, found, noise)
    left = rounding_sd(data.resolution / scale, noise.sd) * math.sqrt(1.5)
    budget += between("resolution", left)
    times = line.time
    speeds = [
        abs(float(position.values[s.stop - 1] - position.values[s.start]))
        / float(times[s.stop - 1] - times[s.start])
        for s in found
    ]
    half = float(coefficients[0]) * scale
    return HysteresisLoop(
        half=half,
        slope=float(np.polyfit(x - middle, y, 1)[0]) * scale,
        speed=float(np.mean(speeds)),
        budget=budget.scaled(scale) + type_b("sensor", data.relative * abs(half)),
        strokes=len(found),
        notes=notes,
    )


def _noise(rest: FloatArray, found: list[Stroke], resolution: float) -> Noise:
    """Return the noise of what the fit leaves, at least that of the sensor's rounding."""
    noise = estimate(_parts(rest, found))
    rounding = resolution**2 / 12.0
    if noise.known and noise.sd**2 < rounding:
        return Noise(np.array([rounding]), noise.freedom)
    return noise


def _parts(rest: FloatArray, found: list[Stroke]) -> list[FloatArray]:
    ends = np.cumsum([s.stop - s.start for s in found])
    return np.split(rest, ends[:-1])


def _between_strokes(rest: FloatArray, found: list[Stroke], noise: Noise) -> Budget:
    """Return the variance between strokes, where they scatter by more than their noise."""
    freedom = len(found) - 2
    if len(found) < _FEWEST_ALIKE or not noise.known:
        return Budget()
    means = np.array([float(part.mean()) for part in _parts(rest, found)])
    expected = np.array([noise.variance_of_mean(s.stop - s.start) for s in found])
    if not float(np.sum(means**2 / np.maximum(expected, 1e-300))) > chdtri(freedom, _UNLIKE):
        return Budget()
    variance = max(float(means @ means) / freedom - float(expected.mean()), 0.0)
    return type_a("strokes", variance / len(found), float(freedom))
