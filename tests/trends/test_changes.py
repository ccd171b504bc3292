"""Changes put into a history are found where they are, and none where there are none."""

import math

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from eha_bench.core.arrays import FloatArray
from eha_bench.trends.changes import course_of
from eha_bench.trends.noise import noise_of
from eha_bench.trends.tails import FURTHEST, chance_of_sum, reach
from eha_bench.trends.terms import Kind, Term, design, gains, pair_gains
from eha_bench.trends.trend import TrendState, judge


def noise(count: int, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).normal(size=count)


@pytest.mark.parametrize("kind", list(Kind))
def test_gains_are_those_of_least_squares(kind: Kind) -> None:
    values = noise(40)
    terms = [Term(12, Kind.STEP)]
    found = gains(values, design(terms, 40), kind, 40)
    pairs = pair_gains(values, design(terms, 40), kind, 40, 7)

    def squares(matrix: FloatArray) -> float:
        return float(
            np.sum((values - matrix @ np.linalg.lstsq(matrix, values, rcond=None)[0]) ** 2)
        )

    before = squares(design(terms, 40))
    for start in (8, 20, 30):
        after = squares(design([*terms, Term(start, kind)], 40))
        assert found[start] == pytest.approx(before - after, rel=1e-6)
        passing = Term(start, kind).column(40) - Term(start + 7, kind).column(40)
        after = squares(np.column_stack((design(terms, 40), passing)))
        if start + 7 <= 36:
            assert pairs[start] == pytest.approx(before - after, rel=1e-6)


def test_steps_are_found_where_they_are() -> None:
    values = 50.0 + noise(300)
    values[120:] += 4.0
    values[220:] -= 6.0
    found = course_of(values, alpha=1e-3).changes
    assert [change.kind for change in found] == [Kind.STEP, Kind.STEP]
    assert abs(found[0].start - 120) <= 2
    assert abs(found[1].start - 220) <= 2
    assert found[1].size == pytest.approx(-6.0, abs=1.0)


def test_a_passing_change_is_found() -> None:
    values = noise(200)
    values[90:105] += 3.0
    starts = [change.start for change in course_of(values, alpha=1e-3).changes]
    assert len(starts) == 2
    assert abs(starts[0] - 90) <= 2
    assert abs(starts[1] - 105) <= 2


def test_a_drift_is_found_where_it_begins_and_ends() -> None:
    values = 20.0 + noise(300, 2)
    values[150:] += 0.4 * np.minimum(np.arange(1, 151), 50)
    course = course_of(values, alpha=1e-3)
    assert [change.kind for change in course.changes] == [Kind.KINK, Kind.KINK]
    assert abs(course.changes[0].start - 150) <= 3
    assert abs(course.changes[1].start - 200) <= 3
    assert course.kink_word(course.changes[0]) == "drift begins"
    assert course.kink_word(course.changes[1]) == "drift ends"


def test_scale_and_offset_do_not_matter() -> None:
    values = noise(120)
    values[70:] += 3.0
    plain = [change.start for change in course_of(values, alpha=1e-3).changes]
    for factor, offset in ((1e-9, 0.0), (1e7, -3e9), (-1.0, 5.0)):
        other = course_of(factor * values + offset, alpha=1e-3)
        assert [change.start for change in other.changes] == plain


def test_exact_values_have_exact_changes() -> None:
    flat = course_of(np.full(50, 3.0), alpha=1e-3)
    assert flat.changes == ()
    values = np.where(np.arange(50) < 30, 3.0, 3.1)
    assert [change.start for change in course_of(values, alpha=1e-3).changes] == [30]


@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_few_nights_say_nothing(count: int) -> None:
    assert course_of(noise(count), alpha=1e-3).changes == ()
    if count:
        state = judge(noise(count), family=1, margin=0.0).state
        assert state is TrendState.TOO_FEW


def test_flat_histories_are_left_alone() -> None:
    rng = np.random.default_rng(8)
    false = 0
    for _ in range(60):
        judged = judge(rng.normal(size=100), family=5, margin=0.0)
        false += bool(judged.course.changes) or judged.state.drifted
    assert false <= 1


def test_rare_counts_make_no_change() -> None:
    rng = np.random.default_rng(4)
    false = sum(
        bool(course_of((rng.random(300) < 0.1).astype(float), alpha=5e-4).changes)
        for _ in range(20)
    )
    assert false <= 1


