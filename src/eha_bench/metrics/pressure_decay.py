"""Pressure decay: how fast a pressure falls in a hold that nothing makes up for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.budget import Budget
from eha_bench.core.channels import unit_of
from eha_bench.core.metric import Better, MetricSpec
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial
from eha_bench.metrics.coverage import between, reach, type_a, type_b
from eha_bench.metrics.metric import Metric, NotScored
from eha_bench.metrics.noise import Noise, estimate
from eha_bench.metrics.polynomial import HIGHEST_ORDER, order, powers
from eha_bench.metrics.resolution import rounding_sd
from eha_bench.metrics.samples import Samples, samples
from eha_bench.metrics.step_response import MOST_EDGES, magnitude, require_finite
from eha_bench.metrics.window import Timeline, commanded_edges, timeline

_LATTER = 0.5  # share of the hold that is used, at its end: the rest is the edge's own transient
_FEWEST = 20
_BLOCKS = 30
_TAKEN = 0.7  # most of the noise's variance that a curve is taken to have eaten
_SEEN = 5.0  # standard errors that a pressure has to be away from zero to be one that can fall


class PressureDecay(Metric):
    """Slope of the straight line closest to the pressure over the latter half of a hold.

    The line is that of least squares, also where the pressure falls along a curve: a mean rate
    over the window, of which every sample says something.
    """

    spec = MetricSpec(
        "pressure_decay",
        "rate at which a pressure falls towards zero in the latter half of a hold",
        "Pa/s",
        "pressure_difference",
        better=Better.LOWER,
    )
    by_default = False

    def applies(self, trial: Trial) -> bool:
        """Whether the signal has holds: few edges, or nothing but a constant."""
        return len(trial.signal.edges) <= MOST_EDGES and not trial.signal.lines

    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:
        """Return the fastest fall over the holds; negative where the pressure only rises."""
        if (recording.unit(channel) or unit_of(channel)) != "Pa":
            recording[channel]  # a missing channel is reported first
            raise NotScored(f"{channel} is not a pressure")
        if trial.mode.unit == "Pa":
            raise NotScored(
                f"the reference asks for {trial.channel}: its controller makes up for the leakage"
            )
        line = timeline(recording, trial)
        data = samples(recording, trial, channel)
        found = [one for one in (_fall(line, data, w) for w in _holds(line, trial)) if one]
        if not found:
            raise NotScored(f"{channel} is not distinct from zero in any hold: nothing can decay")
        worst = max(found, key=lambda fall: fall.rate)
        own = reach(worst.budget)
        first, last = line.time[worst.window][[0, -1]]
        where = f"from {first:.6g} s to {last:.6g} s, at {1e-6 * worst.level:.4g} MPa"
        notes = [f"fastest of {len(found)} holds, {where}" if len(found) > 1 else where]
        notes += [line.how] if line.how else []
        notes += data.notes(line, worst.window)
        return Measure(
            worst.rate, worst.rate - own, worst.rate + own, "; ".join(notes), worst.budget.merged()
        )


@dataclass(frozen=True)
class _Fall:
    """A hold's window, its mean pressure (Pa), the rate of its fall (Pa/s) and what moves that."""

    window: slice
    level: float
    rate: float
    budget: Budget


def _holds(line: Timeline, trial: Trial) -> list[slice]:
    """Return the latter half of every stretch in which the reference stays as it is."""
    if trial.signal.edges:
        spans = [(edge.time, edge.until) for edge in commanded_edges(line, trial)]
    else:
        end = min(trial.duration, float(line.time[-1]) + line.period)
        inside = line.reference[line.between(0.0, end)]
        if inside.size == 0 or not np.all(inside == inside[0]):
            raise NotScored("the reference is held nowhere: it neither steps nor stays")
        spans = [(0.0, end)]
    return [line.between(stop - _LATTER * (stop - start), stop) for start, stop in spans]


def _fall(line: Timeline, data: Samples, window: slice) -> _Fall | None:
    """Return how fast the pressure falls in a window; None where it is not distinct from zero."""
    values = data.values[window]
    if values.size < _FEWEST:
        raise NotScored(f"{values.size} sample(s) in the latter half of a hold, {_FEWEST} needed")
    require_finite(line, data.values, window)
    scale = magnitude(values)
    if scale == 0.0:
        return None
    own = values / scale
    time = line.time[window] - float(line.time[window].mean())
    weights = time / float(time @ time)
    noise = _noise(time, own)
    mean = float(own.mean())
    if not abs(mean) > _SEEN * (noise.variance_of_mean(own.size) ** 0.5) + data.resolution / scale:
        return None
    fall = -np.sign(mean) * float(weights @ own)
    length = float(time[-1] - time[0])
    # rounding that no noise dithers moves either end of the line by up to half a step
    rounding = 3.0**0.5 * rounding_sd(data.resolution / scale, noise.sd)
    steps = max(abs(fall) * length * scale / max(data.resolution, 1e-300), 1.0)
    budget = (
        type_a("noise", noise.variance(weights), noise.slow)
        + between("resolution", 2.0 * rounding / length / steps)
        + type_b("sensor", data.relative * abs(fall))
    )
    return _Fall(window, mean * scale, float(fall) * scale, budget.scaled(scale))


def _noise(time: FloatArray, values: FloatArray) -> Noise:
    """Return the noise about the curve that the values follow, (n,) s from the middle and (n,)."""
    place = time / float(np.max(np.abs(time)))
    # slow noise looks like bends, sample by sample: means of blocks tell the two apart
    blocks = min(values.size // 4, _BLOCKS)
    means, places = _means(values, blocks), _means(place, blocks)
    most = min(HIGHEST_ORDER, blocks // 4)
    count = order(means, powers(places, most)) + 1
    curve = powers(place, count - 1)
    noise = estimate([values - curve @ np.linalg.lstsq(curve, values)[0]])
    if not noise.sd > 0.0:
        return noise
    # a line's share of slow noise is given back by the estimate; each further order takes as much
    alike = noise.variance_of_mean(values.size) / noise.sd**2
    taken = min((count - 2) * alike, _TAKEN)
    return Noise(noise.autocovariance / (1.0 - taken), noise.freedom, noise.slow)


def _means(values: FloatArray, count: int) -> FloatArray:
    """Return the means of `count` blocks of (n,) values that are as long as each other, or one off.

    The first n mod `count` are the longer ones.
    """
    size, longer = divmod(values.size, count)
    head = values[: longer * (size + 1)].reshape(longer, size + 1)
    tail = values[longer * (size + 1) :].reshape(count - longer, size)
    return np.concatenate([head.mean(axis=1), tail.mean(axis=1)])
