"""Recordings that intervals were found not to hold on, each with its truth from theory.

A case draws a system, a command and a disturbance at random and returns the recording with the
true values. Sensors with a resolution, few samples a rise, strongly correlated and heavy-tailed
noise, spikes, lost samples, short records, resonances between the lines of a stepped sine.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from benchmarks.truths import (
    CHANNEL,
    Made,
    Sine,
    Step,
    recorded,
    second_order,
    trial,
)
from scipy.signal import butter, cont2discrete, lfilter

from eha_bench.core.arrays import ComplexArray, FloatArray
from eha_bench.core.signal import Edge, Signal, Tone
from eha_bench.suites.signals.chirp import Chirp
from eha_bench.suites.signals.stepped_sine import SteppedSine

Draw = Callable[[np.random.Generator], Made]
Response = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Case:
    """One kind of recording.

    Attributes:
        name: as in the table.
        draw: a recording with its trial, truths and size.
        metrics: those that are counted.
        wanted: share of the intervals that hold the truth, least and most.
        may_refuse: share of the recordings that may go without a score: a tenth more than before
            the intervals were mended.
    """

    name: str
    draw: Draw
    metrics: tuple[str, ...]
    wanted: tuple[float, float] = (0.93, 0.97)
    may_refuse: float = 0.10


# --- noise -------------------------------------------------------------------------------------


def autoregressive(rng: np.random.Generator, count: int, colour: float) -> FloatArray:
    """Normal noise of standard deviation 1 with a lag-one correlation, (count,)."""
    lead = 100 + int(10.0 / (1.0 - colour))
    white = rng.normal(size=count + lead)
    gain = math.sqrt(1.0 - colour**2)
    return np.asarray(lfilter([gain], [1.0, -colour], white))[lead:]


def student(rng: np.random.Generator, count: int) -> FloatArray:
    """Student's t with three degrees of freedom, standard deviation 1, (count,)."""
    return np.asarray(rng.standard_t(3, count) / math.sqrt(3.0))


def spikes(rng: np.random.Generator, count: int) -> FloatArray:
    """Single samples, one in 200, that are off by a tenth to the whole of the step, (count,)."""
    size = rng.uniform(0.1, 1.0, count) * rng.choice([-1.0, 1.0], count)
    return np.where(rng.random(count) < 0.005, size, 0.0)


# --- steps -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Shape:
    """A step response from 0 to 1 whose features are read from a fine grid.

    Attributes:
        response: of time in s since the edge, 0 at the edge.
        slowest: time constant of its tail, s.
    """

    response: Response
    slowest: float

    def truths(self) -> dict[str, float]:
        """Times in s and extremes as fractions of the step."""
        grid = np.linspace(0.0, 12.0 * self.slowest, 12_001)
        values = self.response(grid)

        def reaches(share: float) -> float:
            index = int(np.argmax(values >= share))
            before, after = values[index - 1], values[index]
            return float(
                grid[index - 1] + (share - before) / (after - before) * (grid[1] - grid[0])
            )

        last = int(np.flatnonzero(np.abs(values - 1.0) > 0.02)[-1])
        here, there = abs(values[last] - 1.0), abs(values[last + 1] - 1.0)
        settled = grid[last] + (here - 0.02) / (here - there) * (grid[1] - grid[0])
        top = int(np.argmax(values))
        height, at = float(values[top]), float(grid[top])
        if 0 < top < grid.size - 1:  # the parabola through the highest of the grid
            before, after = values[top - 1] - height, values[top + 1] - height
            away = 0.5 * (before - after) / (before + after)
            at += float(away) * float(grid[1])
            height -= 0.25 * float((before - after) * away)
        return {
            "rise_time": reaches(0.9) - reaches(0.1),
            "response_time": reaches(0.95),
            "delay_time": reaches(0.5),
            "settling_time": float(settled),
            "overshoot": max(height - 1.0, 0.0) if top < grid.size - 2 else 0.0,
            "undershoot": max(-float(values.min()), 0.0),
            "peak_time": at,
        }


@dataclass(frozen=True)
class Known(Shape):
    """A step response whose times are known."""

    times: dict[str, float]

    def truths(self) -> dict[str, float]:
        """Those times; there is no overshoot."""
        return {**self.times, "overshoot": 0.0, "undershoot": 0.0}


