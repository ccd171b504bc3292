"""The newest nights: found from the eighth night on, and left alone where nothing happened."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.signal import lfilter

from eha_bench.trends.newest import SPANS, newest_of, spread_of
from eha_bench.trends.swing import swing_of
from eha_bench.trends.trend import TrendState, cut_off, judge


def test_known_independent_scatter_gives_the_normal_test() -> None:
    # many nights with a known standard deviation: two of them at d have z = d / sqrt(1/2 + 1/n)
    rng = np.random.default_rng(1)
    nights = rng.normal(size=118)
    nights = (nights - nights.mean()) / nights.std()
    nights = np.append(nights, [1.6, 1.6])
    found = newest_of(nights, 1.0)
    z = 1.6 / math.sqrt(1.0 / 2.0 + 1.0 / 118.0)
    assert found.span == 2
    # correlated nights are thought of, so that it is somewhat more
    theirs = 2.0 * float(stats.norm.sf(z)) / SPANS[2]
    assert theirs < found.p_value < 2.5 * theirs


def test_one_wild_night_counts_as_little_more_than_its_neighbour() -> None:
    rng = np.random.default_rng(2)
    before = rng.normal(size=30)
    assert newest_of(np.append(before, [40.0, 0.3]), math.nan).p_value > 0.01
    assert newest_of(np.append(before, [40.0, -0.3]), math.nan).p_value == 1.0
    assert newest_of(np.append(before, [40.0, 39.0]), math.nan).p_value < 1e-6


def test_own_intervals_keep_nights_that_lie_close_by_chance_from_an_alarm() -> None:
    close = np.array([0.0, 0.01, -0.01, 0.02, 0.0, -0.02, 0.01, 0.3, 0.35])
    assert newest_of(close, math.nan).p_value < 0.005
    assert newest_of(close, 0.4).p_value > 0.1


@given(
    # what is next to nothing becomes nothing in another unit
    st.lists(st.floats(-1e3, 1e3).map(lambda value: round(value, 6)), min_size=7, max_size=40),
    st.floats(1e-3, 1e3),
)
def test_units_do_not_matter(values: list[float], factor: float) -> None:
    nights = np.array(values)
    one, other = newest_of(nights, math.nan), newest_of(factor * nights, math.nan)
    assert 0.0 <= one.p_value <= 1.0
    assert one.p_value == pytest.approx(other.p_value, rel=1e-6, abs=1e-9)


def test_an_outlier_does_not_widen_the_limits() -> None:
    rng = np.random.default_rng(3)
    values = 0.40 + 0.01 * rng.normal(size=12)
    limits = judge(values, family=1, margin=0.001).limits
    wild = values.copy()
    wild[4] = 0.95
    with_outlier = judge(wild, family=1, margin=0.001).limits
    width = limits[1] - limits[0]
    assert with_outlier[1] - with_outlier[0] < 3.0 * width
    assert with_outlier[0] > 0.3
    assert with_outlier[1] < 0.5
    quiet = np.random.default_rng(4).normal(size=30)
    quiet[10] = 60.0
    assert spread_of(quiet, math.nan) < 12.0
    nearly_equal = np.array([0.0, 0.0, 1.0, 1.0, 1e-172])
    assert spread_of(nearly_equal, math.nan) == pytest.approx(np.std(nearly_equal))


def test_a_step_is_found_by_the_second_night_after_it() -> None:
    rng = np.random.default_rng(5)
    found = 0
    for _ in range(40):
        values = rng.normal(100.0, 1.0, 32)
        values[30:] += 5.0
        judged = judge(values, family=1, margin=0.5, own=1.0)
        found += judged.state.drifted
        if judged.state is TrendState.STEPPED:
            assert judged.since in (28, 30)
    assert found >= 36


def _correlated(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return nights alike by 0.8: of eight of them two that stray are no news."""
    return np.asarray(lfilter([1.0], [1.0, -0.8], rng.normal(size=count + 60))[60:])


