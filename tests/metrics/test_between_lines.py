"""Noise and transients between the lines of a record of whole periods."""

import numpy as np
import pytest
from scipy.stats import t as students

from eha_bench.metrics.between_lines import between_lines
from eha_bench.metrics.harmonic_fit import harmonic_fits
from eha_bench.metrics.ringing import Ringing

RATE, FREQUENCY, PERIODS = 1000.0, 5.0, 6
TIME = np.arange(int(RATE * PERIODS / FREQUENCY)) / RATE
SINE = np.sin(2 * np.pi * FREQUENCY * TIME)


def fitted(extra):
    return harmonic_fits(TIME, (SINE + extra)[:, None], FREQUENCY, PERIODS)[0]


@pytest.mark.parametrize(
    "transient",
    [
        0.5 * np.exp(-TIME / 0.3),
        0.3 * np.exp(-TIME / 0.5) * np.sin(2 * np.pi * 6.3 * TIME + 1.0),
        0.2 * np.exp(-2 * TIME) * np.cos(2 * np.pi * 4.4 * TIME),
    ],
)
def test_a_transient_is_taken_off(transient):
    rng = np.random.default_rng(1)
    found = fitted(transient + 1e-4 * rng.normal(size=TIME.size))
    plain = abs(found.phasors[0] + found.transient + 1j)  # a sine of phase 0 is -j
    left = abs(found.phasors[0] + 1j)
    assert left < 0.1 * plain
    assert left < 3.5 * np.sqrt(2.0 * found.fundamental_variance)


def test_the_variance_is_that_of_the_scatter_white_and_not():
    rng = np.random.default_rng(2)
    for slope in (0.0, 1.0):
        errors, claimed = [], []
        for _ in range(300):
            noise = rng.normal(size=TIME.size)
            if slope:
                noise = np.cumsum(noise) * 0.1
                noise -= np.linspace(noise[0], noise[-1], noise.size)
            found = fitted(0.05 * noise)
            errors.append(found.phasors[0] + 1j)
            claimed.append(found.fundamental_variance)
        scatter = 0.5 * np.mean(np.abs(errors) ** 2)
        assert np.mean(claimed) == pytest.approx(scatter, rel=0.3)


def test_a_record_without_free_lines_knows_nothing():
    time = np.arange(10) / RATE
    under = between_lines(time, np.zeros((10, 2)), 100.0, 1, 4)
    assert [found.freedom for found in under] == [0.0, 0.0]


def test_what_the_lines_hardly_show_is_averaged_over():
    # earlier periods say what they can of it: neither always taken off nor never
    rng = np.random.default_rng(3)
    held = []
    for _ in range(400):
        size = 0.03 * rng.uniform(0.0, 1.0)
        transient = size * np.exp(-4.0 * TIME) * np.sin(2 * np.pi * 5.6 * TIME)
        (alone,) = harmonic_fits(TIME, transient[:, None], FREQUENCY, PERIODS)
        under = alone.phasors[0] + alone.transient
        before = Ringing(under * rng.normal(1.0, 0.3), 0.3 * abs(under))
        data = (SINE + transient + 0.05 * rng.normal(size=TIME.size))[:, None]
        (found,) = harmonic_fits(TIME, data, FREQUENCY, PERIODS, [before])
        reach = students.ppf(0.975, found.freedom) * np.sqrt(found.fundamental_variance)
        held += [abs((found.phasors[0] + 1j).real) <= reach]
    assert 0.915 <= np.mean(held) <= 0.985  # 95 %, three standard errors of 400
