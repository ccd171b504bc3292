"""What stands still because it does is no fault of a sensor."""

from __future__ import annotations

import numpy as np

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
