"""The mean of noise of many kinds is known as well as its estimate says."""

import numpy as np
import pytest
from scipy.signal import butter, lfilter
from scipy.stats import t as students

from eha_bench.metrics.noise import Noise, _low, estimate, white_noise

WINDOW, HOLD, LEAD = 120, 300, 300


def filtered(numerator, denominator):
    def draw(rng):
        white = rng.normal(size=HOLD + LEAD)
        return np.asarray(lfilter(numerator, denominator, white))[LEAD:]

    return draw


KINDS = {
    "white": filtered([1.0], [1.0]),
    "first order": filtered([1.0], [1.0, -0.5]),
    "alternating": filtered([1.0], [1.0, 0.7]),
    "mean of three": filtered(np.ones(3), [1.0]),
    "mean of five": filtered(np.ones(5), [1.0]),
    "Butterworth at a twentieth": filtered(*butter(2, 0.1)),
    "Butterworth at a seventh": filtered(*butter(2, 0.3)),
}


FEW = ("white", "mean of three")
"""Noise without and with a memory, in the fast tests."""


@pytest.mark.parametrize(
    "kind",
    [pytest.param(kind, marks=() if kind in FEW else pytest.mark.slow) for kind in KINDS],
)
def test_intervals_of_a_mean_hold_it(kind):
    rng = np.random.default_rng(7)
    held = []
    for _ in range(400):
        values = KINDS[kind](rng)
        noise = estimate([values])
        reach = students.ppf(0.975, noise.slow) * np.sqrt(noise.variance_of_mean(WINDOW))
        held.append(abs(float(values[-WINDOW:].mean())) <= reach)
    assert 0.915 <= np.mean(held) <= 0.985  # 95 %, three standard errors of 400


def test_power_at_low_frequency_counts_for_long_means_only():
    noise = Noise(np.array([1.0]), 100.0, low=4.0, band=0.02)
    assert noise.variance_of_mean(1) == pytest.approx(1.0, rel=0.03)
    assert noise.variance_of_mean(100) == pytest.approx(4.0 / 100.0)


def one_over_f(rng, count):
    """Noise of 1 / f down to a quarter over its length."""
    size = 4 * count
    amplitude = np.fft.rfftfreq(size)
    amplitude[1:] **= -0.5
    drawn = rng.normal(size=(2, amplitude.size))
    return np.fft.irfft(amplitude * (drawn[0] + 1j * drawn[1]), size)[:count]


def test_noise_of_one_over_f_moves_means_by_more_than_a_window_shows():
    rng = np.random.default_rng(3)
    held = []
    for _ in range(100):
        values = one_over_f(rng, 1500)
        noise = estimate([values[:250], values[-250:]])
        reach = students.ppf(0.975, noise.slow) * np.sqrt(noise.variance_of_mean(250))
        held.append(abs(float(values[-250:].mean())) <= reach)
    assert np.mean(held) >= 0.80  # about 65 % by an autoregression


@pytest.mark.parametrize("kind", ["white", "first order", "alternating"])
def test_other_noise_is_seldom_taken_for_one_over_f(kind):
    rng = np.random.default_rng(4)
    # that of 1 / f is correlated over the whole window
    taken = [estimate([KINDS[kind](rng)]).autocovariance.size == HOLD for _ in range(60)]
    assert np.mean(taken) <= 0.15


@pytest.mark.parametrize("period", [20, 70, 200, 210])
def test_a_long_series_has_the_noise_of_all_of_its_samples(period):
    """Only some of its differences are looked at, whatever its signal's period is."""
    rng = np.random.default_rng(period)
    steps = np.repeat([0.0, 100.0], period)
    values = np.resize(steps, 300_000) + rng.normal(0.0, 2.0, 300_000)
    apart = np.abs(np.diff(values, 3))
    expected = np.median(apart) / (0.6744897501960817 * np.sqrt(20.0))
    assert white_noise(values) == pytest.approx(expected, rel=0.02)


def test_power_at_low_frequency_is_looked_at_up_to_three_hundredths_of_the_rate():
    residual = np.random.default_rng(5).normal(size=2000)
    power, band, lines = _low([residual], np.array([0.0]), 1.0)
    assert lines == 60
    assert band == pytest.approx(0.03, rel=0.01)
    assert power == pytest.approx(1.0, abs=0.5)
    # of a few samples there are no lines to look at
    assert _low([residual[:12]], np.array([0.0]), 1.0)[2] == 0