def test_eight_nights_that_are_alike_raise_hardly_an_alarm() -> None:
    """Of 300 one in a hundred is 3; at the level of thirty nights it would be about 9."""
    rng = np.random.default_rng(240)
    alarms = marks = 0
    for _ in range(300):
        judged = judge(100.0 + _correlated(rng, 8), family=1, margin=0.05)
        alarms += judged.state.drifted
        marks += judged.state is TrendState.SUSPECTED
    assert alarms <= 6
    assert marks >= 10  # what is no alarm is not hidden


def test_a_step_of_eight_nights_is_suspected_by_its_second() -> None:
    rng = np.random.default_rng(241)
    marked, steps = 0, 80
    for _ in range(steps):
        values = rng.normal(100.0, 1.0, 10)
        values[8:] += 3.0
        judged = judge(values, family=1, margin=0.05)
        marked += judged.state is TrendState.SUSPECTED or judged.state.drifted
    assert marked >= 0.7 * steps


def test_a_suspected_step_is_no_alarm_and_says_since_when() -> None:
    values = np.array([0.0, 1.0, -1.0, 0.5, -0.6, 0.3, -0.2, 0.7, 3.0, 2.8])
    judged = judge(values, family=1, margin=0.05)
    assert judged.state is TrendState.SUSPECTED
    assert not judged.state.drifted
    assert (judged.since, judged.shift) == (8, pytest.approx(2.7, abs=0.4))
    later = np.append(values, [3.1, 2.9, 3.3, 2.7, 3.2])
    assert judge(later, family=1, margin=0.05).state is TrendState.STEPPED
    assert cut_off(judged, "above").state is TrendState.CUT_OFF


def test_a_single_night_outside_has_to_be_borne_out() -> None:
    rng = np.random.default_rng(6)
    values = rng.normal(100.0, 1.0, 40)
    values[-1] = 105.0
    judged = judge(values, family=20, margin=0.5)
    assert judged.state is TrendState.ONE_NIGHT_OUT
    assert not judged.state.drifted
    again = judge(np.append(values, 105.2), family=20, margin=0.5)
    assert again.state is TrendState.STEPPED
    assert again.since == 39


@pytest.mark.parametrize(
    ("missing", "state"),
    [
        ((10, 0), TrendState.LOST),
        ((2, 0), TrendState.LOST),
        ((1, 0), TrendState.NOT_SCORED),
        ((2, 10), TrendState.NOT_SCORED),  # it often has no value
        ((40, 10), TrendState.LOST),
    ],
)
def test_a_metric_that_is_not_scored_any_more_has_drifted(
    missing: tuple[int, int], state: TrendState
) -> None:
    values = np.random.default_rng(7).normal(size=12)
    assert judge(values, family=50, margin=0.0, missing=missing).state is state


def test_a_season_that_comes_round_is_a_swing_and_a_drift_beside_it_one() -> None:
    rng = np.random.default_rng(8)
    night = np.arange(300)
    values = 50.0 + rng.normal(size=300) + 3.0 * np.sin(2.0 * math.pi * night / 90.0)
    judged = judge(values, family=1, margin=0.5)
    assert judged.swing is not None
    assert judged.swing.period == pytest.approx(90.0, rel=0.05)
    assert judged.swing.amplitude == pytest.approx(3.0, rel=0.15)
    assert judged.state is TrendState.STEADY
    worn = values.copy()
    worn[-50:] += 0.15 * np.arange(1, 51)
    assert judge(worn, family=1, margin=0.5).state.drifted


def test_steps_and_flat_series_are_no_swing() -> None:
    rng = np.random.default_rng(9)
    flat = rng.normal(size=200)
    assert swing_of(flat, 1.0) is None
    stepped = flat + np.where(np.arange(200) < 120, 0.0, 4.0)
    judged = judge(stepped, family=1, margin=0.5)
    assert judged.swing is None
    assert [change.start for change in judged.course.changes] == [120]
