"""Settling time by two decaying modes, where noise hides the band."""

import math

import pytest


@pytest.mark.parametrize("damping", [0.4, 0.6])
def test_the_time_is_that_of_the_modes_from_the_edge_on(kit, damping):
    """Of the pair of poles itself, without noise; the tail is fitted from 90 % of the step on."""
    natural = 2.0 * math.pi
    system = ([natural**2], [1.0, 2.0 * damping * natural, natural**2])
    recording, trial = kit.step(system, period=0.01, hold=8.0)
    truth = kit.measure("settling_time", recording, trial).value
    for seed in range(3):
        found = kit.measure("settling_time", kit.noisy(recording, 0.02, seed), trial)
        assert "two modes" in found.reason
        assert found.value == pytest.approx(truth, abs=0.03)
