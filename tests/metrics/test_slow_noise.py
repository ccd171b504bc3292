"""The level of a window in slow noise is known as well as it says, whatever noise it is."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import t as students

from eha_bench.metrics.coverage import reach
from eha_bench.metrics.levels import level
from eha_bench.metrics.noise import detrended
from eha_bench.metrics.slow_noise import SlowNoise, _expected_periodogram, slow_noise
from eha_bench.metrics.step_response import held_noise

HOLD = 600


def slow(rng, count, correlation):
    lead = 1000
    white = rng.normal(size=count + lead)
    return lfilter([np.sqrt(1.0 - correlation**2)], [1.0, -correlation], white)[lead:]


def flickering(rng, count):
    size = 4 * count
    amplitude = np.fft.rfftfreq(size)
    amplitude[1:] **= -0.5
    drawn = rng.normal(size=(2, amplitude.size))
    return np.fft.irfft(amplitude * (drawn[0] + 1j * drawn[1]), size)[:count]


KINDS = {
    "correlation 0.9": lambda rng, count: slow(rng, count, 0.9),
    "correlation 0.97": lambda rng, count: slow(rng, count, 0.97),
    "1 / f": flickering,
    "both": lambda rng, count: slow(rng, count, 0.97) + rng.normal(size=count),
}


def held_share(kind, count, seed):
    """Return how often the interval of the level of the last fifth of a hold holds it."""
    rng = np.random.default_rng(seed)
    held = 0
    for _ in range(count):
        values = KINDS[kind](rng, HOLD + HOLD // 4)
        before, hold = values[: HOLD // 4], values[HOLD // 4 :]
        last = hold[-HOLD // 5 :]
        found = level(last, held_noise(hold, [last], [], [before]))
        held += abs(found.value) <= reach(found.budget(0.0, 0.0))
    return held / count


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_intervals_of_a_level_in_slow_noise_hold_it(kind):
    # 95 %, three standard errors of 400: 90.4 and 92.4 % where the estimate alone was believed
    assert 0.915 <= held_share(kind, 400, 5) <= 0.985


def test_a_window_of_two_independent_samples_has_few_degrees_of_freedom():
    rng = np.random.default_rng(1)
    values = slow(rng, 300, 0.97)
    found = slow_noise([detrended(values)], np.array([0.9]))
    variance, freedom = found.of_mean(120)
    # (1 + r) / (1 - r) / 120 = 0.5 for r = 0.97, which is known only roughly
    assert 0.02 < variance < 5.0
    assert freedom < 6.0


def test_fast_noise_is_left_as_it_is():
    rng = np.random.default_rng(2)
    assert slow_noise([rng.normal(size=300)], np.zeros(0)) is None


def test_a_mixture_of_one_is_students_distribution():
    alone = SlowNoise(np.array([[2.0, 1.0]]), np.ones(1), 7.0, decays=True)
    variance, freedom = alone.of_mean(4)
    assert variance == pytest.approx((4 * 2.0 + 2 * 3 * 1.0) / 16.0, rel=0.02)
    assert freedom == pytest.approx(7.0, rel=0.05)


def test_a_mixture_reaches_as_far_as_its_own_draws():
    rng = np.random.default_rng(3)
    both = SlowNoise(np.array([[1.0], [25.0]]), np.array([0.8, 0.2]), 40.0, decays=True)
    variance, freedom = both.of_mean(1)
    sizes = np.where(rng.random(200_000) < 0.8, 1.0, 5.0) * rng.standard_t(40.0, 200_000)
    drawn = np.quantile(np.abs(sizes), 0.95)
    assert np.sqrt(variance) * students.ppf(0.975, freedom) == pytest.approx(drawn, rel=0.03)


@pytest.mark.parametrize("count", [40, 41])
def test_a_periodogram_is_expected_to_be_what_simulation_makes_it(count):
    rng = np.random.default_rng(4)
    made = np.array([detrended(slow(rng, count, 0.9)) for _ in range(4000)])
    lines = slice(1, (count - 1) // 2 + 1)
    mean = np.mean(np.abs(np.fft.rfft(made)[:, lines]) ** 2, axis=0) / count
    found = _expected_periodogram(0.9 ** np.arange(count)[None, :], count)[0]
    assert found == pytest.approx(mean, rel=0.12)


def test_of_a_long_window_means_over_blocks_say_the_same():
    rng = np.random.default_rng(6)
    values = slow(rng, 5000, 0.97)
    plain = held_noise(values[1000:], [values[-800:]], [values[:1000]])
    assert plain.means.block == 5
    variance, freedom = plain.of_mean(800)
    expected = (1.0 + 0.97) / (1.0 - 0.97) / 800.0
    assert 0.4 * expected < variance < 2.5 * expected
    assert freedom > 5.0


@pytest.mark.parametrize("seed", range(5))
def test_a_tail_that_still_settles_after_a_quiet_rest_is_no_slow_noise(seed):
    """As intervals of a step's level two to six times too wide would be."""
    rng = np.random.default_rng([7, seed])
    rest, noise = rng.normal(size=200), rng.normal(size=600)
    tail = 40.0 * np.exp(-np.arange(600) / 120.0)
    assert held_noise(tail + noise, [(tail + noise)[-120:]], [rest]).means is None
