"""Changes put into a history are found where they are, and none where there are none."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from eha_bench.trends.changes import course_of
from eha_bench.trends.tails import chance
from eha_bench.trends.terms import Kind, Term, design, gains, pair_gains
from eha_bench.trends.trend import State, judge


def noise(count: int, seed: int = 0) -> NDArray[np.float64]:
    return np.random.default_rng(seed).normal(size=count)


@pytest.mark.parametrize("kind", list(Kind))
def test_gains_are_those_of_least_squares(kind: Kind) -> None:
    values = noise(40)
    terms = [Term(12, Kind.STEP)]
    found = gains(values, terms, kind)
    pairs = pair_gains(values, terms, kind, 7)

    def squares(matrix: NDArray[np.float64]) -> float:
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
        *_, state = judge(noise(count), family=1, margin=0.0, scored=True)
        assert state is State.TOO_FEW


def test_flat_histories_are_left_alone() -> None:
    rng = np.random.default_rng(8)
    false = 0
    for _ in range(60):
        course, _, _, state = judge(rng.normal(size=100), family=5, margin=0.0, scored=True)
        false += bool(course.changes) or state.drifted
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
    _, limits, drift, state = judge(values, family=10, margin=0.05, scored=True)
    assert (state, drift) == (State.STEADY, 0.0)
    assert limits[0] < values[-1] < limits[1]
    wild = values.copy()
    wild[-1] = 11.5
    assert judge(wild, family=10, margin=0.05, scored=True)[3] is State.OUT_OF_LIMITS
    assert judge(wild, family=10, margin=2.0, scored=True)[3] is State.STEADY
    stepped = values.copy()
    stepped[-5:] += 1.0
    assert judge(stepped, family=10, margin=0.05, scored=True)[3].drifted
    old = values.copy()
    old[-30:] += 1.0
    assert judge(old, family=10, margin=0.05, scored=True)[3] is State.STEADY
    drifting = values.copy()
    drifting[-25:] += 0.05 * np.arange(1, 26)
    assert judge(drifting, family=10, margin=0.05, scored=True)[3] is State.DRIFTING
    assert judge(values, family=10, margin=0.05, scored=False)[3] is State.NOT_SCORED


def test_chance_is_a_bound_on_a_binomial_tail() -> None:
    residuals = np.array([1.0] * 10 + [0.0] * 90) - 0.1
    # 4 of 5 ones where every tenth is one: 5 * 0.1^4 * 0.9 + 0.1^5
    exact = 5 * 0.1**4 * 0.9 + 0.1**5
    assert exact <= chance(residuals, 5, 0.7) <= 5 * exact
    assert chance(residuals, 5, 0.0) == pytest.approx(1.0)
    assert math.isclose(chance(residuals, 1, 5.0), 0.0, abs_tol=1e-9)
