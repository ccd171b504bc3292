"""The statistics under a comparison, against SciPy and by their properties."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from eha_bench.comparison.correction import holm
from eha_bench.comparison.evidence import evidence
from eha_bench.comparison.permutation import p_greater, p_greater_paired
from eha_bench.comparison.planning import more_repeats
from eha_bench.comparison.sample import Sample
from eha_bench.comparison.sequential import sequential, shares


def test_holm_is_holms_own_example() -> None:
    # Holm (1979): 0.01 stays below 0.05 after times 4, 0.02 after times 3 does not
    adjusted = holm([0.01, 0.04, 0.03, 0.02, math.nan])
    assert adjusted[:4] == pytest.approx([0.04, 0.06, 0.06, 0.06])
    assert math.isnan(adjusted[4])


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=30))
def test_holm_keeps_the_order_and_never_helps(p_values: list[float]) -> None:
    adjusted = holm(p_values)
    assert all(a >= p for a, p in zip(adjusted, p_values, strict=True))
    assert all(
        a <= min(1.0, len(p_values) * p) + 1e-15 for a, p in zip(adjusted, p_values, strict=True)
    )
    order = np.argsort(p_values)
    assert (np.diff(np.array(adjusted)[order]) >= 0).all()


def test_the_exact_permutation_test_is_scipys() -> None:
    rng = np.random.default_rng(3)
    first, second = rng.normal(size=6), rng.normal(0.7, 2.0, size=5)

    def welch(x: np.ndarray, y: np.ndarray) -> float:
        return float(stats.ttest_ind(y, x, equal_var=False).statistic)

    theirs = stats.permutation_test(
        (first, second), welch, alternative="greater", n_resamples=10**6
    )
    assert p_greater(first, second) == pytest.approx(theirs.pvalue, abs=1e-12)


def test_the_paired_permutation_test_lists_all_signs() -> None:
    assert p_greater_paired(np.array([1.0, 2.0, 3.0, 4.0])) == pytest.approx(1 / 16)
    assert p_greater_paired(-np.array([1.0, 2.0, 3.0, 4.0])) == 1.0


def test_few_repeats_are_judged_by_welchs_t() -> None:
    first, second = np.array([1.0, 1.1, 0.9]), np.array([1.5, 1.7, 1.4])
    found = evidence(Sample.of(first), Sample.of(second), 0.1, family=20)
    theirs = stats.ttest_ind(second, first, equal_var=False)
    assert found.p_difference == pytest.approx(theirs.pvalue)
    assert (found.low, found.high) == pytest.approx(tuple(theirs.confidence_interval()))


def test_a_single_run_is_judged_by_its_own_interval_doubled() -> None:
    one = Sample(np.array([1.0]), np.array([0.98]), np.array([1.02]))
    two = Sample(np.array([1.2]), np.array([1.18]), np.array([1.22]))
    found = evidence(one, two, 0.02)
    assert found.high - found.low == pytest.approx(2 * 2 * math.hypot(0.02, 0.02))
    assert found.p_difference < 1e-6
    unknown = Sample.of([1.0])
    assert math.isnan(evidence(unknown, two, 0.02).p_difference)


def test_values_that_do_not_scatter_are_compared() -> None:
    same = evidence(Sample.of([2.0] * 3), Sample.of([2.0] * 3), 0.0)
    assert (same.p_difference, same.p_same) == pytest.approx((1.0, 0.5)) or same.p_difference == 1.0
    other = evidence(Sample.of([2.0] * 3), Sample.of([3.0] * 3), 0.1)
    assert other.p_difference < 1e-6


def test_counts_scatter_even_where_they_do_not() -> None:
    few = evidence(Sample.of([0.0] * 3), Sample.of([1.0] * 3), 0.5, counted=True)
    assert few.p_difference > 0.05


def test_more_repeats_are_told_as_far_as_they_can_be() -> None:
    needed = more_repeats(1.0, 0.5, 1.0, 5, alpha=0.05)
    assert needed is not None
    # the textbook: 17 each for d = 1, two-sided 5 %, power 80 %
    assert needed + 5 == pytest.approx(17, abs=1)
    assert more_repeats(0.5, 0.5, 0.0, 5, alpha=0.05) == 1
    assert more_repeats(1e-6, 1e-6, 1.0, 5, alpha=0.05) is None
    assert more_repeats(1.0, 0.5, math.nan, 5, alpha=0.05) is None


@pytest.mark.parametrize(("difference", "margin"), [(1.0, 0.5), (0.8, 0.5), (0.0, 1.0), (0.5, 1.0)])
def test_as_many_repeats_decide_four_times_of_five(difference: float, margin: float) -> None:
    needed = more_repeats(difference, margin, 1.0, 4, alpha=0.05)
    assert needed is not None
    rng = np.random.default_rng(2)
    size = (800, 4 + needed)
    first, second = rng.normal(size=size), rng.normal(difference, 1.0, size)
    seen = second.mean(axis=1) - first.mean(axis=1)
    differs = stats.ttest_ind(second, first, axis=1).pvalue <= 0.05
    above = stats.ttest_ind(second + margin, first, axis=1, alternative="greater").pvalue
    below = stats.ttest_ind(second - margin, first, axis=1, alternative="less").pvalue
    decided = (differs & (np.abs(seen) >= margin)) | (np.maximum(above, below) <= 0.05)
    assert 0.75 <= decided.mean() <= 0.9


def test_looking_often_never_says_more_than_its_share() -> None:
    rng = np.random.default_rng(4)
    said = 0
    for _ in range(100):
        first, second = (Sample.of(values) for values in rng.normal(size=(2, 10)))
        # the least p-value of all looks, so that it says whether any of them would have acted
        found = sequential(first, second, 0.1, family=1, counted=False, looks=shares(10))
        said += found.p_difference <= 0.05
    assert said <= 10  # 5 are allowed; more than 10 by chance once in 90


@given(st.integers(1, 40))
def test_the_shares_of_all_looks_are_the_whole(repeats: int) -> None:
    assert math.fsum(shares(repeats)) == pytest.approx(1.0)
    assert len(shares(repeats)) == repeats
