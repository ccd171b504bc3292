"""What stands still because it does is not a fault of a sensor."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from eha_bench.diagnosis.data.noise import quantum_of, sharp_noise_of
from eha_bench.diagnosis.data.stuck import stuck

TIME = np.arange(0.0, 8.0, 1e-3)


def _beyond_play(rod: np.ndarray, gap: float) -> np.ndarray:
    read = np.empty(rod.size)
    at = rod[0]
    for k, x in enumerate(rod):
        at = min(max(at, x - gap / 2), x + gap / 2)
        read[k] = at
    return read


def test_a_reading_beyond_a_play_rests_at_every_reversal() -> None:
    rod = 0.02 * np.sin(2 * np.pi * TIME) + 0.003 * np.sin(2.3 * TIME)
    position = _beyond_play(rod, 1e-4)
    velocity = np.concatenate([[0.0], np.diff(position) / 1e-3])
    assert (np.diff(position) == 0.0).any()
    assert not stuck(position, 0.0).any()
    assert not stuck(velocity, 0.0).any()


def test_a_speed_that_sticks_at_its_reversals_stands_still() -> None:
    speed = np.sin(2 * np.pi * TIME)
    speed = np.sign(speed) * np.maximum(np.abs(speed) - 0.05, 0.0)
    assert not stuck(speed, 0.0).any()


def test_a_speed_that_drops_out_to_nothing_does_not() -> None:
    noise = 0.01 * np.random.default_rng(0).standard_normal(TIME.size)
    speed = 10.0 + np.sin(2 * np.pi * TIME) + noise
    speed[3000:3012] = 0.0
    found = stuck(speed, 0.0)
    assert found[3000:3012].all()
    assert found.sum() == 12


def _quantised(values: np.ndarray, step: float) -> np.ndarray:
    return np.rint(values / step) * step


def _from_rest_to_rest() -> np.ndarray:
    """Return what a servo's encoder reads at 50 Hz, in its steps: eight steps of 1.2 s each."""
    time = 0.02 * np.arange(60)
    levels = [0.0, 261.0, 522.0, 130.0, -196.0, -391.0, 65.0, 98.0, 326.0]
    return np.concatenate(
        [
            # after a push of friction it creeps on by one step
            np.rint(now + (was - now) * np.exp(-time / 0.06)) + (time > 0.5)
            for was, now in pairwise(levels)
        ]
    )


def test_a_servo_that_rests_at_every_level_is_no_stuck_sensor() -> None:
    read = _from_rest_to_rest()
    step = quantum_of(read)
    assert step == 1.0  # most of the levels between are never read
    assert not stuck(read, step, sharp_noise_of(read)).any()


def test_a_noisy_sensor_that_freezes_at_three_levels_is_stuck() -> None:
    wide = np.random.default_rng(1).standard_normal(480)
    read = np.rint(_from_rest_to_rest() + 2.0 * wide)
    for first in (70, 190, 310):
        read[first : first + 45] = read[first]
    found = stuck(read, quantum_of(read), sharp_noise_of(read))
    assert all(found[first : first + 45].all() for first in (70, 190, 310))


def test_a_machine_that_stalls_is_no_stuck_sensor() -> None:
    """An encoder finer than its noise reads the same for as long as the machine is held."""
    angle = np.cumsum(np.where((TIME > 2.0) & (TIME < 4.0), 0.0, 1.0 + np.sin(3.0 * TIME))) * 1e-3
    read = _quantised(angle, 1e-5)
    assert (np.diff(read)[2100:3900] == 0.0).all()
    assert not stuck(read, 1e-5, 0.0).any()
    # with noise that would have moved it, it is
    noisy = _quantised(angle + 3e-5 * np.random.default_rng(0).standard_normal(TIME.size), 1e-5)
    noisy[2000:4000] = noisy[2000]
    assert stuck(noisy, 1e-5, 3e-5)[2000:4000].all()


def test_an_encoder_that_latches_and_jumps_is_stuck() -> None:
    read = _quantised(0.1 * TIME, 1e-5)
    read[3000:3100] = read[3000]
    assert stuck(read, 1e-5, 0.0)[3000:3100].all()


def test_a_clipped_reading_is_not_a_flat_one() -> None:
    wave = 1.5 * np.sin(2 * np.pi * TIME)
    clipped = np.clip(wave, -1.0, 1.0)
    assert stuck(clipped, 0.0)[np.abs(wave) > 1.0].all()
    # a speed that saturates by itself bends into its end, and stays as long
    flat = _quantised(np.tanh(6.0 * np.sin(2 * np.pi * TIME)), 1e-3)
    assert (np.abs(flat) == np.abs(flat).max()).sum() > 1000
    assert not stuck(flat, 1e-3, 0.0).any()
