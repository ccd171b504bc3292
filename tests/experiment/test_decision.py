"""Least costs, distances and odds against what linear algebra and the normal law say."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from eha_bench.core.arrays import FloatArray
from eha_bench.experiment.decision import (
    DISTINGUISHED,
    NOISES,
    DrawRows,
    distances,
    is_spread,
    least_costs,
    odds,
    shares_of_a_decision,
)
from eha_bench.experiment.response import _furthest as furthest


def linear(
    rng: np.random.Generator,
    means: Sequence[FloatArray],
    slopes: Sequence[FloatArray],
    draws: int,
    causes: str = "",
) -> tuple[DrawRows, FloatArray, list[FloatArray]]:
    """Return layout and rows of rivals y = mean + slopes z, with noise below."""
    z = [np.vstack([np.zeros(j.shape[1]), rng.standard_normal((draws, j.shape[1]))])
         for j in slopes]  # fmt: skip
    outputs = [mean + own @ j.T for mean, j, own in zip(means, slopes, z, strict=True)]
    noise = rng.standard_normal((NOISES, means[0].size))
    rows = np.vstack([*outputs, *(j.T for j in slopes), noise])
    named = tuple(causes or map(str, range(len(slopes))))
    behind = (0.0,) * len(slopes)
    return DrawRows(tuple(j.shape[1] for j in slopes), tuple(z), named, behind), rows, outputs


def test_the_least_cost_is_that_of_a_fit_with_the_posterior_as_prior():
    rng = np.random.default_rng(1)
    means = [rng.standard_normal(40) for _ in range(2)]
    slopes = [rng.standard_normal((40, 3)), rng.standard_normal((40, 2))]
    layout, rows, outputs = linear(rng, means, slopes, 4)
    costs = least_costs(layout, rows @ rows.T, 1)
    noise = rows[-NOISES:]
    for d in range(5):
        for m in range(NOISES):
            recorded = outputs[0][d] + noise[m]
            # stacked least squares: the readings, and the prior of standard coordinates
            matrix = np.vstack([slopes[1], np.eye(2)])
            target = np.concatenate([recorded - means[1], np.zeros(2)])
            left = target - matrix @ np.linalg.lstsq(matrix, target, rcond=None)[0]
            assert costs[d, m] == pytest.approx(left @ left, rel=1e-9)


def test_the_distance_is_that_of_both_predictive_covariances():
    rng = np.random.default_rng(2)
    means = [rng.standard_normal(30) for _ in range(3)]
    slopes = [rng.standard_normal((30, 2)) for _ in range(3)]
    layout, rows, _ = linear(rng, means, slopes, 0)
    found = distances(layout, rows @ rows.T)
    for place, (r, q) in enumerate([(0, 1), (0, 2), (1, 2)]):
        both = np.eye(30) + slopes[r] @ slopes[r].T + slopes[q] @ slopes[q].T
        d = means[r] - means[q]
        assert found[place] == pytest.approx(d @ np.linalg.solve(both, d), rel=1e-9)


def blocks_of(rows: FloatArray, count: int) -> FloatArray:
    """Return cumulated inner products over equal blocks."""
    parts = np.split(rows, count, axis=1)
    return np.cumsum([part @ part.T for part in parts], axis=0)


@pytest.mark.parametrize("distance", [20.0, 40.0, 90.0])
def test_a_known_distance_gives_the_probability_of_normal_gains(distance: float):
    # without parameters the gain in each of 40 blocks is normal, mean d and variance 4 d
    size, blocks = 800, 40
    rng = np.random.default_rng(3)
    step = np.full(size, np.sqrt(distance / size))
    nothing = np.zeros((size, 1))
    right = []
    for _ in range(8):
        layout, rows, _ = linear(rng, [0.0 * step, step], [nothing, nothing], 0)
        right.append(odds(layout, blocks_of(rows, blocks))[-1].right)
    d = distance / blocks
    gains = d + 2.0 * np.sqrt(d) * rng.standard_normal((20_000, blocks))
    whole = gains.sum(axis=1)
    expected = np.mean(whole >= DISTINGUISHED)
    scatter = np.sqrt(expected * (1.0 - expected) / (8 * NOISES)) + 0.01
    assert np.mean(right) == pytest.approx(expected, abs=3.5 * scatter)


def test_a_lead_of_a_wrong_rival_has_to_be_made_up_for():
    size = 800
    rng = np.random.default_rng(5)
    step = np.full(size, np.sqrt(80.0 / size))
    nothing = np.zeros((size, 1))
    layout, rows, _ = linear(rng, [0.0 * step, step], [nothing, nothing], 0)
    even = odds(layout, blocks_of(rows, 40))[-1]
    ahead = odds(replace(layout, behind=(0.0, 100.0)), blocks_of(rows, 40))[-1]
    assert even.by_rival["0"] == ahead.by_rival["0"] > 0.9
    assert even.by_rival["1"] > 0.9
    # 80 of gain, and 100 to make up for
    assert ahead.by_rival["1"] < 0.3
    needed = [shares_of_a_decision(item, blocks_of(rows, 40))[-1]
              for item in (layout, replace(layout, behind=(0.0, 100.0)))]  # fmt: skip
    assert needed[0] > 2.0 * needed[1]


def test_a_refit_does_not_begin_at_the_truth():
    # two rivals that are one curved model, each drawn by itself: neither can be named more often
    rng = np.random.default_rng(6)
    size, draws = 200, 12
    z = [np.vstack([np.zeros(1), rng.standard_normal((draws, 1))]) for _ in range(2)]
    shapes = rng.standard_normal((2, size))
    outputs = [own * shapes[0] + own**2 * shapes[1] for own in z]
    rows = np.vstack([*outputs, shapes[:1], shapes[:1], rng.standard_normal((NOISES, size))])
    layout = DrawRows((1, 1), tuple(z), ("a", "b"), (0.0, 0.0))
    (found,) = odds(layout, (rows @ rows.T)[None])
    assert found.right < 0.5
    assert abs(found.right - found.wrong) < 0.3


def test_rivals_that_predict_the_same_are_never_named():
    rng = np.random.default_rng(4)
    mean, slope = rng.standard_normal(200), rng.standard_normal((200, 2))
    layout, rows, _ = linear(rng, [mean, mean], [slope, slope], 8)
    found = odds(layout, blocks_of(rows, 20))[-1]
    assert found.right == 0.0
    assert found.wrong == 0.0
    assert shares_of_a_decision(layout, blocks_of(rows, 20))[-1] == pytest.approx(0.0, abs=1e-9)


def test_forms_of_one_cause_need_not_be_told_from_one_another():
    rng = np.random.default_rng(7)
    here, there = np.zeros(400), np.ones(400)
    nothing = np.zeros((400, 1))
    means = [here, there, there]
    layout, rows, _ = linear(rng, means, [nothing] * 3, 0, "abb")
    found = odds(layout, blocks_of(rows, 40))[-1]
    assert found.right == 1.0
    assert found.by_rival == {"a": 1.0, "b": 1.0}
    assert distances(layout, rows @ rows.T) == pytest.approx([400.0, 400.0])
    # as causes of their own the two alike are never told apart
    layout, rows, _ = linear(rng, means, [nothing] * 3, 0, "abc")
    assert odds(layout, blocks_of(rows, 40))[-1].by_rival == {"a": 1.0, "b": 0.0, "c": 0.0}


def test_every_cause_counts_alike_however_many_forms_it_has():
    rng = np.random.default_rng(8)
    near, far = np.full(400, 0.02), np.ones(400)
    nothing = np.zeros((400, 1))
    # one form of 'b' is as good as 'a', three are far from it: 'b' is named in three of four
    layout, rows, _ = linear(rng, [0.0 * near, near, far, -far, 2.0 * far], [nothing] * 5, 0,
                             "abbbb")  # fmt: skip
    found = odds(layout, blocks_of(rows, 40))[-1]
    assert found.by_rival["b"] == pytest.approx(0.75)
    assert found.right == pytest.approx(0.5 * (found.by_rival["a"] + 0.75))


def test_an_extreme_reaches_as_far_as_that_of_a_thousand_draws():
    rng = np.random.default_rng(6)
    seen = []
    for _ in range(200):
        seen.append(furthest(rng.standard_normal(24)))
    # the largest of a thousand normal numbers is 3.24 on average
    assert np.mean(seen) == pytest.approx(3.24, abs=0.3)
    assert furthest(np.array([5.0])) == 5.0


def test_a_gain_in_a_few_blocks_is_not_spread():
    rng = np.random.default_rng(5)
    nothing = np.zeros((400, 1))
    once, everywhere = np.zeros(400), np.full(400, 1.0)
    once[:10] = 20.0
    for apart, needed in ((once, math.inf), (everywhere, 13)):
        layout, rows, _ = linear(rng, [np.zeros(400), apart], [nothing, nothing], 0)
        grams = blocks_of(rows, 40)
        found = is_spread(layout, grams)
        # by the likelihood ratio alone both are named
        assert odds(layout, grams)[-1].right == 1.0
        # n blocks of d = 10 each gain n d / sqrt(n (d^2 + 4 d)) deviations: 3 by 13 of them
        assert found.tolist() == [number >= needed for number in range(1, 41)]