def underdamped(rng: np.random.Generator) -> Shape:
    """Second order, damping 0.4 to 0.8, 50 to 150 rad/s."""
    damping, natural = rng.uniform(0.4, 0.8), rng.uniform(50.0, 150.0)
    return Shape(lambda t: second_order(natural * t, damping), 1.0 / (damping * natural))


def first_order(rng: np.random.Generator) -> Shape:
    """Time constants of 5 to 20 ms."""
    tau = rng.uniform(0.005, 0.02)
    return Shape(lambda t: -np.expm1(-np.asarray(t) / tau), tau)


def non_minimum_phase(rng: np.random.Generator) -> Shape:
    """(1 - T s) / (s^2 + 2 d s + 1): first the wrong way, by 15 to 70 % of the step."""
    damping, natural = rng.uniform(0.5, 0.8), rng.uniform(40.0, 100.0)
    zero = rng.uniform(0.8, 2.5)
    root = math.sqrt(1.0 - damping**2)

    def response(time: FloatArray) -> FloatArray:
        angle = natural * np.asarray(time)
        impulse = np.exp(-damping * angle) * np.sin(root * angle) / root
        return np.asarray(second_order(angle, damping) - zero * impulse)

    return Shape(response, 1.0 / (damping * natural))


def step(
    rng: np.random.Generator,
    shape: Shape,
    disturbance: Callable[[int], FloatArray],
    *,
    rate: float = 1000.0,
    hold: float = 0.6,
    before: float = 0.15,
    resolution: float = 0.0,
) -> Made:
    """A recording of one step; disturbance and resolution as shares of the step."""
    size = rng.uniform(1e6, 3e7) * rng.choice([-1.0, 1.0])
    initial, missing = rng.uniform(1e5, 1e7), rng.uniform(-0.02, 0.02)
    lead, held = round(before * rate), round(hold * rate)
    ticks = np.arange(-lead, held) / rate
    values = shape.response(np.maximum(ticks, 0.0)) + disturbance(ticks.size)
    values = initial + size * values
    if resolution:
        values = np.round(values / (resolution * abs(size))) * resolution * abs(size)
    # the command asks for a little more or less than the response comes to
    edge = Edge(0.0, initial, initial + size * (1.0 + missing), held / rate)
    signal = Step(edge)
    made = recorded(ticks, values, signal)
    reference = np.where(ticks >= -1e-9, edge.after, edge.before)
    truths = {**shape.truths(), "steady_state_error": size * missing}
    asked = replace(trial(signal, held / rate, before), sample_rate=rate)
    return made.with_values({"reference": reference}), asked, truths, abs(size)


def quantised(rng: np.random.Generator) -> Made:
    return step(rng, underdamped(rng), lambda n: rng.normal(0.0, 0.001, n), resolution=0.01)


def quantised_coarsely(rng: np.random.Generator) -> Made:
    """A resolution of 0.3 to 3 % of the step, noise of 0 to 0.5 of it."""
    resolution = math.exp(rng.uniform(math.log(0.003), math.log(0.03)))
    sd = resolution * rng.uniform(0.0, 0.5)
    return step(rng, underdamped(rng), lambda n: rng.normal(0.0, sd, n), resolution=resolution)


def few_samples(noise: float, least: float = 2.0, most: float = 3.0) -> Draw:
    def draw(rng: np.random.Generator) -> Made:
        shape = underdamped(rng)
        rate = rng.uniform(least, most) / shape.truths()["rise_time"]
        hold, before = 120.0 / rate, 40.0 / rate
        return step(
            rng,
            shape,
            lambda n: rng.normal(0.0, noise, n) if noise else np.zeros(n),
            rate=rate,
            hold=hold,
            before=before,
        )

    return draw


def silent(rng: np.random.Generator) -> Made:
    return step(rng, underdamped(rng), np.zeros)


def flat_start(rng: np.random.Generator) -> Made:
    level = rng.uniform(0.01, 0.03)
    return step(rng, first_order(rng), lambda n: rng.normal(0.0, level, n))


def wrong_way(rng: np.random.Generator) -> Made:
    level = math.exp(rng.uniform(math.log(0.003), math.log(0.02)))
    return step(rng, non_minimum_phase(rng), lambda n: rng.normal(0.0, level, n))


