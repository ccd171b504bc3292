"""Ticks: round, within the axis, and labelled so that the label is the value."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from eha_bench.report.ticks import decimals_of, ticks_between

ENDS = st.floats(-1e7, 1e7, allow_nan=False)
SPANS = st.floats(1e-4, 1e7)


@pytest.mark.parametrize(
    ("step", "decimals"),
    [(2.5, 1), (0.25, 2), (250.0, 0), (1.0, 0), (0.02, 2), (1e-7, 7), (2.5e-7, 8), (5e6, 0)],
)
def test_a_step_needs_its_digits(step: float, decimals: int) -> None:
    assert decimals_of(step) == decimals


def test_steps_of_two_and_a_half_are_not_rounded_away() -> None:
    # 9.8 / 4 = 2.45: the next round step is 2.5
    assert ticks_between(0.0, 9.8, 4).labels == ("0.0", "2.5", "5.0", "7.5")


@example(9.5e6, 5.5e5, 11)
@given(ENDS, SPANS, st.integers(3, 14))
def test_labels_tell_the_values_and_lie_within(low: float, span: float, most: int) -> None:
    high = low + span
    if not (high - low) > 1e-6 * max(abs(low), abs(high)):
        return
    ticks = ticks_between(low, high, most)
    slack = 1e-6 * (high - low)
    assert 2 <= len(ticks.values) <= 2 * most + 1
    assert all(low - slack <= value <= high + slack for value in ticks.values)
    for value, label in zip(ticks.values, ticks.labels, strict=True):
        told = float(label.replace("\N{MINUS SIGN}", "-"))
        assert math.isclose(told, value, rel_tol=5e-3 if "e" in label else 1e-9, abs_tol=slack)
    assert len(set(ticks.labels)) == len(ticks.labels)
