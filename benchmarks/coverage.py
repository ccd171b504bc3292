"""How often a 95 % interval holds the truth, over simulated recordings of random systems.

    python -m benchmarks.coverage [--recordings 2000] [--seed 0] [--only steps ...] [--json FILE]

Every recording has its own system, drawn at random; the truth is from theory, not from a metric.
Noise is a share of the step or amplitude: two levels of white noise, and one of noise whose
lag-one correlation is 0.7; every line has recordings and noise of its own. The last lines are the
medians of a trial's repeats: 3, 5 and 10 values of a normal and of a skewed distribution.

Wanted: 93 to 97 %. The count of recordings leaves a standard error (0.5 % of 2,000); a line whose
coverage is within two of them of a border says 'near', since another seed may decide otherwise.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.signal import lfilter

from eha_bench.core.recording import Recording
from eha_bench.core.signal import Edge, Lines, Signal, Tone
from eha_bench.core.trial import ControlMode, Setup, Trial
from eha_bench.metrics.repeats import median_interval
from eha_bench.metrics.scoring import measure_safely, metric

FloatArray = NDArray[np.float64]
Truths = dict[str, float]
Made = tuple[Recording, Trial, Truths, float]

CHANNEL = "pressure_difference"
RATE = 1000.0
WANTED = (0.93, 0.97)


@dataclass(frozen=True)
class Line:
    """One line of the table."""

    metric: str
    noise: str
    recordings: int
    scored: int
    coverage: float
    below: float  # share of intervals that lie below the truth
    above: float
    width: float  # median width over the truth

    @property
    def error(self) -> float:
        """Standard error of the coverage, by the number of recordings."""
        inside = min(max(self.coverage, 0.01), 0.99)
        return math.sqrt(inside * (1.0 - inside) / max(self.scored, 1))

    @property
    def surely_not(self) -> bool:
        """Whether the true coverage lies outside of what is wanted, whatever the seed."""
        low, high = WANTED
        return self.coverage < low - 2.0 * self.error or self.coverage > high + 2.0 * self.error

    @property
    def verdict(self) -> str:
        low, high = WANTED
        if low + 2.0 * self.error <= self.coverage <= high - 2.0 * self.error:
            return "yes"
        if self.surely_not:
            return "no"
        return "yes, near" if low <= self.coverage <= high else "no, near"


@dataclass(frozen=True)
class Noise:
    name: str
    level: float
    colour: float = 0.0

    def draw(self, rng: np.random.Generator, count: int) -> FloatArray:
        white = rng.normal(0.0, self.level, count + 100)
        if not self.colour:
            return white[100:]
        gain = math.sqrt(1.0 - self.colour**2)
        return np.asarray(lfilter([gain], [1.0, -self.colour], white))[100:]


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
            Lines(float(self.periods * k), float(self.periods * (k + 1)), 1.0, self.harmonics, k)
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


# --- counting --------------------------------------------------------------------------------


def recorded(ticks: FloatArray, values: FloatArray, signal: Signal) -> Recording:
    """The bench's own recording of values at ticks (s of the signal)."""
    start = {"signal_start": repr(float(-ticks[0]))}
    return Recording(
        ticks - ticks[0], {CHANNEL: values, "reference": signal(ticks)}, metadata=start
    )


def trial(signal: Signal, duration: float, settle: float) -> Trial:
    return Trial("x", signal, ControlMode.PRESSURE, Setup(), duration, settle, RATE)


def cover(
    make: Callable[[int, int], Iterator[Made]], noise: Noise, count: int, seed: int
) -> list[Line]:
    """Score `count` recordings and count in how many of them the interval holds the truth."""
    # every line its own luck: systems and noise are drawn anew for each kind of noise
    own = zlib.crc32(f"{make.__name__} {noise.name}".encode())
    rng = np.random.default_rng([seed, own, 1])
    found: dict[str, list[tuple[float, float, float]]] = {}
    for recording, asked, truths, size in make(count, own + seed):
        data = recording[CHANNEL] + size * noise.draw(rng, len(recording))
        noisy = recording.with_values({CHANNEL: data})
        for name, truth in truths.items():
            measure = measure_safely(metric(name), noisy, asked, CHANNEL)
            if math.isfinite(measure.low) and math.isfinite(measure.high):
                found.setdefault(name, []).append((measure.low, truth, measure.high))
            else:
                found.setdefault(name, [])
    return [counted(name, noise.name, count, intervals) for name, intervals in found.items()]


def counted(name: str, noise: str, count: int, intervals: list[tuple[float, float, float]]) -> Line:
    """The line of (low, truth, high) of the recordings that were scored."""
    low, truth, high = np.array(intervals or [(math.nan,) * 3]).T
    return Line(
        metric=name,
        noise=noise,
        recordings=count,
        scored=len(intervals),
        coverage=float(np.mean((low <= truth) & (truth <= high))),
        below=float(np.mean(high < truth)),
        above=float(np.mean(low > truth)),
        width=float(np.median((high - low) / truth)),
    )


def repeats(count: int, seed: int) -> Iterator[Line]:
    """Medians of few repeats; the truth is the median of the distribution they are drawn from."""
    rng = np.random.default_rng([seed, 2])
    for size in (3, 5, 10):
        for name, spread in (("normal", 0.0), ("skewed", 0.5)):
            found = []
            for _ in range(count):
                drawn = rng.normal(size=size)
                # lognormal with a shape of 0.5, or normal; the median is 1
                values = np.exp(spread * drawn) if spread else 1.0 + 0.1 * drawn
                low, high = median_interval(values)
                found.append((low, 1.0, high))
            yield counted(f"median of {size}", name, count, found)


WHITE = {"steps": (0.003, 0.02), "sines": (0.01, 0.1), "multisines": (0.01, 0.05)}
MAKERS: dict[str, Callable[[int, int], Iterator[Made]]] = {
    "steps": steps,
    "sines": sines,
    "multisines": multisines,
}


def table(count: int, seed: int, only: list[str]) -> Iterator[Line]:
    """Every line of the table."""
    for kind, make in MAKERS.items():
        if kind not in only:
            continue
        low, high = WHITE[kind]
        for noise in (
            Noise(f"white {100 * low:g} %", low),
            Noise(f"white {100 * high:g} %", high),
            Noise(f"correlated {100 * low:g} %", low, 0.7),
        ):
            yield from cover(make, noise, count, seed)
    if "repeats" in only:
        yield from repeats(count, seed)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--recordings", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    kinds = [*MAKERS, "repeats"]
    parser.add_argument("--only", nargs="+", choices=kinds, default=kinds)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    start = time.perf_counter()
    header = f"{'metric':17}{'noise':18}{'scored':>12}{'coverage':>16}{'below':>8}{'above':>8}"
    print(f"{header}{'width':>9}  93-97 %")
    lines = []
    for line in table(options.recordings, options.seed, options.only):
        lines.append(line)
        print(
            f"{line.metric:17}{line.noise:18}{line.scored:6}/{line.recordings:<5}"
            f"{100 * line.coverage:9.1f} +- {100 * line.error:.1f}"
            f"{100 * line.below:7.1f}%{100 * line.above:7.1f}%"
            f"{100 * line.width:8.2f}%  {line.verdict}",
            flush=True,
        )
    print(f"{time.perf_counter() - start:.0f} s", file=sys.stderr)
    if options.json:
        options.json.write_text(json.dumps([asdict(line) for line in lines], indent=1) + "\n")
    return 1 if any(line.surely_not for line in lines) else 0


if __name__ == "__main__":
    sys.exit(main())
