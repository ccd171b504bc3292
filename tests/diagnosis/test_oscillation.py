"""What swings is told from noise, of any size and from sample to sample alike."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.oscillation import LOUD, oscillation
from eha_bench.diagnosis.fit.thresholds import DEFAULT


def resonant(generator: np.random.Generator, turn: float, kept: float) -> FloatArray:
    """Return what white noise makes of a resonance at `turn` rad a sample, of variance 1."""
    poles = [1.0, -2.0 * kept * np.cos(turn), kept**2]
    out = lfilter([1.0], poles, generator.standard_normal(1200))[200:]
    return np.asarray(out / np.std(out))


@pytest.mark.parametrize("turn", [0.4, 1.6, 2.4])
def test_a_resonance_that_is_missing_swings(turn: float) -> None:
    generator = np.random.default_rng(0)
    parts = [generator.standard_normal(1000) + resonant(generator, turn, 0.95) for _ in range(4)]
    assert oscillation(parts) > 2.0 * DEFAULT.structure


@pytest.mark.parametrize("size", [1.0, 1.5, 4.0])
def test_white_noise_of_any_size_does_not_swing(size: float) -> None:
    """The largest of a hundred frequencies' powers, in two hundred residuals."""
    generator = np.random.default_rng(1)
    found = [oscillation([*size * generator.standard_normal((4, 500))]) for _ in range(200)]
    assert max(found) < DEFAULT.structure


def test_what_is_hardly_more_than_noise_is_not_asked() -> None:
    swing = np.sin(np.arange(4000))
    assert oscillation([np.sqrt(1.9 * LOUD) * swing]) == 0.0
    assert oscillation([np.sqrt(2.1 * LOUD) * swing]) > DEFAULT.structure


def test_noise_that_grows_with_the_slope_does_not_swing() -> None:
    """Late stamps: white from sample to sample, and larger where the signal moves."""
    generator = np.random.default_rng(2)
    slope = 3.0 * np.abs(np.sin(0.05 * np.arange(1000)))
    found = [
        oscillation([*((1.0 + slope) * generator.standard_normal((4, 1000)))]) for _ in range(50)
    ]
    assert max(found) < DEFAULT.structure


def test_too_little_swings_by_chance_alone() -> None:
    assert oscillation([2.0 * np.sin(np.arange(200))]) == 0.0
