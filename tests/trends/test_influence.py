"""An influence that all nights share: as least squares with the full covariance have it."""

import math

import numpy as np
import pytest

from eha_bench.trends.influence import Influence
from eha_bench.trends.newest import newest_of
from eha_bench.trends.terms import Kind, Term, design, gains
from eha_bench.trends.trend import judge

NIGHTS = 30


def warmth(rng: np.random.Generator, nights: int = NIGHTS) -> np.ndarray:
    """Oil that is warm on the first eight nights and cold later, about its first mean, K."""
    warm = np.where(np.arange(nights) < 8, 0.0, -5.0) + rng.normal(0.0, 0.5, nights)
    return warm - warm[:8].mean()


def series(rng: np.random.Generator, warm: np.ndarray) -> tuple[np.ndarray, Influence]:
    """Return nights whose slope was learned on the first eight of them and taken out."""
    values = float(rng.normal()) * warm + rng.normal(size=warm.size)
    first = warm[:8]
    learned = float(first @ values[:8]) / (float(first @ first) + 1.0)
    return values - learned * warm, Influence(warm[:, None], np.array([-learned]))


def test_gains_are_those_of_the_full_covariance() -> None:
    rng = np.random.default_rng(1)
    warm, values = warmth(rng), rng.normal(size=NIGHTS)
    columns = np.column_stack((0.7 * warm, rng.normal(size=NIGHTS)))
    influence = Influence(columns, np.array([0.4, -1.0]))
    inverse = np.linalg.inv(np.eye(NIGHTS) + columns @ columns.T)
    expected = values - columns @ influence.centre

    def left(matrix: np.ndarray) -> float:
        sizes = np.linalg.solve(matrix.T @ inverse @ matrix, matrix.T @ inverse @ expected)
        rest = expected - matrix @ sizes
        return float(rest @ inverse @ rest)

    model = influence.beside(design([], NIGHTS), 1.0)
    for kind in Kind:
        found = gains(influence.with_beliefs(values, 1.0), model, kind, NIGHTS)
        for start in (6, 12, 22):
            gain = left(design([], NIGHTS)) - left(design([Term(start, kind)], NIGHTS))
            assert found[start] == pytest.approx(gain, rel=1e-9)


def test_strengths_that_act_alike_are_one() -> None:
    rng = np.random.default_rng(2)
    warm = warmth(rng)
    columns = np.outer(warm, [0.3, 0.4, 0.0])
    centre = np.array([1.0, 2.0, 3.0])
    found = Influence(columns, centre).summed(1e-6)
    assert found.count == 1
    assert found.columns @ found.centre == pytest.approx(columns @ centre)
    assert found.columns @ found.columns.T == pytest.approx(columns @ columns.T)
    assert Influence(columns, centre).summed(1e3).count == 0


@pytest.mark.slow
def test_a_slope_learned_on_warm_nights_raises_no_alarm_on_cold_ones() -> None:
    """One error of the slope moves all later nights: counted as each night's own it is a step."""
    false, unaware, machines = 0, 0, 60
    for seed in range(machines):
        rng = np.random.default_rng([seed, 17])
        values, influence = series(rng, warmth(rng))
        for last in (10, 14, 20, NIGHTS):
            known = Influence(influence.columns[:last], influence.centre)
            seen = values[:last]
            false += judge(seen, family=1, margin=0.0, own=1.0, influence=known).state.drifted
            unaware += judge(seen, family=1, margin=0.0, own=1.0).state.drifted
    assert false <= 0.01 * 4 * machines
    assert unaware > 0.05 * 4 * machines


def test_a_step_of_cold_nights_is_found_beside_their_slope() -> None:
    found, machines = 0, 40
    for seed in range(machines):
        rng = np.random.default_rng([seed, 18])
        values, influence = series(rng, warmth(rng, 24))
        values[20:] += 6.0
        found += judge(values, family=1, margin=0.0, influence=influence).state.drifted
    assert found >= 0.9 * machines


def test_the_newest_nights_are_tested_beside_an_influence() -> None:
    """The p-value of a healthy machine is uniform below one, or larger."""
    chances, sure = [], 0
    for seed in range(150):
        rng = np.random.default_rng([seed, 19])
        values, influence = series(rng, warmth(rng, 10))
        chances.append(newest_of(values, 1.0, influence).p_value)
        sure += newest_of(values + 12.0 * (np.arange(10) > 7), math.nan, influence).p_value < 0.05
    assert np.mean(np.array(chances) <= 0.05) <= 0.09
    assert sure >= 0.5 * 150