def test_the_newest_night_is_held_against_those_before() -> None:
    values = 10.0 + 0.1 * noise(60)
    judged = judge(values, family=10, margin=0.05)
    assert (judged.state, judged.drift) == (TrendState.STEADY, 0.0)
    assert judged.limits[0] < values[-1] < judged.limits[1]
    wild = values.copy()
    wild[-1] = 11.5  # a blunder may be that far out: the next night tells
    assert judge(wild, family=10, margin=0.05).state is TrendState.ONE_NIGHT_OUT
    assert judge(np.append(wild, 11.4), family=10, margin=0.05).state is TrendState.STEPPED
    assert judge(wild, family=10, margin=2.0).state is TrendState.STEADY
    wild[-1] = 14.0
    assert judge(wild, family=10, margin=0.05).state is TrendState.OUT_OF_LIMITS
    stepped = values.copy()
    stepped[-5:] += 1.0
    assert judge(stepped, family=10, margin=0.05).state.drifted
    old = values.copy()
    old[-30:] += 1.0
    assert judge(old, family=10, margin=0.05).state is TrendState.STEADY
    drifting = values.copy()
    drifting[-25:] += 0.05 * np.arange(1, 26)
    assert judge(drifting, family=10, margin=0.05).state is TrendState.DRIFTING
    assert judge(values, family=10, margin=0.05, missing=(1, 0)).state is TrendState.NOT_SCORED


def test_a_change_says_between_which_nights_it_began() -> None:
    rng = np.random.default_rng(12)
    inside = 0
    for _ in range(60):
        values = rng.normal(size=200)
        values[120:] += 0.15 * np.arange(1, 81)  # too slow to be placed to the night
        change = min(course_of(values, alpha=1e-3).changes, key=lambda c: abs(c.start - 120))
        assert change.earliest <= change.start <= change.latest
        inside += change.earliest <= 120 <= change.latest
    assert inside >= 51  # 57 of 60 are meant; fewer than 51 by chance once in 500
    (step,) = course_of(np.where(np.arange(50) < 30, 3.0, 9.0), alpha=1e-3).changes
    assert (step.earliest, step.latest) == (30, 30)


@pytest.mark.slow
@pytest.mark.parametrize("noise_of_a_night", ["t5", "log-normal", "alike"])
def test_wild_skewed_and_correlated_nights_make_no_change(noise_of_a_night: str) -> None:
    rng = np.random.default_rng(3)
    false = 0
    for _ in range(150):
        if noise_of_a_night == "t5":
            values = rng.standard_t(5, 365)
        elif noise_of_a_night == "log-normal":
            values = rng.lognormal(0.0, 0.7, 365)
        else:
            values = lfilter([1.0], [1.0, -0.5], rng.normal(size=465))[100:]
        judged = judge(values, family=1, margin=0.0)
        false += bool(judged.course.changes) or judged.state.drifted
    assert false <= 6  # 2 % of 150 are 3; more than 6 by chance once in 30 at 2 %


def test_correlation_of_neighbours_is_seen_and_steps_are_not_taken_for_it() -> None:
    rng = np.random.default_rng(6)
    alike = lfilter([1.0], [1.0, -0.6], rng.normal(size=1100))[100:]
    assert noise_of(alike).widening == pytest.approx(2.0, rel=0.2)  # sqrt(1.6 / 0.4)
    values = rng.normal(size=1000)
    values[300:] += 6.0
    values[700:] -= 9.0
    found = noise_of(values)
    assert found.widening < 1.2
    assert found.sigma == pytest.approx(1.0, rel=0.1)


def test_a_sum_of_normal_noise_has_the_normal_distributions_tail() -> None:
    quantiles = stats.norm.ppf((np.arange(4000) + 0.5) / 4000.0)
    noise = np.clip(quantiles, -FURTHEST, FURTHEST)
    weights = np.concatenate((np.full(150, 1.0), np.full(250, -0.6)))
    error = noise.std() * math.sqrt(float(weights @ weights))
    for sigmas in (1.0, 3.0, 5.0):
        found = chance_of_sum(weights, -sigmas * error, noise)
        assert found == pytest.approx(stats.norm.sf(sigmas), rel=0.15)


def test_a_sum_of_counts_has_the_binomial_tail() -> None:
    ones = 2.0 * (np.arange(2000) % 10 == 0)  # every tenth
    weights = np.concatenate((np.ones(12), np.zeros(48)))
    exact = stats.binom.sf(5, 12, 0.1)  # six or more of twelve
    total = 2.0 * (6.0 - 1.2)
    assert exact / 3.0 <= chance_of_sum(weights, total, ones - 0.2) <= 3.0 * exact
    assert chance_of_sum(weights, 30.0, ones - 0.2) < 1e-30  # further than all can be


def test_the_reach_of_a_night_is_longer_where_nights_are_wild_or_few() -> None:
    rng = np.random.default_rng(7)
    below, above = reach(rng.normal(size=1000), 1e-4)
    assert below == pytest.approx(3.7, rel=0.3)  # of a normal distribution
    assert above == pytest.approx(3.7, rel=0.3)
    heavy = reach(rng.standard_t(3, 1000), 1e-4)
    assert min(heavy) > 2.5 * 3.7  # 22.2 of the distribution itself
    skewed = reach(rng.exponential(size=1000) - 1.0, 1e-4)
    assert skewed[1] > 2.0 * skewed[0]
    assert max(reach(rng.normal(size=20), 1e-4)) > 1.5 * below
    assert reach(np.zeros(10), 1e-4) == (0.0, 0.0)
