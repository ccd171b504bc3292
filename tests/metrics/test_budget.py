"""Budgets of uncertainty: how contributions add up, and what factor makes 95 % of them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.core.budget import Budget, Contribution, Evaluation
from eha_bench.core.score import Measure
from eha_bench.metrics.coverage import NORMAL, between, coverage_factor, reach, type_a, type_b

sizes = st.floats(1e-6, 1e6)


def test_the_end_gauge_of_the_guide():
    """JCGM 100, H.1: u = 32 nm with 16 degrees of freedom."""
    parts = [("standard", 25, 18), ("difference", 9.7, 25.6), ("expansion", 2.9, 50),
             ("temperature", 16.6, 2)]  # fmt: skip
    budget = Budget(tuple(Contribution(n, Evaluation.A, u, v) for n, u, v in parts))
    assert budget.standard == pytest.approx(32, abs=0.5)
    assert budget.freedom == pytest.approx(16.7, abs=0.1)
    assert coverage_factor(budget) == pytest.approx(2.11, abs=0.01)


@pytest.mark.parametrize("normal", [0.0, 0.3, 1.0, 3.0])
@pytest.mark.parametrize("second", [0.0, 0.5, 1.0])
def test_ninety_five_per_cent_of_sums_of_normal_and_rectangular(normal, second):
    rng = np.random.default_rng(1)
    total = normal * rng.normal(size=200_000) + rng.uniform(-1, 1, 200_000)
    total += second * rng.uniform(-1, 1, 200_000)
    budget = type_b("a", normal) + between("b", 1.0) + between("c", second)
    assert np.mean(np.abs(total) <= reach(budget)) == pytest.approx(0.95, abs=0.011)


@given(sizes, sizes, st.floats(-1e3, 1e3))
def test_scaling_and_adding(a, b, factor):
    budget = type_a("noise", a**2, 10.0) + between("resolution", b)
    assert budget.variance == pytest.approx(a**2 + b**2 / 3.0)
    assert budget.scaled(factor).standard == pytest.approx(abs(factor) * budget.standard)
    assert budget.merged().variance == pytest.approx(budget.variance)
    assert 1.6 <= coverage_factor(budget) <= 2.3


def test_one_source_is_one_line():
    both = type_a("noise", 9.0, 5.0) + between("resolution", 1.0) + type_a("noise", 16.0, 5.0)
    assert [(part.source, part.standard) for part in both.merged().parts] == [
        ("noise", 5.0),
        ("resolution", pytest.approx(1.0 / math.sqrt(3.0))),
    ]
    # the noise of two places is one estimate: adding its places adds no knowledge
    assert type_a("noise", 9.0, 5.0).freedom == 5.0
    assert both.scaled(1.0).freedom == pytest.approx(5.0 * (25.333 / 25.0) ** 2, rel=1e-3)


def test_what_is_not_known_has_no_interval():
    assert math.isnan(reach(type_a("noise", 1.0, 0.0)))
    assert not Budget().known
    assert math.isnan(reach(Budget()))
    assert coverage_factor(type_b("sensor", 1.0)) == pytest.approx(NORMAL, abs=1e-4)
    assert Measure(1.0).budget.parts == ()
