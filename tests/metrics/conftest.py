"""Signals and recordings that the tests of the metrics are made of; truths come from theory."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import linalg
from scipy import signal as systems

from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.signal import Edge, Signal, Tone
from eha_bench.core.trial import ControlMode, Setup, Trial
from eha_bench.metrics.scoring import measure_safely, metric

CHANNEL = "pressure_difference"


@dataclass(frozen=True)
class Steps(Signal):
    """Held levels: `levels[0]` before times[0], levels[i + 1] from times[i] on."""

    times: tuple[float, ...]
    levels: tuple[float, ...]
    end: float

    @property
    def duration(self) -> float:
        return self.end

    def __call__(self, time):
        index = np.searchsorted(self.times, np.asarray(time) + 1e-9, side="right")
        return np.asarray(self.levels, dtype=np.float64)[index]

    @property
    def edges(self) -> tuple[Edge, ...]:
        ends = (*self.times[1:], self.end)
        pairs = zip(self.times, self.levels, self.levels[1:], ends, strict=False)
        return tuple(Edge(*pair) for pair in pairs)


@dataclass(frozen=True)
class Sines(Signal):
    """Stretches of sine, one after the other."""

    stretches: tuple[Tone, ...]

    @property
    def duration(self) -> float:
        return self.stretches[-1].stop

    def __call__(self, time):
        held = np.clip(np.asarray(time, dtype=np.float64), 0.0, self.duration)
        values = np.zeros_like(held)
        for tone in self.stretches:
            inside = (held >= tone.start - 1e-12) & (held <= tone.stop)
            angle = 2 * np.pi * tone.frequency * (held - tone.start) + tone.phase
            values = np.where(inside, tone.offset + tone.amplitude * np.sin(angle), values)
        return values

    @property
    def tones(self) -> tuple[Tone, ...]:
        return self.stretches


def make_trial(signal: Signal, duration: float, rate: float = 1000.0, settle: float = 0.0) -> Trial:
    return Trial(
        "trial", signal, ControlMode.PRESSURE, Setup(), duration, settle=settle, sample_rate=rate
    )


def step_response(system: tuple, period: float, count: int) -> np.ndarray:
    """(count,) samples of the unit step response of a transfer function (num, den).

    Exact: a constant input is one more state, z[k] = M^k z[0], and each half follows from the half
    before it.
    """
    a, b, c, d = systems.tf2ss(*system)
    size = len(a)
    step = linalg.expm(np.block([[a, b], [np.zeros((1, size + 1))]]) * period)
    states = np.append(np.zeros(size), 1.0)[:, None]
    while states.shape[1] < count:
        states, step = np.hstack((states, step @ states)), step @ step
    return (c @ states[:-1] + d)[0, :count]


def make_step(
    response: tuple | Callable,
    *,
    period: float = 1e-3,
    hold: float = 10.0,
    edge: float = 0.0,
    before: float = 0.1,
    initial: float = 0.0,
    size: float = 1.0,
    own: bool = True,
) -> tuple[Recording, Trial]:
    """A step response: (num, den) of a transfer function, or a function of time since the edge."""
    settle = round(before / period)
    ticks = np.arange(-settle, round(hold / period)) * period
    since = ticks - edge
    later = since >= -1e-9
    shape = np.zeros(ticks.size)
    if callable(response):
        shape[later] = response(np.maximum(since[later], 0.0))
    else:
        shape[later] = step_response(response, period, np.count_nonzero(later))
    reference = np.where(later, initial + size, initial)
    values = {CHANNEL: initial + size * shape, "reference": reference}
    metadata = {"signal_start": repr(float(-ticks[0]))} if own else {}
    signal = Steps((edge,), (initial, initial + size), hold)
    trial = make_trial(signal, hold, 1.0 / period, settle * period)
    return Recording(ticks - ticks[0], values, metadata=metadata), trial


def make_sine(
    frequency: float,
    *,
    ratio: float = 1.0,
    lag: float = 0.0,
    periods: int = 10,
    amplitude: float = 1.0,
    rate: float = 1000.0,
    own: bool = True,
    extra: Callable | None = None,
) -> tuple[Recording, Trial]:
    """A settled sine response of given amplitude ratio and lag, plus `extra(time)`."""
    tone = Tone(0.0, periods / frequency, frequency, amplitude)
    time = np.arange(round(tone.stop * rate)) / rate
    angle = 2 * np.pi * frequency * time
    values = ratio * amplitude * np.sin(angle - lag) + (extra(time) if extra else 0.0)
    signal = Sines((tone,))
    metadata = {"signal_start": "0.0"} if own else {}
    recording = Recording(time, {CHANNEL: values, "reference": signal(time)}, metadata=metadata)
    return recording, make_trial(signal, tone.stop, rate)


def with_noise(recording: Recording, sd: float, seed: int, colour: float = 0.0) -> Recording:
    """Add stationary noise of a standard deviation; `colour` is its lag-one correlation."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(0.0, 1.0, len(recording) + 200)
    if colour:
        noise = systems.lfilter([np.sqrt(1 - colour**2)], [1.0, -colour], noise)
    return recording.with_values({CHANNEL: recording[CHANNEL] + sd * noise[200:]})


def measure(name: str, recording: Recording, trial: Trial, channel: str = CHANNEL) -> Measure:
    return measure_safely(metric(name), recording, trial, channel)


def without(recording: Recording, *channels: str) -> Recording:
    values = {name: array for name, array in recording.values.items() if name not in channels}
    return replace(recording, values=values)


@pytest.fixture(scope="session")
def kit() -> SimpleNamespace:
    """What the tests of this folder share."""
    return SimpleNamespace(
        Steps=Steps,
        Sines=Sines,
        channel=CHANNEL,
        trial=make_trial,
        step=make_step,
        sine=make_sine,
        noisy=with_noise,
        measure=measure,
        without=without,
    )