def lagging(rng: np.random.Generator) -> Shape:
    """A dead time of 2 to 30 ms and a first-order lag of 5 to 30 ms: it sets off all at once."""
    tau, dead = rng.uniform(0.005, 0.03), rng.uniform(0.002, 0.03)
    found = Shape(lambda t: -np.expm1(-np.maximum(np.asarray(t) - dead, 0.0) / tau), tau)
    times = {
        "dead_time": dead - tau * math.log(0.95),
        "delay_time": dead + tau * math.log(2.0),
        "response_time": dead + tau * math.log(20.0),
        "rise_time": tau * math.log(9.0),
    }
    return Known(found.response, tau, times)


def delayed(rng: np.random.Generator) -> Made:
    level = math.exp(rng.uniform(math.log(0.001), math.log(0.02)))
    return step(rng, lagging(rng), lambda n: rng.normal(0.0, level, n))


def stopping(rng: np.random.Generator) -> Shape:
    """As fast as it may, to a stop that a lag of 2 to 10 % of the way rounds."""
    length = rng.uniform(0.01, 0.06)
    lag = length * rng.uniform(0.02, 0.1)

    def moved(time: FloatArray) -> FloatArray:
        after = np.maximum(time, 0.0)
        return np.asarray(after + lag * np.expm1(-after / lag))

    def response(time: FloatArray) -> FloatArray:
        return np.asarray((moved(time) - moved(np.asarray(time) - length)) / length)

    return Shape(response, lag + length / 6.0)


def stopped(rng: np.random.Generator) -> Made:
    level, shape = math.exp(rng.uniform(math.log(0.0006), math.log(0.02))), stopping(rng)
    rate = math.exp(rng.uniform(math.log(8.0), math.log(80.0))) / shape.truths()["rise_time"]
    hold = 300.0 / rate
    return step(
        rng, shape, lambda n: rng.normal(0.0, level, n), rate=rate, hold=hold, before=0.25 * hold
    )


def delayed_in_few(rng: np.random.Generator) -> Made:
    """Three to eight samples a rise, and a corner at its start."""
    level, shape = math.exp(rng.uniform(math.log(0.001), math.log(0.02))), lagging(rng)
    rate = rng.uniform(3.0, 8.0) / shape.truths()["rise_time"]
    return step(
        rng,
        shape,
        lambda n: rng.normal(0.0, level, n),
        rate=rate,
        hold=120.0 / rate,
        before=40.0 / rate,
    )


def no_peak(rng: np.random.Generator) -> Made:
    level = rng.uniform(0.003, 0.02)
    return step(rng, first_order(rng), lambda n: level * student(rng, n))


def one_over_f(rng: np.random.Generator, count: int) -> FloatArray:
    """Noise of 1 / f down to a quarter over its length, about 1 in standard deviation, (count,)."""
    size = 4 * count
    amplitude = np.fft.rfftfreq(size)
    amplitude[1:] **= -0.5
    amplitude *= size / (2.0 * math.sqrt(float(np.sum(amplitude**2))))
    drawn = rng.normal(size=(2, amplitude.size))
    return np.fft.irfft(amplitude * (drawn[0] + 1j * drawn[1]), size)[:count]


def flickering(rng: np.random.Generator) -> Made:
    level = rng.uniform(0.003, 0.02)
    return step(rng, underdamped(rng), lambda n: level * one_over_f(rng, n))


def delayed_silent(rng: np.random.Generator) -> Made:
    return step(rng, lagging(rng), np.zeros)


def uneven(rng: np.random.Generator) -> Made:
    """Samples up to 0.4 periods beside their ticks, with their own stamps."""
    level, shape = rng.uniform(0.001, 0.02), underdamped(rng)
    made, asked, truths, size = step(rng, shape, np.zeros)
    ticks = made.time - 0.15 + rng.uniform(-4e-4, 4e-4, len(made))
    ticks[0] = -0.15
    edge = asked.signal.edges[0]
    whole = edge.after - edge.before - truths["steady_state_error"]
    values = shape.response(np.maximum(ticks, 0.0)) + level * rng.normal(size=ticks.size)
    channels = {
        CHANNEL: edge.before + whole * values,
        "reference": np.where(ticks >= 0.0, edge.after, edge.before),
    }
    return replace(made, time=ticks - ticks[0], values=channels), asked, truths, size


def correlated(colour: float) -> Draw:
    def draw(rng: np.random.Generator) -> Made:
        level = rng.uniform(0.003, 0.02)
        return step(rng, underdamped(rng), lambda n: level * autoregressive(rng, n, colour))

    return draw


