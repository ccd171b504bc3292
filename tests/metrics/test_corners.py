"""Corners that no polynomial follows, few samples, and samples in the tails of the noise."""

import math

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.metrics.local import fit
from eha_bench.metrics.noise import Noise
from eha_bench.metrics.outliers import filled


def measured(kit, metric, response, noise, period=1e-3):
    """A metric of one step from 0 to 1; `response` is of s since the edge."""
    lead, count = 150, 750
    ticks = np.arange(-lead, count - lead) * period
    hold = (count - lead) * period
    recording, asked = kit.step(([1.0], [1.0, 1.0]), hold=hold, period=period, before=lead * period)
    channels = {
        "pressure_difference": response(np.maximum(ticks, 0.0)) + noise(count),
        "reference": (ticks > -1e-9).astype(float),
    }
    start = {"signal_start": repr(float(-ticks[0]))}
    made = Recording(ticks - ticks[0], channels, recording.units, metadata=start)
    return kit.measure(metric, made, asked)


def held(kit, metric, draw, runs=40):
    """The share of intervals that hold the truth; `draw` is of a generator."""
    rng = np.random.default_rng(8)
    inside = []
    for _ in range(runs):
        response, truth, noise = draw(rng)
        found = measured(kit, metric, response, noise)
        inside.append(found.low <= truth <= found.high)
    return float(np.mean(inside))


def test_a_stop_all_at_once_is_no_later_than_it_is(kit):
    def draw(rng):
        length, level = rng.uniform(0.02, 0.05), rng.uniform(0.001, 0.01)

        def noise(count):
            return level * rng.normal(size=count)

        return lambda t: np.minimum(t / length, 1.0), 0.95 * length, noise

    assert held(kit, "response_time", draw) >= 0.85


def test_a_corner_after_a_dead_time_is_no_undershoot(kit):
    def draw(rng):
        delay, lag, level = *rng.uniform(0.005, 0.03, 2), rng.uniform(0.002, 0.015)

        def noise(count):
            return level * rng.normal(size=count)

        return lambda t: -np.expm1(-np.maximum(t - delay, 0.0) / lag), 0.0, noise

    assert held(kit, "undershoot", draw) >= 0.85


def test_dead_time_of_few_samples_a_rise_is_held(kit):
    def draw(rng):
        delay, lag, level = *rng.uniform(0.0015, 0.0035, 2), rng.uniform(0.001, 0.01)

        def noise(count):
            return level * rng.normal(size=count)

        truth = delay + lag * math.log(1.0 / 0.95)
        return lambda t: -np.expm1(-np.maximum(t - delay, 0.0) / lag), truth, noise

    assert held(kit, "dead_time", draw) >= 0.85


def test_noise_with_heavy_tails_is_no_overshoot(kit):
    def draw(rng):
        lag, level = rng.uniform(0.005, 0.02), rng.uniform(0.003, 0.02)

        def noise(count):
            return level / math.sqrt(3.0) * rng.standard_t(3, count)

        return lambda t: -np.expm1(-t / lag), 0.0, noise

    assert held(kit, "overshoot", draw) >= 0.85


def test_one_sample_far_off_bends_a_polynomial_by_little():
    time = np.arange(21) * 1.0
    values = 0.1 * np.random.default_rng(1).normal(size=21)
    noise = Noise(np.array([0.01]), 100.0)
    clean = fit(time, values, 10.0, 10, 3)
    values[10] += 0.6  # six standard deviations
    plain = fit(time, values, 10.0, 10, 3)
    robust = plain.robust(time, values, noise)
    moved = abs(plain.value(10.0) - clean.value(10.0))
    assert abs(robust.value(10.0) - clean.value(10.0)) < 0.6 * moved


def test_a_polynomial_that_follows_nothing_stays_as_it_is():
    time = np.arange(21) * 1.0
    noise = Noise(np.array([1e-4]), 100.0)
    kink = fit(time, np.maximum(time - 10.0, 0.0), 10.0, 10, 3)
    assert not kink.follows(noise)
    assert kink.robust(time, np.maximum(time - 10.0, 0.0), noise) is kink


@pytest.mark.parametrize("place", [2, 5, 7])
def test_a_single_sample_is_filled_by_a_cubic(place):
    time = np.linspace(0.0, 1.0, 10)
    values = 1.0 + time - 3.0 * time**2 + 2.0 * time**3
    missing = np.zeros(10, dtype=bool)
    missing[place] = True
    lost = np.where(missing, np.nan, values)
    assert filled(lost, missing)[place] == pytest.approx(values[place], abs=1e-12)


def test_two_in_a_row_are_filled_by_a_straight_line():
    values = np.array([0.0, 1.0, np.nan, np.nan, 4.0, 5.0, 6.0])
    assert filled(values, np.isnan(values)) == pytest.approx(np.arange(7.0))


def plateau(height):
    """Up to 1 + height within 20 ms, there until 0.12 s, at 1 from 0.15 s on."""
    levels = [0.0, 1.0 + height, 1.0 + height, 1.0]
    return lambda time: np.interp(time, [0.0, 0.02, 0.12, 0.15], levels)


@pytest.mark.parametrize("level", [0.001, 0.01])
@pytest.mark.parametrize("height", [0.1, 0.2])
def test_a_plateau_may_have_its_peak_anywhere(kit, level, height):
    rng = np.random.default_rng(11)
    response = plateau(height)
    found = measured(kit, "peak_time", response, lambda n: level * rng.normal(size=n))
    assert found.low <= 0.035
    assert 0.105 <= found.high <= 0.15
