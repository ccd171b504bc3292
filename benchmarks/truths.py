"""Recordings of random systems with the truth from theory: steps, sines, multisines."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import brentq

from eha_bench.core.arrays import FloatArray
from eha_bench.core.recording import Recording
from eha_bench.core.signal import Edge, Lines, Signal, Tone
from eha_bench.core.trial import ControlMode, Setup, Trial

Truths = dict[str, float]
Made = tuple[Recording, Trial, Truths, float]
"""Recording, trial, true values by metric, and the size that noise is a share of."""

CHANNEL = "pressure_difference"
RATE = 1000.0


def recorded(ticks: FloatArray, values: FloatArray, signal: Signal) -> Recording:
    """The bench's own recording of values at ticks (s of the signal)."""
    start = {"signal_start": repr(float(-ticks[0]))}
    return Recording(
        ticks - ticks[0], {CHANNEL: values, "reference": signal(ticks)}, metadata=start
    )


def trial(signal: Signal, duration: float, settle: float) -> Trial:
    return Trial("x", signal, ControlMode.PRESSURE, Setup(), duration, settle, RATE)


# --- steps of second-order systems -----------------------------------------------------------


@dataclass(frozen=True)
class Step(Signal):
    edge: Edge

    @property
    def duration(self) -> float:
        return self.edge.until

    def __call__(self, time: FloatArray) -> FloatArray:
        return np.where(np.asarray(time) >= self.edge.time - 1e-9, self.edge.after, 0.0)

    @property
    def edges(self) -> tuple[Edge, ...]:
        return (self.edge,)


def second_order(time: FloatArray | float, damping: float) -> FloatArray:
    """Step response at natural frequency 1, (n,) -> (n,)."""
    root = math.sqrt(1.0 - damping**2)
    angle = root * np.asarray(time)
    shape = np.cos(angle) + damping / root * np.sin(angle)
    return np.asarray(1.0 - np.exp(-damping * np.asarray(time)) * shape)


@cache
def reaches(damping: float, share: float) -> float:
    """Time at which the step response first reaches a share of its final value."""
    grid = np.linspace(0.0, math.pi / math.sqrt(1.0 - damping**2), 200)
    index = int(np.argmax(second_order(grid, damping) >= share))
    return float(
        brentq(
            lambda t: float(second_order(t, damping)) - share,
            grid[index - 1],
            grid[index],
            xtol=1e-12,
        )
    )


@cache
def settles(damping: float) -> float:
    """Time after which the step response stays within 2 % of its final value."""
    grid = np.linspace(0.0, 12.0 / damping, 200_001)
    return float(grid[np.flatnonzero(np.abs(second_order(grid, damping) - 1.0) > 0.02)[-1] + 1])


def steps(count: int, seed: int) -> Iterator[Made]:
    """Damping 0.4 to 0.8, 50 to 150 rad/s (rise times of 10 to 45 ms), held for 0.6 s."""
    rng = np.random.default_rng(seed)
    ticks = np.arange(-150, 600) / RATE
    for _ in range(count):
        damping, natural = rng.uniform(0.4, 0.8), rng.uniform(50.0, 150.0)
        size = rng.uniform(1e6, 3e7) * rng.choice([-1.0, 1.0])
        values = size * second_order(natural * np.maximum(ticks, 0.0), damping)
        signal = Step(Edge(0.0, 0.0, size, 0.6))
        truths = {
            "rise_time": (reaches(damping, 0.9) - reaches(damping, 0.1)) / natural,
            "response_time": reaches(damping, 0.95) / natural,
            "dead_time": reaches(damping, 0.05) / natural,
            "delay_time": reaches(damping, 0.5) / natural,
            "overshoot": math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2)),
            "settling_time": settles(damping) / natural,
            "peak_time": math.pi / math.sqrt(1.0 - damping**2) / natural,
        }
        yield recorded(ticks, values, signal), trial(signal, 0.6, 0.15), truths, abs(size)


# --- sines -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sine(Signal):
    tone: Tone

    @property
    def duration(self) -> float:
        return self.tone.stop

    def __call__(self, time: FloatArray) -> FloatArray:
        return np.asarray(
            self.tone.amplitude * np.sin(2 * np.pi * self.tone.frequency * np.asarray(time))
        )

    @property
    def tones(self) -> tuple[Tone, ...]:
        return (self.tone,)


def sines(count: int, seed: int) -> Iterator[Made]:
    """2 to 20 Hz, 10 periods, a transient at the start."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        frequency, amplitude = rng.uniform(2.0, 20.0), rng.uniform(1e6, 3e7)
        ratio, lag = rng.uniform(0.5, 1.2), rng.uniform(0.0, 2.0)
        signal = Sine(Tone(0.0, 10.0 / frequency, frequency, amplitude))
        ticks = np.arange(round(signal.duration * RATE)) / RATE
        values = ratio * amplitude * np.sin(2 * np.pi * frequency * ticks - lag)
        values += amplitude * np.exp(-ticks * frequency * 5.0)
        truths = {"amplitude_ratio": ratio, "phase_lag": lag}
        made = recorded(ticks, values, signal), trial(signal, signal.duration, 0.0)
        yield *made, truths, amplitude


# --- frequency responses ---------------------------------------------------------------------


@dataclass(frozen=True)
class Multisine(Signal):
    harmonics: tuple[int, ...]
    phases: tuple[tuple[float, ...], ...]
    periods: int

    @property
    def duration(self) -> float:
        return float(self.periods * len(self.phases))

    def __call__(self, time: FloatArray) -> FloatArray:
        raise NotImplementedError("the recording holds the reference")

    @property
    def lines(self) -> tuple[Lines, ...]:
        return tuple(
            Lines(float(self.periods * k), float(self.periods * (k + 1)), 1.0, self.harmonics)
            for k in range(len(self.phases))
        )


def multisines(count: int, seed: int) -> Iterator[Made]:
    """Odd lines from 1 to 61 Hz, 4 realisations of 3 periods of 1 s; bandwidths of 6 to 20 Hz."""
    rng = np.random.default_rng(seed)
    harmonics = tuple(range(1, 62, 2))
    orders = np.array(harmonics)
    size = int(RATE)
    for _ in range(count):
        damping, natural = rng.uniform(0.4, 0.9), rng.uniform(6.0, 15.0)
        phases = rng.uniform(0.0, 2 * np.pi, (4, orders.size))
        signal = Multisine(harmonics, tuple(map(tuple, phases.tolist())), 3)
        s = 1j * orders / natural
        plant = 1.0 / (s * s + 2.0 * damping * s + 1.0)
        parts = []
        for gain in (np.ones(orders.size), plant):
            spectrum = np.zeros((4, size // 2 + 1), dtype=np.complex128)
            spectrum[:, orders] = np.exp(1j * phases) * gain * (size / 2)
            parts.append(np.tile(np.fft.irfft(spectrum, axis=1), (1, 3)).ravel())
        ticks = np.arange(parts[0].size) / RATE
        a = 1.0 - 2.0 * damping**2
        truths = {
            "bandwidth_3db": natural * math.sqrt(a + math.sqrt(a * a + 1.0)),
            "bandwidth_90deg": natural,
        }
        recording = Recording(
            ticks, {CHANNEL: parts[1], "reference": parts[0]}, metadata={"signal_start": "0.0"}
        )
        rms = math.sqrt(orders.size / 2.0)
        yield recording, trial(signal, signal.duration, 0.0), truths, rms
