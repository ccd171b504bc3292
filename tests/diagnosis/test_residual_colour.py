"""Noise read from what a model leaves: right in level and colour, also beside what it lacks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from eha_bench.diagnosis.data.colour import Colour
from eha_bench.diagnosis.fit.residual_colour import (
    noise_of_stretches,
    same_noise,
    share_shown,
    swings,
)

STRETCHES, SAMPLES = 200, 64


def _noise(generator: np.random.Generator, a: float) -> np.ndarray:
    """Noise of standard deviation 1 behind a first-order low-pass filter, (stretches, samples)."""
    white = generator.standard_normal((STRETCHES, SAMPLES))
    white[:, 1:] *= np.sqrt(1.0 - a * a)
    return lfilter([1.0], [1.0, -a], white, axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("a", [0.0, 0.4, 0.8])
def test_level_and_colour_of_noise_alone(a: float) -> None:
    level, colour = noise_of_stretches(list(_noise(np.random.default_rng(1), a)))
    assert level == pytest.approx(1.0, rel=0.06)
    assert (colour is not None) == (a > 0.0)
    if colour is not None:
        assert colour.correlations(2)[1] == pytest.approx(a, abs=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("a", [0.0, 0.4])
def test_what_the_model_lacks_in_a_third_of_the_stretches_is_no_noise(a: float) -> None:
    generator = np.random.default_rng(2)
    own = _noise(generator, a)
    own[: STRETCHES // 3] += 5.0 * np.sin(np.linspace(0.0, 20.0, SAMPLES))
    level, _ = noise_of_stretches(list(own))
    # a lower quantile is of noise still, only a higher one of what is noise: a few percent too much
    assert 0.95 < level < 1.15


def test_a_coarse_resolution_adds_to_the_noise_in_squares() -> None:
    generator = np.random.default_rng(3)
    step = 3.0
    slow = np.cumsum(generator.uniform(0.05, 0.3, (STRETCHES, 1)) * np.ones(SAMPLES), axis=1)
    read = step * np.round((slow + _noise(generator, 0.0)) / step)
    level, _ = noise_of_stretches(list(read - slow))
    assert level == pytest.approx(np.sqrt(1.0 + step**2 / 12.0), rel=0.08)


@pytest.mark.parametrize("a", [0.0, 0.6])
def test_noise_is_as_loud_in_every_run(a: float) -> None:
    colour = Colour((a,)) if a else None
    for seed in range(20):
        own = list(_noise(np.random.default_rng(seed), a))
        assert same_noise([own[:60], own[60:100], own[100:196], own[196:]], colour)


def test_what_follows_a_run_is_louder_in_some_runs() -> None:
    """Noise of 1, and beside it an error as large in one run, half as large in another."""
    generator = np.random.default_rng(5)
    own = _noise(generator, 0.0)
    error = np.sin(np.linspace(0.0, 25.0, SAMPLES) + generator.uniform(0, 6, (STRETCHES, 1)))
    own[:70] += 1.4 * error[:70]
    own[70:130] += 0.7 * error[70:130]
    assert not same_noise([list(own[:70]), list(own[70:130]), list(own[130:])], None)


def test_a_few_stretches_of_one_run_do_not_show_the_noise_of_all() -> None:
    """A log that loses samples at 100 Hz: whole stretches are left in the run that stands still."""
    own = list(_noise(np.random.default_rng(6), 0.0))
    samples = {"hold": 700, "chirp": 1300, "steps": 2000}
    few = {"hold": own[:7], "chirp": own[7:9], "steps": own[9:12]}
    assert share_shown(few, samples) == pytest.approx(700 / 4000)
    assert share_shown({**few, "steps": own[9:20]}, samples) == pytest.approx(2700 / 4000)


def test_a_filter_does_not_swing_and_a_resonance_does() -> None:
    # a = 2 r cos(w), -r^2: a pole pair at a sixth of the sampling frequency's turn
    radius = 0.95
    second = -(radius**2)
    first = 2 * radius * np.cos(np.pi / 3) / (1 - second)
    assert swings(Colour((float(first), second)))
    assert not swings(Colour((0.8,)))
    assert not swings(Colour((0.5, 0.1, 0.05)))
    assert not swings(Colour((-0.5,)))
    assert not swings(None)
