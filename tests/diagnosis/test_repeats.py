"""Equal readings of what stands still tell as much as one of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.diagnosis.data.repeats import distinct

STEP = 0.5


def rounded(values):
    return STEP * np.round(values / STEP)


def test_of_a_rest_one_reading_is_left():
    moving = rounded(np.linspace(0.0, 40.0, 100))
    rest = np.full(80, moving[-1])
    kept = distinct(np.concatenate([moving, rest]))
    assert kept[:98].all()
    assert kept[98:].sum() <= 3


def test_what_moves_on_slowly_is_kept():
    # a level lasts for 20 samples, and the roundings run through a whole step
    values = rounded(np.arange(400) * STEP / 20.0)
    kept = distinct(values)
    assert kept[20:-20].all()


def test_noise_that_moves_the_reading_keeps_it():
    noise = np.random.default_rng(2).normal(0.0, 0.6 * STEP, 500)
    assert distinct(rounded(noise)).mean() > 0.98


def test_what_was_not_read_is_not_kept_and_parts_no_rest():
    values = np.full(60, 3.0)
    values[1::2] = np.nan
    kept = distinct(values)
    assert kept.sum() == 1
    assert not kept[1::2].any()


def test_the_rounding_of_a_place_counts_once():
    """The squares of the errors of rests, in the step's noise, sum to one a rest."""
    rng = np.random.default_rng(7)
    # far apart, so that none lies a step from the one before
    places = (4.0 * rng.permutation(400) + rng.uniform(0.0, 1.0, 400)) * STEP
    true = np.repeat(places, 100)
    read = rounded(true)
    error = (read - true) / (STEP / np.sqrt(12.0))
    kept = distinct(read)
    assert kept.sum() == pytest.approx(places.size, rel=0.05)
    # a mean of squares that scatters by the number of places, not of readings, and counts them
    assert np.mean(error[kept] ** 2) == pytest.approx(1.0, abs=4.0 * np.sqrt(0.8 / places.size))


@given(st.lists(st.integers(0, 3), max_size=80))
def test_every_level_that_is_read_is_still_there(levels):
    values = np.array(levels, dtype=float)
    kept = distinct(values)
    assert set(values[kept]) == set(values)
