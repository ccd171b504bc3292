"""Statistics of channels over a stretch of time, with what noise and sensors make of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.formula import Statistic
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial
from eha_bench.metrics.coverage import NORMAL, between, reach, type_a, type_b
from eha_bench.metrics.metric import NotScored
from eha_bench.metrics.noise import white_noise
from eha_bench.metrics.resolution import rounding_sd
from eha_bench.metrics.samples import Samples, samples
from eha_bench.metrics.step_response import require_finite
from eha_bench.metrics.window import Timeline, timeline

_FEWEST = 2

_OF: Final[dict[str, Callable[[FloatArray], float]]] = {
    "mean": lambda values: float(np.mean(values)),
    "min": lambda values: float(np.min(values)),
    "max": lambda values: float(np.max(values)),
    "rms": lambda values: float(np.sqrt(np.mean(values * values))),
    "std": lambda values: float(np.std(values)),
}


def statistic_over(
    recording: Recording, trial: Trial, statistic: Statistic, start: float, stop: float
) -> Measure:
    """Return a statistic over start <= t < stop (s of the signal), within the scored time.

    White noise moves mean, rms and std by sd / sqrt(n); the extremes of many samples are too far
    out by about sd sqrt(2 ln n). A sensor's calibration is common to all samples.

    Raises:
        NotScored: fewer than two samples, or samples without a value.
        MissingChannelError: the recording lacks a channel.
    """
    line = timeline(recording, trial)
    window = line.between(max(start, 0.0), min(stop, trial.duration))
    count = window.stop - window.start
    if count < _FEWEST:
        raise NotScored(f"{max(count, 0)} sample(s) between {start:g} and {stop:g} s")
    channels = {name: samples(recording, trial, name) for name in statistic.of.names}
    for data in channels.values():
        require_finite(line, data.values, window)
    inside = {name: data.values[window] for name, data in channels.items()}

    def of(values: Mapping[str, FloatArray]) -> float:
        return _OF[statistic.name](statistic.of.value(values))

    value = of(inside)
    if not math.isfinite(value):
        raise NotScored("no finite value at every sample")
    series = statistic.of.value(inside)
    noise = white_noise(series)
    extreme = statistic.name in ("min", "max")
    budget = type_a("noise", noise**2 if extreme else noise**2 / count)
    for name, data in channels.items():
        # what moves carries its readings over the steps of the sensor, as noise does
        dither = max(noise, float(np.std(inside[name])))
        left = math.sqrt(3.0) * rounding_sd(data.resolution, dither)
        shifted = of({**inside, name: inside[name] + data.uncertainty})
        scaled = of({**inside, name: inside[name] * (1.0 + data.relative)})
        rounded = of({**inside, name: inside[name] + left})
        budget += type_b("sensor", math.hypot(shifted - value, scaled - value))
        budget += between("resolution", abs(rounded - value))
    own = reach(budget)
    low, high = value - own, value + own
    if extreme:
        beyond = noise * (math.sqrt(2.0 * math.log(max(count, 2))) - NORMAL)
        sign = 1.0 if statistic.name == "max" else -1.0
        low -= max(beyond, 0.0) if sign > 0.0 else 0.0
        high += max(beyond, 0.0) if sign < 0.0 else 0.0
    for name, data in channels.items():
        for cut in data.cut_off(window):
            far = float(np.ptp(inside[name])) * (1.0 if cut.above else -1.0)
            moved = of({**inside, name: inside[name] + far * cut.at}) - value
            low, high = (-math.inf if moved < 0.0 else low, math.inf if moved > 0.0 else high)
    if math.isinf(low) and math.isinf(high):
        raise NotScored("may be anything: a sensor's end cut readings off")
    return Measure(value, low, high, "; ".join(_notes(line, channels, window)), budget.merged())


def _notes(line: Timeline, channels: Mapping[str, Samples], window: slice) -> list[str]:
    noted = [(name, data.notes(line, window)) for name, data in channels.items()]
    return [f"{name}: {note}" for name, notes in noted for note in notes]
