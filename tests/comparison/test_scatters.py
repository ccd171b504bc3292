"""How differently two sides scatter, by what all metrics say together."""

import math

import numpy as np
import pytest

from eha_bench.comparison.scatters import RATIOS, ratio_priors


def drawn(rng: np.random.Generator, ratio: float, metrics: int) -> tuple[list, np.ndarray]:
    """Return the sides of several metrics, and the likelihood of every ratio of their scatters."""
    sides = [(ratio * rng.normal(size=5), rng.normal(size=5)) for _ in range(metrics)]
    rows = []
    for first, second in sides:
        f = first.var(ddof=1) / second.var(ddof=1) / np.exp(2.0 * RATIOS)
        # of F with 4 and 4 degrees of freedom, as a density of its logarithm
        rows.append(f**2 / (1.0 + f) ** 4)
    return sides, np.array(rows)


@pytest.mark.parametrize("ratio", [0.25, 1.0, 4.0])
def test_the_prior_of_one_metric_lies_where_the_others_ratios_lie(ratio: float) -> None:
    sides, likelihoods = drawn(np.random.default_rng(3), ratio, 24)
    for prior in ratio_priors(likelihoods, sides):
        assert prior.mean() == pytest.approx(1.0)
        # most likely there, symmetric in the logarithm, and never without a flat part
        best = int(np.argmax(prior))
        assert RATIOS[best] == pytest.approx(math.log(ratio), abs=0.4)
        near = min(best, RATIOS.size - 1 - best, 8)
        np.testing.assert_allclose(prior[best - near], prior[best + near], rtol=0.5, atol=0.1)
        assert prior.min() >= 0.1


def test_one_metric_alone_learns_nothing() -> None:
    sides, likelihoods = drawn(np.random.default_rng(3), 4.0, 1)
    np.testing.assert_array_equal(ratio_priors(likelihoods, sides)[0], np.ones(RATIOS.size))