def filtered(numerator: FloatArray, denominator: FloatArray) -> Draw:
    """A sensor whose noise has been through a filter."""

    def noise(rng: np.random.Generator, count: int) -> FloatArray:
        found = np.asarray(lfilter(numerator, denominator, rng.normal(size=count + 300)))[300:]
        # by the filter's own gain, not by what happened
        impulse = lfilter(numerator, denominator, np.eye(1, 3000)[0])
        return np.asarray(found / math.sqrt(float(impulse @ impulse)))

    def draw(rng: np.random.Generator) -> Made:
        level = rng.uniform(0.003, 0.02)
        return step(rng, underdamped(rng), lambda n: level * noise(rng, n))

    return draw


def at_10_khz(rng: np.random.Generator) -> Made:
    level = rng.uniform(0.003, 0.02)
    return step(rng, first_order(rng), lambda n: rng.normal(0.0, level, n), rate=1e4, hold=0.3)


def heavy_tails(rng: np.random.Generator) -> Made:
    level = rng.uniform(0.003, 0.02)
    return step(rng, underdamped(rng), lambda n: level * student(rng, n))


def with_spikes(rng: np.random.Generator) -> Made:
    level = rng.uniform(0.001, 0.005)
    return step(rng, underdamped(rng), lambda n: rng.normal(0.0, level, n) + spikes(rng, n))


def with_losses(rng: np.random.Generator) -> Made:
    level = rng.uniform(0.001, 0.01)
    made, *rest = step(rng, underdamped(rng), lambda n: rng.normal(0.0, level, n))
    kept = rng.random(len(made)) >= 0.05
    kept[0] = True
    values = {name: array[kept] for name, array in made.values.items()}
    return replace(made, time=made.time[kept], values=values), *rest


def late_nan(rng: np.random.Generator) -> Made:
    made, *rest = step(rng, underdamped(rng), lambda n: rng.normal(0.0, 0.003, n))
    values = np.array(made[CHANNEL])
    values[rng.integers(500, 740)] = math.nan
    return made.with_values({CHANNEL: values}), *rest


# --- sines -------------------------------------------------------------------------------------


def short_sine(settled: int, colour: float) -> Draw:
    def draw(rng: np.random.Generator) -> Made:
        frequency, amplitude = rng.uniform(2.0, 20.0), rng.uniform(1e6, 3e7)
        ratio, lag = rng.uniform(0.5, 1.2), rng.uniform(0.0, 2.0)
        signal = Sine(Tone(0.0, (settled + 2) / frequency, frequency, amplitude))
        ticks = np.arange(round(signal.duration * 1000.0)) / 1000.0
        values = ratio * amplitude * np.sin(2 * np.pi * frequency * ticks - lag)
        values += amplitude * np.exp(-ticks * frequency * 5.0)
        values += amplitude * rng.uniform(0.01, 0.1) * autoregressive(rng, ticks.size, colour)
        made = recorded(ticks, values, signal), trial(signal, signal.duration, 0.0)
        return *made, {"amplitude_ratio": ratio, "phase_lag": lag}, amplitude

    return draw


def settling_offset(rng: np.random.Generator) -> Made:
    """Two settled periods on an offset that decays over one to four periods."""
    frequency, amplitude = rng.uniform(2.0, 20.0), rng.uniform(1e6, 3e7)
    ratio, lag = rng.uniform(0.5, 1.2), rng.uniform(0.0, 2.0)
    signal = Sine(Tone(0.0, 4.0 / frequency, frequency, amplitude))
    ticks = np.arange(math.ceil(signal.duration * 1000.0)) / 1000.0
    values = ratio * amplitude * np.sin(2 * np.pi * frequency * ticks - lag)
    offset, decay = rng.uniform(0.1, 1.0), rng.uniform(1.0, 4.0) / frequency
    values += offset * amplitude * np.exp(-ticks / decay)
    values += amplitude * 0.01 * rng.normal(size=ticks.size)
    made = recorded(ticks, values, signal), trial(signal, signal.duration, 0.0)
    return *made, {"amplitude_ratio": ratio, "phase_lag": lag}, amplitude


# --- frequency responses -----------------------------------------------------------------------


