"""Stamps beside a regular clock: which of both the readings follow."""

from __future__ import annotations

import numpy as np
import pytest

from eha_bench.diagnosis.data.clock import regular_clock

PERIOD = 1e-3


def _logged(*, late: float, stamps_are_true: bool, gaps: bool) -> tuple[np.ndarray, ...]:
    """Ticks, stamps and a noisy position of samples that reach the log late."""
    rng = np.random.default_rng(0)
    tick = np.arange(3000.0)
    stamps = tick * PERIOD + late * np.abs(rng.standard_normal(tick.size))
    taken = stamps if stamps_are_true else tick * PERIOD
    position = 0.02 * np.sin(5.0 * taken) + 4e-6 * rng.standard_normal(tick.size)
    kept = tick % 100 < (85 if gaps else 100)
    return tick[kept], stamps[kept] - stamps[0], position[kept]


@pytest.mark.parametrize("gaps", [False, True])
def test_what_was_sampled_regularly_is_put_back_on_its_clock(gaps: bool) -> None:
    tick, stamps, position = _logged(late=1e-4, stamps_are_true=False, gaps=gaps)
    found = regular_clock(stamps, [position])
    assert found is not None
    assert np.abs(found - tick * PERIOD).max() < 0.02 * PERIOD


@pytest.mark.parametrize("seed", range(4))
def test_a_clock_is_seen_where_stamps_scatter_by_an_eighth_of_its_period(seed: int) -> None:
    """One in a hundred samples lost; two in a row may lie next to the same tick."""
    rng = np.random.default_rng(seed)
    tick = np.arange(9000.0)[rng.random(9000) > 0.01]
    stamps = np.sort(tick * PERIOD + 0.12 * PERIOD * rng.standard_normal(tick.size))
    position = 0.02 * np.sin(20.0 * tick * PERIOD) + 1e-7 * rng.standard_normal(tick.size)
    found = regular_clock(stamps, [position])
    assert found is not None
    assert np.abs(found - found[0] - (tick - tick[0]) * PERIOD).max() < 0.02 * PERIOD


def test_what_comes_in_bursts_has_no_clock() -> None:
    bursts = np.concatenate([k + np.arange(80) * 1e-6 for k in range(40)])
    uneven = np.concatenate([bursts, 40.0 + np.arange(4000) * PERIOD])
    assert regular_clock(uneven, [np.sin(uneven)]) is None


@pytest.mark.parametrize("gaps", [False, True])
def test_stamps_that_the_readings_follow_are_kept(gaps: bool) -> None:
    _, stamps, position = _logged(late=1e-4, stamps_are_true=True, gaps=gaps)
    assert regular_clock(stamps, [position]) is None


def test_a_clock_that_drifts_or_is_regular_anyway_is_kept() -> None:
    rng = np.random.default_rng(1)
    position = rng.standard_normal(3000)
    for steps in (PERIOD * np.ones(3000), PERIOD + 1e-4 * rng.standard_normal(3000)):
        time = np.cumsum(steps) - steps[0]
        assert regular_clock(time, [position]) is None


def test_a_channel_that_stands_still_has_no_say() -> None:
    _, stamps, position = _logged(late=1e-4, stamps_are_true=True, gaps=False)
    still = np.full(position.size, 0.3)
    assert regular_clock(stamps, [position, still]) is None
    assert regular_clock(stamps, [still]) is None


def test_one_late_message_makes_no_missing_sample() -> None:
    tick = np.arange(3000.0)
    stamps = tick * PERIOD
    stamps[1500] += 0.6 * PERIOD
    noise = 4e-6 * np.random.default_rng(0).standard_normal(tick.size)
    found = regular_clock(stamps, [0.02 * np.sin(5.0 * tick * PERIOD) + noise])
    assert found is None or np.abs(found - tick * PERIOD).max() < 0.02 * PERIOD
