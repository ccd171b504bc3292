"""Responses that set off all at once: a dead time and a lag behind it, in noise, with its truth."""

import math
from dataclasses import replace

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.metrics.noise import Noise
from eha_bench.metrics.onset import ComesToRest, SetsOff, corner
from eha_bench.metrics.outliers import spikes

PERIOD = 1e-3


def lagging(time, delay, lag):
    return -np.expm1(-np.maximum(time - delay, 0.0) / lag)


def made(kit, rng, delay, lag, noise, stamps=None):
    """A recording of one step to 1 whose stamps need not be even."""
    ticks = np.arange(-150, 600) * PERIOD if stamps is None else stamps
    recording, asked = kit.step(([1.0], [1.0, 1.0]), hold=0.6, period=PERIOD, before=0.15)
    values = lagging(ticks, delay, lag) + noise * rng.normal(size=ticks.size)
    channels = {"pressure_difference": values, "reference": (ticks > -1e-9).astype(float)}
    start = {"signal_start": repr(float(-ticks[0]))}
    return Recording(ticks - ticks[0], channels, recording.units, metadata=start), asked


def test_dead_time_of_a_kink_is_held_in_noise(kit):
    rng = np.random.default_rng(0)
    held = []
    for _ in range(60):
        lag, delay = rng.uniform(0.008, 0.03), rng.uniform(0.005, 0.03)
        found = kit.measure("dead_time", *made(kit, rng, delay, lag, rng.uniform(0.001, 0.01)))
        held.append(found.low <= delay + lag * math.log(1.0 / 0.95) <= found.high)
    assert np.mean(held) >= 0.85  # of 95 %; 48 % by polynomials across the kink


def test_dead_time_of_a_kink_without_noise_is_inside(kit):
    rng = np.random.default_rng(1)
    for delay in np.linspace(0.005, 0.006, 11):
        found = kit.measure("dead_time", *made(kit, rng, delay, 0.01, 0.0))
        assert found.low <= delay + 0.01 * math.log(1.0 / 0.95) <= found.high
        assert found.high - found.low < PERIOD


def test_a_smooth_start_is_left_to_the_local_cubic():
    time = np.arange(60) * PERIOD
    smooth = 0.5 * (time / time[-1]) ** 2
    noisy = smooth + 1e-3 * np.random.default_rng(2).normal(size=time.size)
    noise = Noise(np.array([1e-6]), 100.0)
    assert corner(time, noisy, noise, 0.03, SetsOff()) is None


def test_a_kink_has_its_crossing():
    time = np.arange(60) * PERIOD
    noise = Noise(np.array([1e-8]), 100.0)
    drawn = 1e-4 * np.random.default_rng(3).normal(size=time.size)
    values = lagging(time, 0.0203, 0.055) + drawn
    begun = corner(time, values, noise, 0.03, SetsOff())
    assert begun is not None
    found = begun.crossing(0.05)
    assert found is not None
    assert found.time == pytest.approx(0.0203 + 0.055 * math.log(1.0 / 0.95), abs=2e-5)


def stopping(time, length, lag):
    """As fast as it may for a time, then a stop; a lag rounds both ends."""

    def moved(since):
        after = np.maximum(since, 0.0)
        return after + lag * np.expm1(-after / lag)

    return (moved(time) - moved(time - length)) / length


@pytest.mark.parametrize("share", [0.95, 0.98])
def test_a_stop_has_its_crossing_seen_backwards(share):
    # x after the corner, 1 - r = lag / length exp(-x / lag), as long as the start is over
    length, lag = 0.04, 0.003
    time = np.arange(-70, -20)[::-1] * -PERIOD
    noise = Noise(np.array([1e-8]), 100.0)
    values = stopping(time, length, lag) + 1e-4 * np.random.default_rng(6).normal(size=time.size)
    stop = corner(-time[::-1], 1.0 - values[::-1], noise, -0.035, ComesToRest())
    assert stop is not None
    found = stop.crossing(1.0 - share)
    assert found is not None
    true = length + lag * math.log(lag / length / (1.0 - share))
    assert -found.time == pytest.approx(true, abs=4.0 * math.sqrt(found.variance) / found.slope)
    assert -found.time == pytest.approx(true, abs=1e-4)


def test_a_lag_alone_is_no_stop():
    time = np.arange(0, 60) * PERIOD
    noise = Noise(np.array([1e-6]), 100.0)
    values = lagging(time, -0.01, 0.015) + 1e-3 * np.random.default_rng(7).normal(size=time.size)
    stop = corner(-time[::-1], 1.0 - values[::-1], noise, -0.03, ComesToRest())
    assert stop is None or stop.crossing(0.05) is None


def test_times_of_a_sudden_stop_are_held_in_noise(kit):
    rng = np.random.default_rng(8)
    held = []
    for _ in range(40):
        length, lag = rng.uniform(0.02, 0.06), rng.uniform(0.001, 0.003)
        ticks = np.arange(-150, 600) * PERIOD
        recording, asked = made(kit, rng, 0.0, 1.0, 0.0)
        values = stopping(ticks, length, lag) + rng.uniform(0.001, 0.01) * rng.normal(size=750)
        moved = replace(recording, values={**recording.values, "pressure_difference": values})
        fine = np.arange(0, 100_000) * 1e-6
        for name, share in (("response_time", 0.95), ("settling_time", 0.98)):
            true = float(fine[int(np.argmax(stopping(fine, length, lag) >= share))])
            found = kit.measure(name, moved, asked)
            held.append(found.low <= true <= found.high)
    assert np.mean(held) >= 0.88  # of 95 %; 81 % by polynomials through the stop


def test_dead_time_of_few_samples_may_end_at_a_corner_that_they_do_not_show(kit):
    rng = np.random.default_rng(9)
    held = []
    for _ in range(60):
        lag, delay = rng.uniform(0.0014, 0.0036), rng.uniform(0.002, 0.006)  # 3 to 8 a rise
        found = kit.measure("dead_time", *made(kit, rng, delay, lag, rng.uniform(0.005, 0.02)))
        held.append(found.low <= delay + lag * math.log(1.0 / 0.95) <= found.high)
    assert np.mean(held) >= 0.9


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.7, 0.9])
def test_a_kink_between_two_samples_is_no_spike(share):
    time = np.arange(400) * PERIOD
    values = lagging(time, 0.1 + share * PERIOD, 0.008)
    values += 0.003 * np.random.default_rng(4).normal(size=time.size)
    assert spikes(time, values, 0.0).size == 0


@pytest.mark.parametrize("late", [False, True])
def test_an_edge_between_uneven_samples_is_known_as_well_as_they_tell(kit, late):
    # whether the command came when it was asked for, or with the first sample that shows it
    rng = np.random.default_rng(5)
    held = []
    for _ in range(30):
        ticks = (np.arange(-150, 600) + rng.uniform(-0.4, 0.4, 750)) * PERIOD
        ticks[0] = -0.15
        recording, asked = made(kit, rng, 0.02, 0.02, 0.002, ticks)
        came = float(ticks[ticks > -1e-9][0]) if late else 0.0
        values = lagging(ticks - came, 0.02, 0.02) + 0.002 * rng.normal(size=ticks.size)
        moved = replace(recording, values={**recording.values, "pressure_difference": values})
        found = kit.measure("delay_time", moved, asked)
        held.append(found.low <= 0.02 + 0.02 * math.log(2.0) <= found.high)
    assert np.mean(held) >= 0.85