@dataclass(frozen=True)
class Linear:
    """1 / (s^2 / w^2 + 2 d s / w + 1) with w = 2 pi natural; first order where d is NaN."""

    natural: float
    damping: float = math.nan

    def at(self, frequency: FloatArray) -> ComplexArray:
        s = 1j * np.asarray(frequency) / self.natural
        if math.isnan(self.damping):
            return np.asarray(1.0 / (s + 1.0))
        return np.asarray(1.0 / (s * s + 2.0 * self.damping * s + 1.0))

    def simulated(self, values: FloatArray, rate: float) -> FloatArray:
        """The response to samples that are joined by straight lines, exact at the samples."""
        turn = 2.0 * math.pi * self.natural
        if math.isnan(self.damping):
            num, den = [turn], [1.0, turn]
        else:
            num, den = [turn**2], [1.0, 2.0 * self.damping * turn, turn**2]
        b, a, _ = cont2discrete((num, den), 1.0 / rate, method="foh")
        return np.asarray(lfilter(np.ravel(b), a, values))

    def answer(self, signal: Signal, seconds: float) -> tuple[FloatArray, FloatArray]:
        """The response to a signal at 1 kHz, simulated ten times as finely: times, values."""
        fine = np.arange(round(seconds * 1000.0) * 10) / 10_000.0
        return fine[::10], self.simulated(signal(fine), 10_000.0)[::10]

    def truths(self) -> dict[str, float]:
        if math.isnan(self.damping):
            return {"bandwidth_3db": self.natural, "resonance_peak": 1.0}
        a = 1.0 - 2.0 * self.damping**2
        peak = 1.0
        if a > 0.0:
            peak = 1.0 / (2.0 * self.damping * math.sqrt(1.0 - self.damping**2))
        return {
            "bandwidth_3db": self.natural * math.sqrt(a + math.sqrt(a * a + 1.0)),
            "bandwidth_90deg": self.natural,
            "resonance_peak": peak,
        }


def sweep(length: float, first: float, last: float, spacing: str = "logarithmic") -> Chirp:
    """A sweep of amplitude 1, as a suite has it."""
    given = {"kind": "chirp", "amplitude": 1.0, "f_start": first, "f_stop": last}
    return Chirp.model_validate({**given, "duration": length, "spacing": spacing})


def chirp(length: float, second: bool) -> Draw:
    """0.5 to 40 Hz, in 0.5 to 5 % of noise; corners of 4 to 15 Hz."""

    def draw(rng: np.random.Generator) -> Made:
        damping = rng.uniform(0.4, 0.9) if second else math.nan
        system = Linear(rng.uniform(4.0, 15.0), damping)
        signal = sweep(length, 0.5, 40.0)
        ticks, values = system.answer(signal, length)
        values = values + rng.uniform(0.005, 0.05) * rng.normal(size=ticks.size)
        made = recorded(ticks, values, signal), trial(signal, signal.duration, 0.0)
        return *made, system.truths(), 1.0

    return draw


def beyond_the_end(rng: np.random.Generator) -> Made:
    """A sweep far beyond the corner into the noise, half of them cut off early."""
    system = Linear(rng.uniform(0.5, 4.0))
    length = rng.uniform(10.0, 30.0)
    spacing = str(rng.choice(["linear", "logarithmic"]))
    signal = sweep(length, rng.uniform(0.05, 0.2), rng.uniform(50.0, 450.0), spacing)
    ended = length * (rng.uniform(0.3, 1.0) if rng.random() < 0.5 else 1.0)
    ticks, values = system.answer(signal, ended)
    level = math.exp(rng.uniform(math.log(1e-5), math.log(0.1)))
    values = values + level * rng.normal(size=ticks.size)
    made = recorded(ticks, values, signal), trial(signal, signal.duration, 0.0)
    return *made, {"resonance_peak": 1.0}, 1.0


def stepped_sine(noise: tuple[float, float], damping: tuple[float, float]) -> Draw:
    """Twelve to twenty frequencies from 1 to 30 Hz, eight periods and 1 s each at least."""

    def draw(rng: np.random.Generator) -> Made:
        system = Linear(rng.uniform(4.0, 15.0), rng.uniform(*damping))
        count = int(rng.integers(12, 21))
        frequencies = {"first": 1.0, "last": 30.0, "count": count}
        given = {"kind": "stepped_sine", "amplitude": 1.0, "frequencies": frequencies, "dwell": 1.0}
        signal = SteppedSine.model_validate(given)
        ticks, values = system.answer(signal, signal.duration)
        level = math.exp(rng.uniform(*np.log(noise)))
        values = values + level * rng.normal(size=values.size)
        made = recorded(ticks, values, signal), trial(signal, signal.duration, 0.0)
        return *made, system.truths(), 1.0

    return draw


