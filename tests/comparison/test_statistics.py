"""The statistics under a comparison, against SciPy and by their properties."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.signal import lfilter

from eha_bench.comparison.correction import holm
from eha_bench.comparison.dependence import FEWEST, coefficient_priors
from eha_bench.comparison.evidence import dependence_of, evidence, exact, ratios_of
from eha_bench.comparison.permutation import p_greater, p_greater_paired
from eha_bench.comparison.planning import MOST, more_repeats
from eha_bench.comparison.sample import Sample
from eha_bench.comparison.scatters import RATIOS, _independent, ratio_priors
from eha_bench.comparison.sequential import any_time_p_value, sequential, shares
from eha_bench.comparison.skewness import wider_of_pairs, wider_of_samples
from eha_bench.comparison.student_mixture import StudentMixture
from eha_bench.comparison.two_samples import two_samples, widest_ratio


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


def test_a_known_ratio_of_scatters_gives_students_own_t() -> None:
    # of very many repeats the ratio is known, and neighbours are not thought of
    rng = np.random.default_rng(1)
    first, second = rng.normal(size=400), rng.normal(0.1, 1.5, size=500)
    found = evidence(Sample.of(first), Sample.of(second), 0.1)
    theirs = stats.ttest_ind(second, first, equal_var=False)
    assert found.p_difference == pytest.approx(theirs.pvalue, rel=0.05)
    assert (found.low, found.high) == pytest.approx(tuple(theirs.confidence_interval()), rel=0.05)


def test_two_samples_are_the_integral_over_ratio_and_correlation() -> None:
    # the same by brute force: the joint density of all values, mean integrated out numerically
    first, second = np.array([1.0, 1.3, 0.8]), np.array([2.0, 2.1, 1.7, 2.2])
    coefficients = np.array([0.0, 0.5])
    found = two_samples(first, second, coefficients)
    means, scales = np.linspace(-15.0, 15.0, 1501), np.geomspace(0.01, 30.0, 400)
    furthest = math.log(widest_ratio(3, 4))
    grid = np.linspace(-furthest, furthest, found.likelihood.shape[1])
    for place in (grid.size // 3, grid.size // 2):
        ratio = math.exp(grid[place])
        shares = []
        for correlation in coefficients:
            whole = 0.0
            logs = []
            for values, wider in ((first, ratio), (second, 1.0)):
                lags = np.abs(np.subtract.outer(np.arange(values.size), np.arange(values.size)))
                matrix = correlation**lags
                inverse, determinant = np.linalg.inv(matrix), np.linalg.det(matrix)
                away = values[:, None] - means
                squares = np.einsum("im,ij,jm->m", away, inverse, away)
                sigma = wider * scales[:, None]
                density = np.exp(-0.5 * squares / sigma**2) / sigma**values.size
                logs.append(density.sum(axis=1) / math.sqrt(determinant))
            whole = float(np.sum(logs[0] * logs[1]))  # flat in the logarithm of the scale
            shares.append(whole)
        ours = found.likelihood[:, place]
        assert ours[1] / ours[0] == pytest.approx(shares[1] / shares[0], rel=0.02)


def test_a_mixture_of_one_is_students_t() -> None:
    one = StudentMixture.one(2.0, 0.5, 4.0)
    theirs = stats.t(4.0, 2.0, 0.5)
    assert one.below(1.0) == pytest.approx(theirs.cdf(1.0))
    assert one.above(9.0) == pytest.approx(theirs.sf(9.0))
    assert one.quantile(0.975) == pytest.approx(theirs.ppf(0.975))


@pytest.mark.parametrize("share", [1e-6, 0.025, 0.5, 0.975])
@pytest.mark.parametrize("apart", [0.0, 1e-9, 0.3, 1e4])
def test_a_share_of_a_mixture_lies_below_its_quantile(share: float, apart: float) -> None:
    centres, errors = np.array([1.0, 1.0 + apart, 1.0]), np.array([0.2, 0.2, 0.2 + apart])
    mixture = StudentMixture(np.array([0.2, 0.5, 0.3]), centres, errors, 3.0)
    theirs = stats.t(3.0, centres, errors)
    value = mixture.quantile(share)
    assert mixture.weights @ theirs.cdf(value) == pytest.approx(share, rel=1e-8)
    # and it is not asked for hundreds of times of each
    asked: list[float] = []
    with pytest.MonkeyPatch.context() as patch:
        below = StudentMixture.below
        patch.setattr(
            StudentMixture, "below", lambda own, at: (asked.append(at), below(own, at))[1]
        )
        mixture.quantile(share)
    assert len(asked) < 30


def test_independent_metrics_vouch_for_each_other() -> None:
    rng = np.random.default_rng(2)

    def priors(correlation: float, metrics: int) -> float:
        likelihoods, residuals = [], []
        for _ in range(metrics):
            sides = [
                Sample.of(lfilter([1.0], [1.0, -correlation], rng.normal(size=110))[100:])
                for _ in range(2)
            ]
            found = dependence_of(*sides)
            assert found is not None
            likelihoods.append(found)
            residuals.append(np.concatenate([side.values - side.mean for side in sides]))
        return float(coefficient_priors(np.array(likelihoods), residuals)[0][0])

    assert priors(0.0, 20) > 0.9
    assert priors(0.8, 20) < 0.2
    assert priors(0.0, 1) == pytest.approx(priors(0.8, 1))  # alone, nothing vouches


def test_too_few_repeats_do_not_show_dependence() -> None:
    assert dependence_of(Sample.of([1.0, 2.0, 1.5]), Sample.of([1.0, 2.0, 1.2])) is None


def test_one_run_a_side_decides_nothing() -> None:
    one = Sample(np.array([1.0]), np.array([0.98]), np.array([1.02]))
    found = evidence(one, Sample.of([9.0]), 0.02)
    assert math.isnan(found.p_difference)
    assert found.note == "one run a side"


def test_one_run_against_repeats_scatters_as_nobody_knows() -> None:
    repeats = Sample.of([1.0, 1.1, 0.9, 1.05, 0.95])
    near = evidence(repeats, Sample.of([1.4]), 0.0)
    far = evidence(repeats, Sample.of([20.0]), 0.0)
    assert near.p_difference > 0.05
    assert far.p_difference < 1e-3


def test_what_does_not_scatter_is_as_sure_as_chance_allows() -> None:
    other = evidence(Sample.of([2.0] * 3), Sample.of([3.0] * 3), 0.1)
    assert other.p_difference == pytest.approx(2 / 20)
    known = Sample(np.full(3, 3.0), np.full(3, 2.99), np.full(3, 3.01))
    assert evidence(Sample.of([2.0] * 3), known, 0.1).p_difference < 1e-4
    assert exact(Sample.of([2.0]), Sample.of([3.0]), 0.1, "").p_beyond == 0.0
    assert exact(Sample.of([2.0]), Sample.of([2.05]), 0.1, "").p_same == 0.0


def test_sides_that_scatter_alike_are_not_suspected_of_skewness() -> None:
    rng = np.random.default_rng(3)
    first, second = rng.normal(size=(2, 30))
    assert wider_of_samples(first, second, 2.0) == wider_of_pairs(first, second) == 1.0
    # Edgeworth: 4 / sqrt(30), and nothing is left of it with many
    assert wider_of_samples(first, second, 4.0) == pytest.approx(1.0 + 4.0 / math.sqrt(30.0))


def test_the_ratio_shown_is_that_of_fishers_distribution() -> None:
    rng = np.random.default_rng(3)
    first, second = rng.normal(size=30), 4.0 * rng.normal(size=30)
    found = two_samples(first, second, np.zeros(1))
    ratio = float(second.std(ddof=1) / first.std(ddof=1))
    shown = math.sqrt(stats.f.ppf(0.85, 29, 29))
    assert found.shown_ratio(np.ones(1), share=0.85) == pytest.approx(ratio / shown, rel=0.05)
    # where all others say that the scatters are alike, they are
    alike = np.exp(-0.5 * (RATIOS / 0.05) ** 2)
    assert found.shown_ratio(np.ones(1), scatters=alike, share=0.85) < 1.2


def likelihoods(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    found = [
        two_samples(a, b, np.zeros(1)).of_ratios(np.ones(1))
        for a, b in zip(first, second, strict=True)
    ]
    return np.array(found)


@pytest.mark.parametrize("ratio", [0.25, 1.0, 4.0])
def test_metrics_tell_each_other_how_differently_sides_scatter(ratio: float) -> None:
    rng = np.random.default_rng(5)
    first, second = ratio * rng.normal(size=(30, 3)), rng.normal(size=(30, 3))
    priors = ratio_priors(likelihoods(first, second), list(zip(first, second, strict=True)))
    about = [float(np.average(RATIOS, weights=prior)) for prior in priors]
    # a tenth stays flat, about 0
    assert about == pytest.approx([0.9 * math.log(ratio)] * 30, abs=0.35)
    assert min(float(prior.min()) for prior in priors) >= 0.1
    # metrics that are one and the same tell no more than one of them
    same = np.repeat(first[:1], 30, axis=0), np.repeat(second[:1], 30, axis=0)
    (prior, *_) = ratio_priors(likelihoods(*same), list(zip(*same, strict=True)))
    assert prior.max() < 0.5 * priors[0].max()


def test_one_metric_alone_learns_nothing() -> None:
    rng = np.random.default_rng(5)
    first, second = rng.normal(size=(2, 1, 3))
    (prior,) = ratio_priors(likelihoods(first, second), list(zip(first, second, strict=True)))
    assert (prior == 1.0).all()


def test_metrics_count_as_many_as_are_independent() -> None:
    one, other = np.array([1.0, -1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0, -1.0])
    assert _independent([(one, one), (other, other)]) == pytest.approx(2.0)
    assert _independent([(one, other), (-3.0 * one, -3.0 * other), (one, other)]) == pytest.approx(
        1.0
    )


def test_without_a_word_on_dependence_runs_are_independent() -> None:
    rng = np.random.default_rng(4)
    sides = Sample.of(rng.normal(size=6)), Sample.of(rng.normal(0.0, 3.0, 6))
    unknown, independent, alike = (
        ratios_of(*sides, prior) for prior in (None, np.ones(1), np.array([0.5, 0.5]))
    )
    assert unknown == pytest.approx(independent, rel=1e-12)
    assert unknown != pytest.approx(alike, rel=1e-3)


def test_counts_scatter_even_where_they_do_not() -> None:
    few = evidence(Sample.of([0.0] * 3), Sample.of([1.0] * 3), 0.5, counted=True)
    assert few.p_difference > 0.05


def test_more_repeats_are_told_as_far_as_they_can_be() -> None:
    needed = more_repeats(1.0, 0.5, 1.0, 5, alpha=0.05)
    assert needed is not None
    # the textbook: 64 each for d = 0.5 beyond the margin, two-sided 5 %, power 80 %
    assert needed + 5 == pytest.approx(64, abs=1)
    assert more_repeats(0.5, 0.4, 0.0, 5, alpha=0.05) == 1
    assert more_repeats(1e-6, 1e-6, 1.0, 5, alpha=0.05) is None
    assert more_repeats(1.0, 0.5, math.nan, 5, alpha=0.05) is None


def test_the_most_repeats_are_the_last_that_are_asked_for() -> None:
    low, high = 1.0, 1e3
    while high - low > 1e-9:
        middle = (low + high) / 2.0
        needed = more_repeats(1.0, 0.5, middle, 5, alpha=0.05)
        low, high = (low, middle) if needed is None else (middle, high)
    assert more_repeats(1.0, 0.5, low, 5, alpha=0.05) == MOST
    assert more_repeats(1.0, 0.5, high, 5, alpha=0.05) is None


@pytest.mark.parametrize(("difference", "margin"), [(1.0, 0.5), (0.8, 0.5), (0.0, 1.0), (0.5, 1.0)])
def test_as_many_repeats_decide_four_times_of_five(difference: float, margin: float) -> None:
    needed = more_repeats(difference, margin, 1.0, 4, alpha=0.05)
    assert needed is not None
    rng = np.random.default_rng(2)
    size = (800, 4 + needed)
    first, second = rng.normal(size=size), rng.normal(difference, 1.0, size)
    seen = second.mean(axis=1) - first.mean(axis=1)
    above = stats.ttest_ind(second + margin, first, axis=1, alternative="greater").pvalue
    below = stats.ttest_ind(second - margin, first, axis=1, alternative="less").pvalue
    error = stats.ttest_ind(second, first, axis=1)
    beyond = np.abs(seen) - margin >= seen / error.statistic * stats.t.isf(0.025, error.df)
    decided = beyond | (np.maximum(above, below) <= 0.05)
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


def test_the_p_value_of_often_looking_is_the_dearest_look() -> None:
    looks = shares(4)  # the first look is at three pairs
    assert any_time_p_value([0.0, 0.0, 0.1, 0.02], looks) == pytest.approx(
        min(0.1 / looks[2], 0.02 / looks[3])
    )
    assert any_time_p_value([0.0], looks) == 1.0


# --- what decides how a metric is tested ---------------------------------------------------------


def test_permutations_have_a_say_where_they_can_reach_the_level_of_the_family() -> None:
    """Five beside five reach 2 / 252 at least: below 5 % among six metrics, above among seven."""
    rng = np.random.default_rng(1)
    first, second = (Sample.of(list(rng.normal(size=5))) for _ in range(2))
    methods = [evidence(first, second, 0.1, family=family).method for family in (6, 7)]
    assert [method.startswith("permutation") for method in methods] == [True, False]


def test_counts_that_are_all_equal_scatter_as_counts_do() -> None:
    """Four pairs of 3 and 5: the mean's standard deviation is sqrt(3 / 4 + 5 / 4)."""
    first, second = Sample.of([3.0] * 4), Sample.of([5.0] * 4)
    found = evidence(first, second, 0.1, paired=True, counted=True)
    assert found.scatter == pytest.approx(math.sqrt(2.0))
    half = stats.t.ppf(0.975, 3) * math.sqrt(2.0)
    assert (found.low, found.high) == pytest.approx((2.0 - half, 2.0 + half), rel=1e-3)


def test_dependence_is_asked_of_as_many_repeats_as_show_it() -> None:
    rng = np.random.default_rng(1)
    enough = Sample.of(list(rng.normal(size=FEWEST)))
    assert dependence_of(enough, Sample.of(list(rng.normal(size=2)))) is not None
    assert dependence_of(enough, Sample.of([0.0])) is None
