"""Frequency responses of a known second-order system, by every signal that can tell them."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import optimize
from scipy import signal as systems

from eha_bench.core.recording import Recording
from eha_bench.core.signal import Lines, Signal, Sweep, Tone
from eha_bench.metrics.bandwidth import Bandwidth3dB, ResonancePeak
from eha_bench.metrics.frequency_response import FrequencyResponse, frequency_response
from eha_bench.metrics.low_frequency import low_frequency_gain
from eha_bench.metrics.metric import NotScored
from eha_bench.metrics.response_point import ResponsePoint

NATURAL = 10.0  # Hz
RATE = 1000.0
OVER = 4  # the plant is simulated this much finer than it is sampled


@dataclass(frozen=True)
class Multisine(Signal):
    harmonics: tuple[int, ...] = tuple(range(1, 62, 2))
    period: float = 1.0
    periods: int = 4
    realisations: int = 4

    @property
    def duration(self):
        return self.period * self.periods * self.realisations

    def __call__(self, time):
        held = np.clip(np.asarray(time, dtype=np.float64), 0.0, self.duration - 1e-9)
        index = (held // (self.period * self.periods)).astype(int)
        turn = np.exp(2j * np.pi * held / self.period)
        values = np.zeros(held.size)
        for k in range(self.realisations):
            phases = np.random.default_rng(k).uniform(0, 2 * np.pi, len(self.harmonics))
            here = index == k
            for harmonic, phase in zip(self.harmonics, phases, strict=True):
                values[here] += (turn[here] ** harmonic * np.exp(1j * phase)).imag / 5.0
        return values

    @property
    def lines(self):
        length = self.period * self.periods
        return tuple(
            Lines(k * length, (k + 1) * length, self.period, self.harmonics)
            for k in range(self.realisations)
        )


@dataclass(frozen=True)
class Chirp(Signal):
    low: float = 0.5
    high: float = 60.0
    duration: float = 24.0

    def __call__(self, time):
        held = np.clip(np.asarray(time, dtype=np.float64), 0.0, self.duration)
        rate = math.log(self.high / self.low) / self.duration
        return np.sin(2 * np.pi * self.low * np.expm1(rate * held) / rate)

    @property
    def sweeps(self):
        return (Sweep(0.0, self.duration, self.low, self.high, "logarithmic"),)


def stepped(kit):
    frequencies = np.geomspace(1.0, 50.0, 16)
    tones, start = [], 0.0
    for frequency in frequencies.tolist():
        stop = start + max(8, math.ceil(frequency)) / frequency
        tones.append(Tone(start, stop, frequency, 1.0))
        start = stop
    return kit.Sines(tuple(tones))


_done = {}


def respond(kit, signal, damping=0.5, bend=None, settle=0.5):
    """Return `simulate(...)`, done once for each signal and damping."""
    key = (signal, damping)
    if bend is None and key in _done:
        return _done[key]
    done = simulate(kit, signal, damping, bend, settle)
    if bend is None:
        _done[key] = done
    return done


def simulate(kit, signal, damping, bend, settle):
    """Sample a second-order system (with a static nonlinearity `bend` behind it) under a signal."""
    count = round((signal.duration + settle) * RATE) * OVER
    time = np.arange(count) / (RATE * OVER)
    drive = signal(time - settle)
    drive[time < settle] = signal(np.zeros(1))[0]
    turn = 2 * np.pi * NATURAL
    model = ([turn**2], [1.0, 2 * damping * turn, turn**2])
    # between samples the drive is taken as straight; a filter does that a hundred times as fast
    # as `lsim`, which goes from sample to sample in Python
    above, below, _ = systems.cont2discrete(model, 1.0 / (RATE * OVER), method="foh")
    response = systems.lfilter(above.ravel(), below, drive - drive[0]) + drive[0]
    response = bend(response) if bend else response
    values = {kit.channel: response[::OVER], "reference": drive[::OVER]}
    recording = Recording(time[::OVER], values, metadata={"signal_start": repr(settle)})
    return recording, kit.trial(signal, signal.duration, RATE, settle)


def truth(damping):
    a = 1 - 2 * damping**2
    return NATURAL * math.sqrt(a + math.sqrt(a * a + 1)), NATURAL


def exact(frequency, damping):
    s = 1j * frequency / NATURAL
    return 1 / (s * s + 2 * damping * s + 1)


@pytest.fixture(scope="module")
def signals(kit):
    return {
        "stepped": stepped(kit),
        "multisine": Multisine(),
        "dense": Multisine(tuple(range(1, 80)), 2.0, 6, 1),
        "chirp": Chirp(),
    }


KINDS = ("stepped", "multisine", "dense", "chirp")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("damping", [0.3, 0.7])
def test_bandwidth_of_a_clean_system(kit, signals, kind, damping):
    recording, trial = respond(kit, signals[kind], damping)
    at_3db, at_90deg = truth(damping)
    found = kit.measure("bandwidth_3db", recording, trial)
    assert found.value == pytest.approx(at_3db, rel=1e-3), found.reason
    found = kit.measure("bandwidth_90deg", recording, trial)
    assert found.value == pytest.approx(at_90deg, rel=1e-3), found.reason


@pytest.mark.parametrize(
    ("damping", "ratio"), [(0.3, 1.45369), (0.5, 1.27202), (0.7, 1.01005), (0.9, 0.74606)]
)
def test_tabulated_bandwidths_of_second_order(kit, signals, damping, ratio):
    found = kit.measure("bandwidth_3db", *respond(kit, signals["multisine"], damping))
    assert found.value == pytest.approx(ratio * NATURAL, rel=0.005)


@pytest.mark.parametrize("kind", KINDS)
def test_every_point_is_right(kit, signals, kind):
    recording, trial = respond(kit, signals[kind])
    found = frequency_response(recording, trial, kit.channel)
    wanted = exact(found.frequency, 0.5)
    # a chirp's first band holds few lines of its spectrum
    first = 2 if kind == "chirp" else 0
    assert np.max(np.abs(found.response / wanted - 1)[first:]) < 0.01
    assert np.all(found.coherence > 0.99)
    assert found.phase[-1] < -2.5  # unwrapped or not, it lags


@pytest.mark.parametrize("kind", KINDS)
def test_intervals_hold_the_truth_under_noise(kit, signals, kind):
    recording, trial = respond(kit, signals[kind])
    wanted = dict(zip(("bandwidth_3db", "bandwidth_90deg"), truth(0.5), strict=True))
    inside = dict.fromkeys(wanted, 0)
    for seed in range(12):
        noisy = kit.noisy(recording, 0.02, seed)
        for name, value in wanted.items():
            found = kit.measure(name, noisy, trial)
            inside[name] += found.low <= value <= found.high
            assert found.value == pytest.approx(value, rel=0.2)
    assert min(inside.values()) >= 9, inside


def test_multisine_tells_noise_from_distortion(kit):
    odd = tuple(range(1, 42, 2))
    signal = Multisine(odd, 1.0, 6, 6)
    noise = 0.02

    def cubic(y):
        return y + 0.05 * y**3

    plain, trial = respond(kit, signal)
    bent, _ = respond(kit, signal, bend=cubic)
    straight = frequency_response(kit.noisy(plain, noise, 1), trial, kit.channel)
    crooked = frequency_response(kit.noisy(bent, noise, 1), trial, kit.channel)
    low = slice(2, 9)
    level = [np.median([p.distortion for p in item.points[low]]) for item in (straight, crooked)]
    noises = [np.median([p.noise for p in item.points[low]]) for item in (straight, crooked)]
    assert level[1] > 5 * level[0]
    assert noises[1] == pytest.approx(noises[0], rel=0.3)
    # variance of a ratio averaged over periods and realisations: 2 sigma^2 / (N |U|^2 / 2 ...)
    amplitude = 1 / 5.0
    expected = noise * math.sqrt(2.0) / amplitude * math.sqrt(2.0 / (RATE * 5 * 6))
    assert noises[0] == pytest.approx(expected, rel=0.2)


def test_one_realisation_knows_distortion_from_its_idle_lines(kit):
    signal = Multisine(tuple(range(1, 42, 2)), 1.0, 6, 1)
    plain, trial = respond(kit, signal)
    bent, _ = respond(kit, signal, bend=lambda y: y + 0.1 * y**2)
    levels = [
        np.median([p.distortion for p in frequency_response(r, trial, kit.channel).points])
        for r in (plain, bent)
    ]
    assert levels[1] > 100 * levels[0]
    assert levels[1] > 0.02


def test_points_lost_in_noise_are_left_out_and_said(kit, signals):
    recording, trial = respond(kit, signals["multisine"])
    noisy = kit.noisy(recording, 1.0, 3)
    found = frequency_response(noisy, trial, kit.channel)
    assert found.left_out
    assert all("coherence" in reason or "%" in reason for _, reason in found.left_out)
    assert max(point.frequency for point in found.points) < 61


def test_a_bandwidth_beyond_the_band_is_not_guessed(kit):
    signal = Multisine(tuple(range(1, 8)), 1.0, 3, 2)
    recording, trial = respond(kit, signal)
    for name in ("bandwidth_3db", "bandwidth_90deg"):
        found = kit.measure(name, recording, trial)
        assert math.isnan(found.value)
        assert "up to 7 Hz" in found.reason


def test_the_gain_at_low_frequency_must_be_known(kit, signals):
    recording, trial = respond(kit, signals["stepped"])
    values = np.array(recording[kit.channel])
    slow = recording.time < trial.signal.tones[5].start
    values[slow] = np.random.default_rng(0).normal(0, 1, np.count_nonzero(slow))
    found = kit.measure("bandwidth_3db", recording.with_values({kit.channel: values}), trial)
    assert math.isnan(found.value)
    assert "low frequency" in found.reason


def test_only_the_transient_period_is_not_enough(kit):
    signal = Multisine(periods=1, realisations=3)
    recording, trial = respond(kit, signal)
    found = kit.measure("bandwidth_3db", recording, trial)
    assert math.isnan(found.value)
    assert "settled period" in found.reason


@pytest.mark.parametrize("kind", KINDS)
def test_a_foreign_recording_is_aligned_by_its_reference(kit, signals, kind):
    recording, trial = respond(kit, signals[kind])
    foreign = replace(recording, time=recording.time + 3.2, metadata={})
    found = kit.measure("bandwidth_3db", foreign, trial)
    assert found.value == pytest.approx(truth(0.5)[0], rel=3e-3), found.reason


def test_a_period_of_no_whole_number_of_samples(kit):
    signal = Multisine(tuple(range(1, 30)), 0.98765, 5, 3)
    recording, trial = respond(kit, signal)
    found = kit.measure("bandwidth_3db", recording, trial)
    assert found.value == pytest.approx(truth(0.5)[0], rel=3e-3), found.reason


def test_the_resonance_is_found(kit, signals):
    recording, trial = respond(kit, signals["dense"], damping=0.2)
    peak = 1 / (2 * 0.2 * math.sqrt(1 - 0.2**2))
    found = kit.measure("resonance_peak", recording, trial)
    assert found.value == pytest.approx(peak, rel=0.01)


# --- intervals that hold what lies between the points ------------------------------------------


def second_order(frequency, natural, damping):
    s = 1j * np.asarray(frequency) / natural
    return 1.0 / (s * s + 2.0 * damping * s + 1.0)


def points(frequency, response, relative):
    return FrequencyResponse(
        tuple(
            ResponsePoint(float(f), complex(g), 2.0 * (relative * abs(g)) ** 2, 20.0, 1.0)
            for f, g in zip(frequency, response, strict=True)
        ),
        (),
        "stepped sine",
        "",
    )


@pytest.mark.parametrize("damping", [0.15, 0.3, 0.7])
@pytest.mark.parametrize("first", [0.5, 1.0, 2.0])
def test_the_gain_at_zero_is_found_from_a_rising_response(damping, first):
    frequency = np.geomspace(first, 30.0, 16)
    exact = second_order(frequency, 6.0, damping)
    level, budget = low_frequency_gain(points(frequency, exact, 1e-5))
    assert abs(level) < 3e-4
    assert abs(level) <= 2.5 * budget.standard
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(200):
        noise = 0.02 * rng.normal(size=16)
        level, budget = low_frequency_gain(points(frequency, exact * (1.0 + noise), 0.02))
        held += abs(level) <= 2.1 * budget.standard
    assert held >= (160 if first > 1.0 else 185)  # a third of the natural frequency is late


def test_a_plant_of_many_poles_is_priced_between_its_points():
    def plant(frequency):
        s = 1j * frequency / 5.0
        return 1.0 / ((s * s + 0.4 * s + 1.0) * (1.0 + 0.5 * s) * (s * s / 9.0 + 0.1 * s + 1.0))

    truth = optimize.brentq(lambda f: abs(plant(f)) - math.sqrt(0.5), 6.0, 10.0)
    for count in (14, 16, 20):
        frequency = np.geomspace(0.5, 30.0, count)
        found = Bandwidth3dB().of(points(frequency, plant(frequency), 1e-7))
        assert found.low <= truth <= found.high
        assert found.high - found.low < 0.2 * truth


def test_a_peak_at_the_end_of_the_band_is_none():
    frequency = np.geomspace(0.5, 30.0, 12)
    response = 1.0 / (1.0 + 1j * frequency / 4.0)
    response[-1] = 1644.0
    with pytest.raises(NotScored, match="the end of what can be relied upon"):
        ResonancePeak().of(points(frequency, response, 0.2))
    plain = ResonancePeak().of(points(frequency, 1.0 / (1.0 + 1j * frequency / 4.0), 0.01))
    assert plain.value == pytest.approx(1.0)