TIMES = ("rise_time", "response_time", "delay_time")
BAND = ("bandwidth_3db", "bandwidth_90deg", "resonance_peak")
AT_LEAST = (0.93, 1.0)
PEAKS = ("overshoot", "peak_time", "settling_time")
CASES = (
    Case("LSB 1 %", quantised, (*TIMES, "settling_time", "steady_state_error"), AT_LEAST),
    Case("LSB 0.3-3 %", quantised_coarsely, (*TIMES, "steady_state_error"), AT_LEAST),
    Case("1-2 a rise 0.5 %", few_samples(0.005, 1.0, 2.0), PEAKS, AT_LEAST),
    Case("2-3 a rise 0.3 %", few_samples(0.003), (*TIMES, *PEAKS), AT_LEAST),
    Case("2-3 a rise, silent", few_samples(0.0), TIMES, AT_LEAST),
    # of few samples a rise nobody knows whether the response begins with a corner
    Case("4-8 a rise, rise", few_samples(0.005, 4.0, 8.0), ("rise_time",), AT_LEAST),
    Case("4-8 a rise", few_samples(0.005, 4.0, 8.0), ("response_time", "delay_time")),
    Case("3-8 a rise, corner", delayed_in_few, ("dead_time", *TIMES), AT_LEAST),
    Case("silent", silent, (*TIMES, "overshoot", "settling_time", "peak_time"), AT_LEAST),
    Case("first order 1-3 %", flat_start, ("undershoot", "overshoot"), AT_LEAST),
    Case("wrong way", wrong_way, (*TIMES, "undershoot", "overshoot", "settling_time")),
    # nobody knows how sharp a corner is between two samples, nor when an edge came there
    Case("lag after dead time", delayed, ("dead_time", *TIMES, "undershoot"), AT_LEAST),
    Case("the same, silent", delayed_silent, ("dead_time", *TIMES), AT_LEAST),
    Case("uneven samples", uneven, (*TIMES, "overshoot", "settling_time"), AT_LEAST),
    Case("stops all at once", stopped, (*TIMES, "settling_time"), AT_LEAST),
    Case("AR -0.5", correlated(-0.5), (*TIMES, "overshoot"), AT_LEAST),
    Case("AR -0.9", correlated(-0.9), (*TIMES, "overshoot"), AT_LEAST),
    # levels and crossings share slow noise, and are taken as independent
    Case("AR 0.9, times", correlated(0.9), TIMES, AT_LEAST),
    Case("AR 0.97, times", correlated(0.97), TIMES, AT_LEAST),
    Case("AR 0.9", correlated(0.9), ("overshoot", "steady_state_error")),
    Case("AR 0.97", correlated(0.97), ("steady_state_error",)),
    Case("mean of five", filtered(np.ones(5), np.ones(1)), ("overshoot", "steady_state_error")),
    Case("Butterworth", filtered(*butter(2, 0.2)), ("overshoot", "steady_state_error")),
    Case("10 kHz", at_10_khz, (*TIMES, "settling_time")),
    Case("Student's t, 3", heavy_tails, (*TIMES, "overshoot", "settling_time")),
    Case("t, 3, no peak", no_peak, ("overshoot", "undershoot"), AT_LEAST),
    Case("1 / f", flickering, (*TIMES, "overshoot", "steady_state_error"), AT_LEAST),
    Case("0.5 % spikes", with_spikes, (*TIMES, "overshoot", "settling_time")),
    Case("5 % lost", with_losses, (*TIMES, "overshoot", "settling_time")),
    Case("a late NaN", late_nan, (*TIMES, "overshoot", "settling_time", "steady_state_error")),
    Case("4 periods AR 0.9", short_sine(4, 0.9), ("amplitude_ratio", "phase_lag")),
    Case("6 periods AR 0.9", short_sine(6, 0.9), ("amplitude_ratio", "phase_lag")),
    Case("decaying offset", settling_offset, ("amplitude_ratio", "phase_lag")),
    Case("chirp 10 s", chirp(10.0, False), ("bandwidth_3db",)),
    Case("chirp 10 s, 2nd", chirp(10.0, True), BAND),
    Case("chirp 30 s, 2nd", chirp(30.0, True), BAND),
    Case("stepped sine", stepped_sine((0.005, 0.02), (0.15, 0.3)), BAND),
    Case("stepped sine, low", stepped_sine((0.0002, 0.001), (0.15, 0.3)), BAND, AT_LEAST),
    Case("sweep's end", beyond_the_end, ("resonance_peak",), AT_LEAST, may_refuse=0.45),
)
