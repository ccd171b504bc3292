"""The median of few repeats: its interval holds the truth as often as it says."""

import numpy as np
import pytest
from scipy.stats import t

from eha_bench.core.score import Measure
from eha_bench.metrics.repeats import median, median_interval

DRAWS = {
    "normal": (lambda rng, n: rng.normal(5.0, 2.0, n), 5.0),
    "skewed": (lambda rng, n: np.exp(0.5 * rng.normal(size=n)), 1.0),
    "heavy tails": (lambda rng, n: rng.standard_t(3, n), 0.0),
}


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6, 7, 10, 15])
@pytest.mark.parametrize("kind", DRAWS)
def test_coverage(count, kind):
    draw, truth = DRAWS[kind]
    rng = np.random.default_rng(count)
    ends = np.array([median_interval(draw(rng, count)) for _ in range(1500)])
    held = np.mean((ends[:, 0] <= truth) & (truth <= ends[:, 1]))
    assert 0.925 <= held <= 0.98


def test_two_repeats_are_students():
    low, high = median_interval(np.array([1.0, 3.0]))
    # the mean of two with a standard deviation of sqrt(2)
    assert (high - low) / 2 == pytest.approx(t.ppf(0.975, 1))
    assert (high + low) / 2 == pytest.approx(2.0)


def test_six_repeats_reach_nearly_from_the_least_to_the_largest():
    # Hettmansperger and Sheather: between the extremes (96.9 %) and the next ones (78.1 %)
    low, high = median_interval(np.array([6.0, 1.0, 2.0, 5.0, 3.0, 4.0]))
    share = (0.96875 - 0.95) / (0.96875 - 0.78125)
    weight = 5 * share / (1 + 4 * share)
    assert low == pytest.approx(1.0 + weight)
    assert high == pytest.approx(6.0 - weight)


def test_an_outlier_does_not_move_the_interval_of_many():
    values = np.linspace(0.0, 1.0, 15)
    wild = values.copy()
    wild[-1] = 1e6
    assert median_interval(values) == median_interval(wild)


def test_repeats_that_are_the_same_keep_their_own_interval():
    same = Measure(2.0, 1.5, 2.5)
    assert median([same, same, same]) == Measure(2.0, 1.5, 2.5)
    assert median([same]) == Measure(2.0, 1.5, 2.5)
