"""The colour of noise: told where it is there, and never where noise is white."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import toeplitz
from scipy.signal import butter, lfilter

from eha_bench.diagnosis.data.colour import (
    Colour,
    _affordable_stretches,
    _minus_twice_log,
    _parabolas,
    _standard_errors,
    colour_of,
)
from eha_bench.diagnosis.data.noise import noise_of
from eha_bench.diagnosis.fit.residual_colour import swings
from eha_bench.diagnosis.fit.whitening import whitening

partials = st.lists(st.floats(-0.95, 0.95), min_size=1, max_size=4).map(tuple)


def _noise(generator, a: float, shape: tuple[int, int]) -> np.ndarray:
    """Noise of standard deviation 1 behind a first-order low-pass filter, (stretches, n)."""
    white = generator.standard_normal(shape)
    white[:, 1:] *= np.sqrt(1.0 - a * a)
    return lfilter([1.0], [1.0, -a], white, axis=1)


def test_of_a_first_order_filter_correlations_are_powers() -> None:
    assert Colour((0.7,)).correlations(6) == pytest.approx(0.7 ** np.arange(6))


def test_of_a_second_order_process_they_are_yule_and_walkers() -> None:
    # x = 0.6 of the last + 0.3 of the one before: r1 = 0.6 / (1 - 0.3), r2 = 0.6 r1 + 0.3
    colour = Colour((0.6 / 0.7, 0.3))
    assert colour.predictors[-1][0] == pytest.approx([0.6, 0.3])
    first = 0.6 / 0.7
    second = 0.6 * first + 0.3
    expected = [1.0, first, second, 0.6 * second + 0.3 * first]
    assert colour.correlations(4) == pytest.approx(expected)


def test_cosines_share_the_variance_as_the_spectrum_says() -> None:
    sizes = Colour((0.7, -0.2)).amplitudes(4000)
    assert np.mean(sizes**2) == pytest.approx(1.0, rel=1e-3)
    # of a first-order filter the density at no frequency is (1 + a) / (1 - a)
    assert Colour((0.7,)).amplitudes(10)[0] == pytest.approx(np.sqrt(1.7 / 0.3))


@settings(deadline=None, max_examples=30)
@given(partials, st.sets(st.integers(0, 29), max_size=8))
def test_a_window_is_white_afterwards_whatever_is_missing(partial, missing) -> None:
    valid = np.ones((30, 2), dtype=np.bool_)
    valid[list(missing), 0] = False
    colour = Colour(partial)
    matrix = whitening(np.arange(30) * 1e-3, valid, [colour, None])
    assert matrix is not None
    covariance = np.zeros((60, 60))
    covariance[::2, ::2] = toeplitz(colour.correlations(30))
    covariance[1::2, 1::2] = np.eye(30)
    covariance = covariance[np.ix_(valid.ravel(), valid.ravel())]
    white = matrix @ covariance @ matrix.T
    # every reading keeps its size; without gaps all of them are independent
    assert np.diag(white) == pytest.approx(np.ones(len(white)), abs=1e-6)
    if not missing:
        assert white == pytest.approx(np.eye(60), abs=1e-6)


def test_a_gap_of_the_clock_is_forgotten_across() -> None:
    time = np.arange(10) * 1e-3
    time[5:] += 0.1
    matrix = whitening(time, np.ones((10, 1), dtype=np.bool_), [Colour((0.5,))])
    assert matrix is not None
    dense = matrix.toarray()
    assert dense[5, 4] == 0.0
    assert dense[5, 5] == 1.0
    assert dense[6, 5] == pytest.approx(-0.5 / np.sqrt(0.75))


def test_white_channels_need_nothing() -> None:
    assert whitening(np.arange(4.0), np.ones((4, 2), dtype=np.bool_), [None, None]) is None


@pytest.mark.parametrize("step", [0.0, 0.5, 1.5])
def test_standard_errors_are_those_of_white_noise_however_coarse(step) -> None:
    generator = np.random.default_rng(3)
    parabola = np.linspace(0.0, 0.7, 128) ** 2
    found = []
    for _ in range(200):
        stretches = generator.standard_normal((5, 128)) + generator.normal() + parabola
        if step:
            stretches = np.round(stretches / step) * step
        found.append(_standard_errors(list(stretches)))
    # mean and standard deviation of 200 are known to 0.07 and 0.05
    assert abs(np.mean(found)) < 0.2
    assert 0.85 < np.std(found) < 1.15
    assert max(found) < 4.26


def test_what_only_flickers_between_two_steps_tells_nothing() -> None:
    drift = np.linspace(0.0, 0.6, 128)
    flicker = [np.round(drift + 0.05 * np.sin(k)) for k in range(10)]
    assert colour_of(flicker) is None
    assert colour_of([np.full(128, 3.0)] * 10) is None


@pytest.mark.parametrize("a", [0.37, 0.72])
def test_a_low_pass_filter_is_told_to_its_error(a) -> None:
    generator = np.random.default_rng(int(100 * a))
    parabola = np.linspace(-1.0, 1.0, 64) ** 2
    found = [colour_of([*(_noise(generator, a, (10, 64)) + parabola)]) for _ in range(8)]
    assert all(found)
    first = np.array([colour.correlations(2)[1] for colour in found if colour])
    # of n samples the error is sqrt((1 - a^2) / n)
    error = np.sqrt((1.0 - a * a) / 640.0)
    assert abs(first.mean() - a) < 4.0 * error / np.sqrt(8.0)
    assert 0.4 * error < first.std() < 1.8 * error


def test_too_few_samples_tell_no_colour() -> None:
    assert colour_of([*_noise(np.random.default_rng(0), 0.9, (1, 128))]) is None


def test_all_of_the_noise_is_seen_once_its_colour_is_known() -> None:
    a = 0.72
    values = 3.0 * _noise(np.random.default_rng(4), a, (1, 20000))[0]
    values += 50.0 * np.sin(np.arange(20000) * 2e-3)
    assert noise_of(values) < 0.7 * 3.0
    assert noise_of(Colour((a,)).whitened(values)) == pytest.approx(3.0, rel=0.03)


@pytest.mark.slow
def test_long_stretches_are_fitted_in_parts_and_not_all_of_many() -> None:
    generator = np.random.default_rng(6)
    long = [*_noise(generator, 0.9, (8, 1280))]
    assert {part.size for part in _affordable_stretches(long)} == {256}
    assert len(_affordable_stretches([np.arange(32.0)] * 1000)) == 300
    found = colour_of(long)
    assert found is not None
    assert found.correlations(2)[1] == pytest.approx(0.9, abs=0.02)


def test_a_mean_of_noise_that_remembers_is_off_by_more() -> None:
    assert Colour((0.7,)).loudness_of_mean(400) == pytest.approx(np.sqrt(1.7 / 0.3))
    # but never by more than one sample
    assert Colour((0.7,)).loudness_of_mean(1) == 1.0


@pytest.mark.parametrize("cutoff", [0.2, 0.4, 0.6])
@pytest.mark.parametrize("order", [1, 2, 4])
def test_all_of_the_noise_behind_a_sampled_filter_is_seen(order, cutoff) -> None:
    """A Butterworth filter has a zero at half the sampling rate, and an autoregression none."""
    generator = np.random.default_rng(11)
    numerator, denominator = butter(order, cutoff)
    read = lfilter(numerator, denominator, generator.standard_normal(60_000))[1000:]
    read /= read.std()
    colour = colour_of([read[k : k + 128] for k in range(0, 40 * 128, 128)])
    assert colour is not None
    new = colour.whitened(read)
    assert noise_of(new) / colour.sharpness == pytest.approx(1.0, abs=0.1)
    assert not swings(colour)


@pytest.mark.parametrize("count", [2, 3, 40])
def test_what_is_new_in_noise_has_the_squares_of_its_inverse_covariance(count) -> None:
    """Also over fewer samples than the process remembers."""
    colour = Colour((0.7, -0.4, 0.2))
    values = np.random.default_rng(3).normal(size=(count, 5))
    white = colour.whitened_from_first(values)
    covariance = toeplitz(colour.correlations(count))
    expected = np.einsum("ij,ij->j", values, np.linalg.solve(covariance, values))
    assert np.sum(white**2, axis=0) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("partial", [(0.9,), (0.7, -0.4, 0.2), (0.5, 0.0, 0.3, -0.2, 0.98)])
def test_a_likelihood_is_that_of_whole_covariances(partial) -> None:
    """Of tables of other sizes, one of them hardly longer than what the process remembers."""
    colour = Colour(partial)
    generator = np.random.default_rng(5)
    tables = [generator.normal(size=shape) for shape in ((90, 4), (6, 3))]
    square, volume, count = 0.0, 0.0, 0
    for table in tables:
        size, columns = table.shape
        basis = _parabolas(size)
        inverse = np.linalg.inv(toeplitz(colour.correlations(size)))
        inner = basis.T @ inverse @ basis
        beside = inverse - inverse @ basis @ np.linalg.solve(inner, basis.T @ inverse)
        square += np.einsum("ij,ik,kj->", table, beside, table)
        volume += columns * (np.linalg.slogdet(inner)[1] - np.linalg.slogdet(inverse)[1])
        count += columns * (size - 3)
    expected = volume + count * np.log(square / count)
    assert _minus_twice_log(colour, tables) == pytest.approx(expected, rel=1e-9)
