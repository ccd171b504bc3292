"""Holds that leak, strokes with friction and with play, each with its truth from theory."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from benchmarks.coverage_cases import AT_LEAST, Case, Draw, autoregressive
from benchmarks.truths import CHANNEL, RATE, Made

from eha_bench.core.arrays import FloatArray
from eha_bench.core.recording import Recording
from eha_bench.core.signal import Edge, Signal
from eha_bench.core.trial import ControlMode, Setup, Trial

Rng = np.random.Generator


@dataclass(frozen=True)
class Held(Signal):
    """A current of 1 A for a second, then none."""

    end: float

    @property
    def duration(self) -> float:
        return self.end

    def __call__(self, time: FloatArray) -> FloatArray:
        return np.where(np.asarray(time) < 1.0 - 1e-9, 1.0, 0.0)

    @property
    def edges(self) -> tuple[Edge, ...]:
        return (Edge(1.0, 1.0, 0.0, self.end),)


@dataclass(frozen=True)
class ToAndFro(Signal):
    """A triangle or a sine of some amplitude, periods and length."""

    shape: str
    amplitude: float
    period: float
    periods: float

    @property
    def duration(self) -> float:
        return self.period * self.periods

    def __call__(self, time: FloatArray) -> FloatArray:
        angle = 2.0 * math.pi * np.asarray(time) / self.period
        if self.shape == "sine":
            return np.asarray(self.amplitude * np.sin(angle))
        return np.asarray(self.amplitude * 2.0 / math.pi * np.arcsin(np.sin(angle)))


def _recording(
    ticks: FloatArray, values: dict[str, FloatArray], units: dict[str, str]
) -> Recording:
    return Recording(ticks, values, units, metadata={"signal_start": "0.0"})


def leaking(colour: float, share: float, resolution: float = 0.0) -> Draw:
    """A pressure that falls with a time constant of 0.5 to 20 s, noise a share of it."""

    def draw(rng: Rng) -> Made:
        end = 1.0 + rng.uniform(1.0, 4.0)
        ticks = np.arange(0, round(end * RATE)) / RATE
        size, constant = rng.uniform(1e6, 2e7) * rng.choice([-1.0, 1.0]), rng.uniform(0.5, 20.0)
        clean = size * np.exp(-np.maximum(ticks - 1.0, 0.0) / constant)
        data = clean + abs(size) * share * autoregressive(rng, ticks.size, colour)
        if resolution:
            data = np.round(data / (abs(size) * resolution)) * (abs(size) * resolution)
        signal = Held(end)
        values = {CHANNEL: data, "reference": signal(ticks)}
        window = ticks >= 1.0 + 0.5 * (end - 1.0) - 1e-6
        slope = np.polyfit(ticks[window] - 1.0, clean[window], 1)[0]
        truth = -math.copysign(1.0, size) * float(slope)
        made = _recording(ticks, values, {CHANNEL: "Pa", "reference": "A"})
        trial = Trial("x", signal, ControlMode.CURRENT, Setup(), end, 0.0, RATE)
        return made, trial, {"pressure_decay": truth}, abs(size)

    return draw


def strokes(shape: str, colour: float, share: float) -> Draw:
    """A load that weighs by its place, Coulomb and viscous friction; noise a share of Coulomb."""

    def draw(rng: Rng) -> Made:
        signal = ToAndFro(
            shape, rng.uniform(0.02, 0.1), rng.uniform(1.0, 4.0), rng.choice([1.5, 2, 3])
        )
        ticks = np.arange(0, round(signal.duration * RATE)) / RATE
        position = signal(ticks)
        speed = np.gradient(position, ticks)
        inside = np.abs(position) < 0.6 * signal.amplitude
        coulomb, viscous = rng.uniform(1e4, 1e6), rng.uniform(0.0, 1e6)
        friction = coulomb * np.sign(speed) + viscous * speed
        weight = rng.uniform(0.0, 3e6) * np.cos(position * rng.uniform(1.0, 20.0))
        effort = friction + weight + rng.uniform(-1e6, 1e6)
        values = {
            CHANNEL: effort + coulomb * share * autoregressive(rng, ticks.size, colour),
            "piston_position": position + rng.normal(0.0, 1e-5, ticks.size),
            "reference": position,
        }
        units = {CHANNEL: "Pa", "piston_position": "m", "reference": "m"}
        truth = coulomb + viscous * float(np.mean(np.abs(speed[inside])))
        trial = Trial("x", signal, ControlMode.PISTON_POSITION, Setup(), signal.duration, 0.0, RATE)
        return _recording(ticks, values, units), trial, {"stroke_friction": truth}, coulomb

    return draw


def play(colour: float, share: float) -> Draw:
    """A drive that turns a joint through a bent linkage with play; noise a share of the play."""

    def draw(rng: Rng) -> Made:
        signal = ToAndFro(
            "sine", rng.uniform(0.2, 0.6), rng.uniform(1.0, 4.0), rng.choice([2, 3, 4])
        )
        ticks = np.arange(0, round(signal.duration * RATE)) / RATE
        width = rng.uniform(1e-4, 2e-3)
        angle = signal(ticks)
        # what drives is ahead by half the play, on the side that it pushes from
        side = np.sign(np.cos(2.0 * math.pi * ticks / signal.period))
        drive = 0.05 * np.sin(angle) + 0.01 * angle**2 + 0.5 * width * side
        values = {
            "piston_position": drive + width * share * autoregressive(rng, ticks.size, colour),
            "joint_angle": angle + rng.normal(0.0, 1e-4, ticks.size),
            "reference": angle,
        }
        units = {"piston_position": "m", "joint_angle": "rad", "reference": "rad"}
        trial = Trial("x", signal, ControlMode.JOINT_ANGLE, Setup(), signal.duration, 0.0, RATE)
        return _recording(ticks, values, units), trial, {"backlash": width}, width

    return draw


WEAR = (
    Case("leak, white 1 %", leaking(0.0, 0.01), ("pressure_decay",)),
    Case("leak, AR 0.7 1 %", leaking(0.7, 0.01), ("pressure_decay",)),
    Case("leak, AR 0.95 1 %", leaking(0.95, 0.01), ("pressure_decay",)),
    Case("leak, LSB 0.5 %", leaking(0.0, 1e-4, 0.005), ("pressure_decay",), AT_LEAST),
    Case("triangle, white 50 %", strokes("triangle", 0.0, 0.5), ("stroke_friction",)),
    Case("triangle, AR 0.9 20 %", strokes("triangle", 0.9, 0.2), ("stroke_friction",)),
    Case("sine, white 10 %", strokes("sine", 0.0, 0.1), ("stroke_friction",)),
    Case("sine, AR 0.9 20 %", strokes("sine", 0.9, 0.2), ("stroke_friction",)),
    Case("play, white 50 %", play(0.0, 0.5), ("backlash",)),
    Case("play, AR 0.9 50 %", play(0.9, 0.5), ("backlash",)),
)
