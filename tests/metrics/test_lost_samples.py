"""Scores of recordings with lost samples hold what may have happened in between, or say so."""

import math
from dataclasses import replace

import numpy as np
import pytest

from eha_bench.core.recording import Recording

SIZE, EDGE = 10e6, 0.1  # Pa, s
TIME = np.arange(900) / 1000


@pytest.fixture
def overshooting(kit):
    """A step of a second order (damping 0.3, 100 rad/s): overshoot 37.2 %, settled after 112 ms."""
    return step_of(kit, second_order)


def second_order(since):
    damping, natural = 0.3, 100.0
    damped = natural * math.sqrt(1 - damping**2)
    swing = np.cos(damped * since) + damping * natural / damped * np.sin(damped * since)
    return 1.0 - np.exp(-damping * natural * since) * swing


def step_of(kit, shape, noise=1e3, seed=3):
    since = np.clip(TIME - EDGE, 0.0, None)
    values = SIZE * shape(since) + noise * np.random.default_rng(seed).normal(size=TIME.size)
    reference = np.where(EDGE - 1e-9 <= TIME, SIZE, 0.0)
    trial = kit.trial(kit.Steps((EDGE,), (0.0, SIZE), 0.9), 0.9)
    recording = Recording(
        TIME, {"reference": reference, kit.channel: values}, metadata={"signal_start": "0.0"}
    )
    return recording, trial


def without(recording, start, stop):
    """The same recording without the samples from `start` to `stop`, s after the edge."""
    kept = (recording.time < EDGE + start) | (recording.time > EDGE + stop)
    values = {name: array[kept] for name, array in recording.values.items()}
    return replace(recording, time=recording.time[kept], values=values)


def test_an_overshoot_that_is_lost_is_no_pass(kit, overshooting):
    recording, trial = overshooting
    lossy = without(recording, 0.02, 0.06)
    for name, truth in (("overshoot", 0.3723), ("peak", 1.3723 * SIZE)):
        whole, found = kit.measure(name, recording, trial), kit.measure(name, lossy, trial)
        assert math.isfinite(whole.high)
        assert whole.low <= truth <= whole.high
        assert found.value < 0.9 * truth
        assert found.high == math.inf
        assert "at least this, samples are lost from 0.02 to 0.061 s" in found.reason
    time = kit.measure("peak_time", lossy, trial)
    assert time.low <= math.pi / (100.0 * math.sqrt(1 - 0.09)) <= time.high


def test_a_step_down_is_open_below(kit):
    recording, trial = step_of(kit, lambda since: 1.0 - second_order(since))
    trial = replace(trial, signal=kit.Steps((EDGE,), (SIZE, 0.0), 0.9))
    recording = recording.with_values({"reference": SIZE - recording["reference"]})
    assert kit.measure("peak", without(recording, 0.02, 0.06), trial).low == -math.inf


def test_what_leaves_its_band_while_nothing_is_read_may_settle_later(kit, overshooting):
    recording, trial = overshooting
    whole = kit.measure("settling_time", recording, trial)
    found = kit.measure("settling_time", without(recording, 0.3, 0.4), trial)
    assert found.value == pytest.approx(whole.value, rel=0.05)
    assert found.low == pytest.approx(whole.low, rel=0.05)
    assert found.high == pytest.approx(0.401, abs=2e-3)
    assert "samples are lost from 0.299 to 0.401 s" in found.reason


@pytest.mark.parametrize(("start", "stop"), [(0.3, 0.3025), (0.3, 0.307)])
def test_few_lost_samples_hide_nothing(kit, overshooting, start, stop):
    """Three are what neighbours stand for; in eight the response gets nowhere."""
    recording, trial = overshooting
    lossy = without(recording, start, stop)
    for name in ("overshoot", "peak", "settling_time", "peak_time"):
        whole, found = kit.measure(name, recording, trial), kit.measure(name, lossy, trial)
        assert found.high == pytest.approx(whole.high, rel=0.02)


def test_an_error_that_is_lost_has_no_upper_end(kit, overshooting):
    recording, trial = overshooting
    lossy = without(recording, 0.0, 0.06)
    found = kit.measure("tracking_max", lossy, trial)
    assert found.value < SIZE < found.high == math.inf
    assert "at least this, samples are lost" in found.reason
    whole, rms = (kit.measure("tracking_rms", one, trial) for one in (recording, lossy))
    assert rms.value < whole.low
    assert whole.high > rms.high > 1.2 * rms.value  # as large as the largest that was read


@pytest.mark.parametrize("ramp", [1e-3, 5e-3, 20e-3])
@pytest.mark.parametrize("noise", [0.0, 2e3])
def test_the_corner_of_a_plateau_is_no_peak_beyond_it(kit, ramp, noise):
    """A response that is held 30 % above its end: no polynomial follows the corner."""

    def held(since):
        own = np.interp(since, [0.3 - ramp, 0.3, 0.4, 0.4 + ramp], [0.0, 0.3, 0.3, 0.0])
        return 1.0 - np.exp(-since / 0.02) + own

    recording, trial = step_of(kit, held, noise)
    for name, truth in (("overshoot", 0.3), ("peak", 1.3 * SIZE)):
        found = kit.measure(name, recording, trial)
        assert found.low <= truth <= found.high
        assert found.value == pytest.approx(truth, abs=0.003 * truth / 0.3)


@pytest.fixture
def two_steps(kit):
    """A step that overshoots by 37 %, and 0.7 s later one that does not; both settle."""
    time = np.arange(1600) / 1000
    first, second = (np.clip(time - at, 0.0, None) for at in (0.1, 0.8))
    values = SIZE * (second_order(first) - 0.5 * (1.0 - np.exp(-second / 0.02)))
    values += 1e3 * np.random.default_rng(6).normal(size=time.size)
    reference = SIZE * ((time >= 0.1 - 1e-9) - 0.5 * (time >= 0.8 - 1e-9))
    trial = kit.trial(kit.Steps((0.1, 0.8), (0.0, SIZE, 0.5 * SIZE), 1.6), 1.6)
    metadata = {"signal_start": "0.0"}
    return Recording(time, {"reference": reference, kit.channel: values}, metadata=metadata), trial


def test_a_gap_after_another_edge_hides_no_overshoot_that_was_read(kit, two_steps):
    recording, trial = two_steps
    found = kit.measure("overshoot", without(recording, 0.71, 0.76), trial)
    assert found.value == pytest.approx(0.3723, abs=1e-3)
    assert found.high == math.inf
    assert "worst of 2 edges, at 0.1 s; it may be worse at the edge at 0.8 s" in found.reason


def test_a_step_may_settle_later_after_another_edge(kit, two_steps):
    recording, trial = two_steps
    found = kit.measure("settling_time", without(recording, 1.0, 1.1), trial)
    assert found.value == pytest.approx(0.1123, abs=2e-3)
    assert found.high == pytest.approx(0.401, abs=2e-3)


def test_what_has_settled_on_both_sides_has_no_extreme_in_between(kit, overshooting):
    recording, trial = overshooting
    lossy = without(recording, 0.5, 0.56)
    for name in ("overshoot", "peak", "undershoot", "peak_time"):
        whole, found = kit.measure(name, recording, trial), kit.measure(name, lossy, trial)
        assert found.high == pytest.approx(whole.high, rel=0.02, abs=1e-4)
