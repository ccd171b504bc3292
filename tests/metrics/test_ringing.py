"""What a transient still adds to the settled periods, by the periods before."""

import numpy as np
import pytest

from eha_bench.metrics.ringing import ringing

FACTOR = 0.3 * np.exp(0.4j)
PERIODS = np.arange(8)
SETTLED = 5


@pytest.fixture
def noise():
    return np.random.default_rng(1).normal(size=(2, 8)) @ np.diag(np.full(8, 1e-4))


def test_a_decay_by_one_factor_is_foreseen(noise):
    phasors = 1.0 - 0.5j + 0.4 * FACTOR**PERIODS + noise[0] + 1j * noise[1]
    left = 0.4 * np.mean(FACTOR ** PERIODS[-SETTLED:])
    found = ringing(phasors, SETTLED)
    assert abs(found.phasor - left) < 0.2 * abs(left)
    assert 0.3 * abs(found.phasor) <= found.sd <= abs(found.phasor)


def test_a_delay_within_the_first_period_does_not_matter(noise):
    phasors = 1.0 + 0.4 * FACTOR**PERIODS + noise[0]
    late = phasors.copy()
    late[0] = 0.1
    assert ringing(late, SETTLED) == ringing(phasors, SETTLED)


@pytest.mark.parametrize("count", [3, 8])
def test_noise_alone_rings_not(count, noise):
    found = ringing((1.0 + noise[0] + 1j * noise[1])[:count], 2)
    assert found.phasor == 0.0
    assert found.sd == 0.0


def test_what_does_not_decay_is_no_transient():
    assert ringing(1.0 + 0.1 * 0.95**PERIODS + 0j, SETTLED).phasor == 0.0
