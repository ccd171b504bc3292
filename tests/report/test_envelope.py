"""Envelopes keep what a curve shows."""

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from eha_bench.report.envelope import envelope_indices

curves = arrays(
    np.float64,
    st.integers(1, 400),
    elements=st.one_of(st.floats(-1e6, 1e6), st.just(float("nan"))),
)


@given(curves, st.integers(4, 120))
def test_envelope_keeps_extremes_ends_and_order(values: np.ndarray, points: int) -> None:
    keep = envelope_indices(values, points)
    assert np.all(np.diff(keep) > 0)
    assert keep[0] == 0
    assert keep[-1] == values.size - 1
    assert keep.size <= max(points, 4) // 2 * 3 + 2
    if np.isfinite(values).any():
        assert np.nanmin(values[keep]) == np.nanmin(values)
        assert np.nanmax(values[keep]) == np.nanmax(values)
    assert np.isnan(values[keep]).any() == np.isnan(values).any()


@given(curves, st.integers(8, 120))
def test_every_stretch_keeps_its_extremes(values: np.ndarray, points: int) -> None:
    if values.size <= points:
        return
    keep = envelope_indices(values, points)
    borders = np.linspace(0, values.size, points // 2 + 1).astype(int)
    for start, stop in itertools.pairwise(borders):
        part = values[start:stop]
        kept = values[keep[(keep >= start) & (keep < stop)]]
        if np.isfinite(part).any():
            assert np.nanmin(kept) == np.nanmin(part)
            assert np.nanmax(kept) == np.nanmax(part)


def test_few_samples_stay_as_they_are() -> None:
    assert envelope_indices(np.arange(10.0), 10).tolist() == list(range(10))
    assert envelope_indices(np.zeros(0), 10).tolist() == []


def test_a_single_spike_survives() -> None:
    values = np.zeros(100_000)
    values[54_321] = 1.0
    assert 54_321 in envelope_indices(values, 200)
