"""Nights left: known answers, and intervals that hold as often as they say."""

import math

import numpy as np

from eha_bench.causes.forecast import ahead_of, pace_of
from eha_bench.trends.wear import LimitCrossing


def crossing(value: float, deviation: float = 0.0) -> LimitCrossing:
    drawn = value + deviation * np.random.default_rng(7).standard_normal(4000)
    return LimitCrossing(value, drawn, "step", "response_time", "<= 60 ms")


def test_a_line_without_noise_is_drawn_on() -> None:
    times = np.arange(8.0)
    pace = pace_of(times, 1.0 + 0.5 * times, np.full(8, 1e-9))
    assert pace is not None
    assert pace.goes_on
    assert math.isclose(pace.slope, 0.5, rel_tol=1e-6)
    left = ahead_of(pace, crossing(10.0)).left
    assert math.isclose(left.value, (10.0 - 4.5) / 0.5, rel_tol=1e-6)
    assert left.high - left.low < 1e-3


def test_missing_nights_count() -> None:
    times = np.array([0.0, 1.0, 2.0, 5.0, 6.0, 7.0])
    pace = pace_of(times, 2.0 * times, np.full(6, 1e-9))
    assert pace is not None
    assert math.isclose(ahead_of(pace, crossing(20.0)).left.value, 3.0, rel_tol=1e-6)


def test_three_nights_are_no_line() -> None:
    assert pace_of(np.arange(3.0), np.arange(3.0), np.ones(3)) is None


def test_what_falls_reaches_a_lower_limit() -> None:
    times = np.arange(8.0)
    pace = pace_of(times, 10.0 - times, np.full(8, 1e-9))
    assert pace is not None
    assert math.isclose(ahead_of(pace, crossing(0.0)).left.value, 3.0, rel_tol=1e-6)


def test_a_limit_that_is_passed_has_nothing_left() -> None:
    times = np.arange(8.0)
    pace = pace_of(times, times, np.full(8, 1e-9))
    assert pace is not None
    found = ahead_of(pace, crossing(3.0))
    assert found.left.value < 0.0
    assert all(chance == 0.0 for _, chance in found.chances)


def test_a_limit_that_is_met_or_just_missed_leaves_both_in_the_interval() -> None:
    times = np.arange(8.0)
    pace = pace_of(times, times, np.full(8, 1e-9))
    assert pace is not None
    places = np.resize([12.0, 30.0, 30.0, 30.0], 4000)
    left = ahead_of(pace, LimitCrossing(30.0, places, "step", "response_time", "<= 60 ms"))
    assert math.isclose(left.left.value, 23.0, rel_tol=1e-6)
    assert np.allclose((left.left.low, left.left.high), (5.0, 23.0))
    assert dict(left.chances)[10] == 0.75


def test_the_interval_holds_and_a_wild_night_hardly_moves_it() -> None:
    held, total = 0, 150
    for seed in range(total):
        rng = np.random.default_rng(seed)
        times = np.arange(10.0)
        values = 0.3 * times + rng.normal(0.0, 0.2, 10)
        pace = pace_of(times, values, np.full(10, 0.2))
        assert pace is not None
        place = 9.0 + 0.1 * rng.normal()
        left = ahead_of(pace, crossing(place, 0.1)).left
        held += left.low <= 30.0 - 9.0 <= left.high
    assert 0.89 <= held / total <= 0.99
    wild = 0.3 * times
    wild[4] += 5.0
    pace = pace_of(times, wild, np.full(10, 0.01))
    assert pace is not None
    assert math.isclose(pace.slope, 0.3, rel_tol=0.1)
