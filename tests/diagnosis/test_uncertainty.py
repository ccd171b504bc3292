"""Intervals cover, and directions that data do not determine are named."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from eha_bench.diagnosis.fit.evidence import SOFT_MEAN, Groups, compare, left_out
from eha_bench.diagnosis.fit.least_squares import Fit, Free
from eha_bench.diagnosis.fit.problem import soften
from eha_bench.diagnosis.fit.uncertainty import (
    estimates,
    posterior,
    spreads,
    undetermined_directions,
)


def linear_fit(matrix: np.ndarray, residual: np.ndarray, names: list[str], values: np.ndarray):
    free = tuple(
        Free(name, k, -np.inf, np.inf, abs(values[k]), of_effect="." in name)
        for k, name in enumerate(names)
    )
    soft, _ = soften(residual)
    return Fit(values, free, residual, matrix, float(soft @ soft))


def blocks(n: int, size: int = 50) -> Groups:
    rows = tuple(np.arange(k, k + size) for k in range(0, n, size))
    return Groups(tuple(np.array_split(np.arange(n), 4)), rows)


def test_white_residuals_give_the_textbook_deviation():
    rng = np.random.default_rng(0)
    matrix = rng.standard_normal((20000, 2))
    fit = linear_fit(matrix, rng.standard_normal(20000), ["a", "b"], np.array([1.0, 1.0]))
    found = spreads(fit, blocks(20000))
    assert found["a"].deviation == pytest.approx(1 / np.sqrt(20000), rel=0.2)


def test_correlated_residuals_widen_the_interval():
    rng = np.random.default_rng(0)
    n = 20000
    white = linear_fit(np.ones((n, 1)), rng.standard_normal(n), ["a"], np.ones(1))
    slow = np.repeat(rng.standard_normal(n // 50), 50)
    slow_fit = linear_fit(np.ones((n, 1)), slow - slow.mean(), ["a"], np.ones(1))
    wide = spreads(slow_fit, blocks(n))["a"].half_width
    assert wide > 4 * spreads(white, blocks(n))["a"].half_width


def test_runs_that_ask_for_other_values_widen_the_interval():
    rng = np.random.default_rng(0)
    n = 24000
    groups = Groups(tuple(np.array_split(np.arange(n), 6)), blocks(n).blocks)
    column = np.sin(np.arange(n) / 7.0)
    wanted = np.repeat([0.2, -0.1, 0.15, -0.2, 0.05, -0.1], n // 6)
    own = linear_fit(column[:, None], rng.standard_normal(n), ["a"], np.ones(1))
    other = linear_fit(column[:, None], own.residual + wanted * column, ["a"], np.ones(1))
    assert spreads(other, groups)["a"].half_width > 4 * spreads(own, groups)["a"].half_width


def test_no_size_of_an_effect_is_exact_to_more_than_a_thousandth():
    rng = np.random.default_rng(0)
    matrix = 1e5 * rng.standard_normal((20000, 2))
    names = ["leakage", "external_leakage.leakage_coefficient"]
    fit = linear_fit(matrix, rng.standard_normal(20000), names, np.array([3.0, 3.0]))
    noise = spreads(fit, blocks(20000))
    found = estimates(fit, blocks(20000), {})
    half = {key: 0.5 * (item.high - item.low) for key, item in found.items()}
    assert half["leakage"] == pytest.approx(noise["leakage"].half_width)
    assert half[names[1]] == pytest.approx(1.96e-3 * 3.0, rel=1e-3)


def correlated(rng: np.random.Generator, shape: tuple[int, int], memory: float) -> np.ndarray:
    """Noise with a memory from sample to sample, as a filter's or a slow disturbance's."""
    white = rng.standard_normal((shape[0], shape[1] + 400))
    gain = np.sqrt(1.0 - memory**2)
    return lfilter([gain], [1.0, -memory], white, axis=1)[:, 400:].ravel()


def of_each_run(rng: np.random.Generator, matrix: np.ndarray, runs: int) -> np.ndarray:
    """What a model's wrong form leaves: every run asks for parameters of its own."""
    wanted = np.repeat(rng.normal(0.0, 0.15, (runs, matrix.shape[1])), len(matrix) // runs, axis=0)
    return np.sum(matrix * wanted, axis=1)


@pytest.mark.parametrize("kind", ["white", "memory of 20 ms", "memory of 100 ms", "runs differ"])
def test_intervals_hold_the_truth_as_often_as_they_say(kind: str):
    rng = np.random.default_rng(1)
    runs, ticks, cases = 6, 1500, 120
    time = np.arange(ticks) * 2e-3
    matrix = np.column_stack(
        [
            np.concatenate(
                [
                    rng.uniform(0.7, 1.4)
                    * np.sin(rng.uniform(3.0, 50.0) * time + rng.uniform(0.0, 6.0))
                    for _ in range(runs)
                ]
            )
            for _ in range(4)
        ]
    )
    # one parameter shows in two runs only, as a free rod's does
    matrix[: 4 * ticks, 3] = 0.0
    groups = Groups(
        tuple(np.array_split(np.arange(runs * ticks), runs)), blocks(runs * ticks).blocks
    )
    held = 0
    for _ in range(cases):
        noise = rng.standard_normal(runs * ticks)
        if kind.startswith("memory"):
            noise += correlated(rng, (runs, ticks), 0.9 if "20 ms" in kind else 0.98)
        elif kind == "runs differ":
            noise += of_each_run(rng, matrix, runs)
        step = -np.linalg.lstsq(matrix, noise, rcond=None)[0]
        fit = linear_fit(matrix, noise + matrix @ step, list("abcd"), np.ones(4))
        found = spreads(fit, groups)
        held += sum(abs(step[k]) < found[name].half_width for k, name in enumerate("abcd"))
    assert 0.91 <= held / (4 * cases) <= 0.985


def test_a_product_is_named_as_a_product():
    rng = np.random.default_rng(0)
    column = rng.standard_normal(1000)
    matrix = np.column_stack([column, column])
    fit = linear_fit(matrix, rng.standard_normal(1000), ["J", "beta"], np.array([2.0, 3.0]))
    assert undetermined_directions(fit) == (
        "J and beta only as a product (the data do not depend on it)",
    )


def test_a_sum_is_no_product():
    """K + B: with K = 2 and B = 3 a per cent of K is as much as two thirds of one of B."""
    rng = np.random.default_rng(0)
    column = rng.standard_normal(1000)
    # by relative changes
    matrix = np.column_stack([2.0 * column, 3.0 * column])
    fit = linear_fit(matrix, rng.standard_normal(1000), ["K", "B"], np.array([2.0, 3.0]))
    assert undetermined_directions(fit) == (
        "K and B only together: where the first grows by 1 %, the second falls by 0.67 % (the data "
        "do not depend on it)",
    )


def test_a_ratio_is_named_as_a_ratio():
    rng = np.random.default_rng(0)
    column = rng.standard_normal(1000)
    matrix = np.column_stack([column, -column])
    fit = linear_fit(matrix, rng.standard_normal(1000), ["K", "D"], np.array([2.0, 3.0]))
    assert undetermined_directions(fit) == (
        "K and D only as a ratio (the data do not depend on it)",
    )


def test_a_regressor_without_meaning_gains_nothing_on_runs_left_out():
    rng = np.random.default_rng(3)
    n = 8000
    residual = np.convolve(rng.standard_normal(n), np.ones(30) / np.sqrt(30), "same")
    before = linear_fit(np.zeros((n, 0)), residual, [], np.zeros(0))
    matrix = np.convolve(rng.standard_normal(n), np.ones(30), "same")[:, None]
    step = -(matrix[:, 0] @ residual) / (matrix[:, 0] @ matrix[:, 0])
    after = linear_fit(matrix, residual + step * matrix[:, 0], ["x"], np.ones(1))
    found = compare(before, after, blocks(n), 1.0)
    assert found.p_value > 1e-3


def uneven(rng: np.random.Generator, elsewhere: float) -> np.ndarray:
    """What acts strongly in one block of eighty, and in every third by a share of that."""
    size = np.where(np.arange(80) % 3 == 0, elsewhere, 0.0)
    size[41] = 1.0
    return np.repeat(size, 100) * rng.standard_normal(8000)


@pytest.mark.parametrize(("elsewhere", "sure"), [(0.02, True), (0.0, False)])
def test_what_acts_most_in_one_block_is_sure_if_it_acts_in_others_too(
    elsewhere: float, *, sure: bool
) -> None:
    """Its sum over blocks is far from normal: one block is nearly all of it."""
    rng = np.random.default_rng(3)
    column = 20.0 * uneven(rng, elsewhere)
    noise = rng.standard_normal(8000)
    before = linear_fit(np.zeros((8000, 0)), noise + column, [], np.zeros(0))
    found = compare(
        before, linear_fit(column[:, None], noise, ["x"], np.ones(1)), blocks(8000), 1.0
    )
    assert found.gain_out > 100.0
    assert (found.p_value <= 0.05) is sure


@pytest.mark.parametrize("elsewhere", [0.02, 0.2, 1.0])
def test_of_regressors_without_meaning_at_most_as_many_are_sure_as_is_said(elsewhere: float):
    rng = np.random.default_rng(5)
    sure = 0
    for _ in range(200):
        column, residual = uneven(rng, elsewhere), rng.standard_normal(8000)
        step = -(column @ residual) / (column @ column)
        before = linear_fit(np.zeros((8000, 0)), residual, [], np.zeros(0))
        after = linear_fit(column[:, None], residual + step * column, ["x"], np.ones(1))
        sure += compare(before, after, blocks(8000), 1.0).p_value <= 0.05
    assert sure / 200 <= 0.05 + 2.0 * np.sqrt(0.05 * 0.95 / 200)


def test_a_real_regressor_is_found_on_runs_left_out():
    rng = np.random.default_rng(3)
    n = 8000
    column = rng.standard_normal(n)
    noise = rng.standard_normal(n)
    before = linear_fit(np.zeros((n, 0)), noise + 0.3 * column, [], np.zeros(0))
    after = linear_fit(column[:, None], noise, ["x"], np.ones(1))
    found = compare(before, after, blocks(n), 0.09 * n)
    assert found.p_value < 1e-6
    assert found.share_out == pytest.approx(1.0, abs=0.25)
    assert left_out(after, blocks(n)).shape == (n,)


def test_what_is_explained_on_runs_left_out_is_a_part():
    """A parameter bent to imitate a cause, in each run another way, costs more where left out."""
    rng = np.random.default_rng(4)
    n = 8000
    groups = blocks(n)
    noise = rng.standard_normal(n)
    shape = np.sin(np.arange(n) / 9.0)
    cause = shape * np.repeat([3.0, -3.0, 3.0, -3.0], n // 4)
    imitates = shape * np.repeat([1.0, 0.2, 1.0, 0.2], n // 4)
    bent = float(imitates @ cause / (imitates @ imitates))
    before = linear_fit(imitates[:, None], noise + cause - bent * imitates, ["a"], np.ones(1))
    both = np.column_stack([imitates, cause])
    after = linear_fit(both, noise, ["a", "x"], np.ones(2))
    soft, _ = soften(before.residual)
    found = compare(before, after, groups, float(soft @ soft) - SOFT_MEAN * n)
    assert found.share_out > 1.05
    assert 0.97 < found.explained_out <= 1.0
    # half of a cause is a part of it, and what does harm is none
    half = linear_fit(np.zeros((n, 0)), noise + 0.5 * cause, [], np.zeros(0))
    assert 0.5 < compare(before, half, groups, 1.0).explained_out < 0.97
    assert compare(half, before, groups, 1.0).explained_out < 0.0


def test_soft_loss_is_quadratic_for_noise_and_linear_for_outliers():
    soft, weight = soften(np.array([0.0, 0.5, 500.0]))
    assert soft[1] == pytest.approx(0.5, rel=0.01)
    assert soft[2] ** 2 == pytest.approx(2 * 5 * 500, rel=0.02)
    assert weight[0] == pytest.approx(1.0)


def test_the_posterior_is_finite_and_as_wide_as_the_intervals_where_data_tell():
    rng = np.random.default_rng(7)
    matrix = rng.standard_normal((600, 2))
    # the second number is not in any reading
    matrix[:, 1] = 0.0
    residual = rng.standard_normal(600)
    free = (Free("told", 0, 0.0, 100.0, 2.0), Free("open", 1, 0.0, 100.0, 4.0))
    fit = Fit(np.array([2.0, 4.0]), free, residual, matrix, float(residual @ residual))
    blocks = tuple(np.split(np.arange(600), 60))
    groups = Groups(tuple(np.split(np.arange(600), 6)), blocks)
    found = posterior(fit, groups)
    assert found.parameters == ("told", "open")
    deviation = np.sqrt(np.diag(found.matrix))
    assert deviation[0] == pytest.approx(spreads(fit, groups)["told"].deviation, rel=0.01)
    # half of its size, or less where bounds leave less
    assert deviation[1] == pytest.approx(2.0)
    assert abs(found.matrix[0, 1]) < 1e-12


def test_the_posterior_is_one_where_two_numbers_are_told_only_as_a_product_and_that_very_well():
    # a residual of a thousand times the noise, as on a real machine: cond of the information 1e18
    rng = np.random.default_rng(8)
    column = 1e9 * rng.standard_normal(1000)
    matrix = np.column_stack([column, column, 1e-2 * rng.standard_normal(1000)])
    values = np.array([2.0, 3.0, 1.0])
    fit = linear_fit(matrix, 1e3 * rng.standard_normal(1000), ["J", "beta", "other"], values)
    found = posterior(fit, blocks(1000)).matrix
    assert np.isfinite(found).all()
    assert np.linalg.eigvalsh(found).min() > -1e-12
    deviation = np.sqrt(np.diag(found))
    # each by itself is as open as believed; their product hardly is
    assert deviation[:2] / values[:2] == pytest.approx([0.354, 0.354], abs=0.01)
    product = np.array([1.0 / values[0], 1.0 / values[1], 0.0])
    assert np.sqrt(product @ found @ product) < 1e-4
