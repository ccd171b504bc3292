"""Real roots in closed form are those of the eigenvalues."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.metrics.polynomial import real_roots

coefficient = st.integers(-1000, 1000).map(lambda number: number / 100.0)


@given(st.lists(coefficient, min_size=2, max_size=4))
def test_what_is_found_is_a_root(coefficients: list[float]) -> None:
    terms = np.array(coefficients)
    for root in real_roots(terms):
        size = float(np.abs(terms) @ np.maximum(np.abs(root), 1.0) ** np.arange(terms.size))
        assert abs(np.polynomial.polynomial.polyval(root, terms)) <= 1e-9 * max(size, 1e-300)


@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3), st.floats(0.1, 10.0))
def test_all_roots_of_a_cubic_are_found(roots: list[float], size: float) -> None:
    apart = np.diff(sorted(roots))
    if apart.min() < 1e-3:
        return
    terms = size * np.polynomial.polynomial.polyfromroots(roots)
    assert sorted(real_roots(terms)) == pytest.approx(sorted(roots), abs=1e-9)


@pytest.mark.parametrize("root", [-0.7, 0.0, 0.3])
def test_a_cubic_with_one_real_root(root: float) -> None:
    terms = np.polynomial.polynomial.polymul([-root, 1.0], [2.0, 0.5, 1.0])
    assert real_roots(terms) == pytest.approx([root], abs=1e-12)


def test_a_constant_has_no_root() -> None:
    assert real_roots(np.array([1.0, 0.0, 0.0, 0.0])) == []
