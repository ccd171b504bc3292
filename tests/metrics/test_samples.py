"""Spikes, gaps, resolution, clipping: what is replaced, what is said, and what is left alone."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.core.limit import AcceptanceLimit, Bounds
from eha_bench.core.score import ScoreStatus
from eha_bench.core.sensor import Sensor
from eha_bench.metrics.acceptance import judge
from eha_bench.metrics.outliers import spikes
from eha_bench.metrics.resolution import dithering, resolution_of, rounding_sd
from eha_bench.metrics.samples import samples

STIFF = ([1.0], [(1 / 70.0) ** 2, 2 * 0.5 / 70.0, 1.0])


@pytest.fixture
def noisy_step(kit):
    recording, trial = kit.step(STIFF, hold=0.6, initial=15e6, size=5e6)
    return kit.noisy(recording, 1e4, 3), trial


def changed(kit, recording, index, value):
    values = np.array(recording[kit.channel])
    values[index] = value
    return recording.with_values({kit.channel: values})


# --- spikes --------------------------------------------------------------------------------------


@pytest.mark.parametrize("index", [51, 80, 120, 131, 400, 698, 699])
def test_a_spike_moves_no_score_and_is_said(kit, noisy_step, index):
    recording, trial = noisy_step
    spiked = changed(kit, recording, index, 5e6)
    for name in ("rise_time", "overshoot", "settling_time", "steady_state_error"):
        clean, found = (kit.measure(name, item, trial) for item in (recording, spiked))
        assert found.value == pytest.approx(clean.value, rel=0.05, abs=2e3), found.reason
    assert "1 outlier(s) replaced" in kit.measure("peak", spiked, trial).reason
    assert "outlier" not in kit.measure("peak", recording, trial).reason


@pytest.mark.parametrize(
    "curve",
    [
        lambda t: (t > 0.1).astype(float),
        lambda t: np.maximum(t - 0.1, 0.0) * 30,
        lambda t: 1 - np.exp(-np.maximum(t - 0.1, 0.0) / 0.004),
        lambda t: np.sin(2 * np.pi * 180 * t),
        lambda t: np.exp(-(((t - 0.1) / 0.0015) ** 2)),
        lambda t: np.round(np.sin(20 * t), 1),
        lambda t: np.sign(np.sin(2 * np.pi * 47 * t)),
    ],
)
@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_what_a_system_can_do_is_no_spike(curve, noise):
    time = np.arange(400) / 1000.0
    values = curve(time) + noise * np.random.default_rng(1).normal(size=time.size)
    assert spikes(time, values, 0.0).size == 0


def test_white_noise_has_no_spikes():
    rng = np.random.default_rng(2)
    time = np.arange(1000.0)
    assert sum(spikes(time, rng.normal(size=1000), 0.0).size for _ in range(100)) == 0


# --- samples without a value ------------------------------------------------------------------


def test_a_gap_long_after_settling_removes_nothing(kit, noisy_step):
    recording, trial = noisy_step
    late = changed(kit, recording, 600, math.nan)
    for name in ("rise_time", "overshoot", "settling_time", "steady_state_error", "peak"):
        found = kit.measure(name, late, trial)
        assert found.value == pytest.approx(
            kit.measure(name, recording, trial).value, rel=0.02, abs=1e3
        )
        assert "1 sample(s) without a value not used, the first at 0.6 s" in found.reason


def test_a_long_gap_still_does(kit, noisy_step):
    recording, trial = noisy_step
    assert math.isnan(kit.measure("rise_time", changed(kit, recording, slice(600, 640), math.nan),
                                  trial).value)  # fmt: skip


def test_lost_samples_are_said_and_move_no_edge(kit, noisy_step):
    recording, trial = noisy_step
    kept = np.ones(len(recording), dtype=bool)
    kept[[100, 101, 300]] = False  # the edge's own sample among them
    values = {name: array[kept] for name, array in recording.values.items()}
    lossy = replace(recording, time=recording.time[kept], values=values)
    found = kit.measure("delay_time", lossy, trial)
    assert found.value == pytest.approx(kit.measure("delay_time", recording, trial).value, abs=2e-4)
    assert "3 sample(s) lost (0.46 %)" in found.reason


# --- resolution --------------------------------------------------------------------------------


@given(st.floats(1e-3, 1e5), st.floats(-1e6, 1e6), st.integers(0, 1000))
def test_the_step_of_a_sensor_is_seen(step, offset, seed):
    values = np.cumsum(np.random.default_rng(seed).normal(size=500))
    read = np.round(values / 0.3) * step + offset
    assert resolution_of(read) == pytest.approx(step, rel=1e-3)


def test_what_is_not_rounded_has_no_resolution():
    rng = np.random.default_rng(1)
    assert resolution_of(rng.normal(size=2000)) == 0.0
    assert resolution_of(np.zeros(100)) == 0.0
    assert resolution_of(np.repeat([0.0, 1.0], 200)) == 0.0
    assert resolution_of(np.repeat(rng.normal(size=20), 10)) == 0.0


@pytest.mark.parametrize("ratio", [0.0, 0.1, 0.2, 0.3, 0.5, 1.0])
def test_rounding_of_a_mean_by_the_noise_that_dithers_it(ratio):
    """The mean of rounded noise over levels of every kind, by numbers against the formula."""
    rng = np.random.default_rng(4)
    levels = rng.uniform(0.0, 1.0, 400)
    noise = ratio * rng.normal(size=(400, 4000))
    noise -= noise.mean(axis=1, keepdims=True)
    errors = np.round(levels[:, None] + noise).mean(axis=1) - levels
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(rounding_sd(1.0, ratio), abs=0.02)


def test_two_readings_tell_nothing_of_the_noise():
    assert dithering([np.repeat([0.0, 1.0], 50)], 1.0) == 0.0
    wide = np.round(np.random.default_rng(1).normal(0.0, 2.0, 4000))
    assert dithering([wide], 1.0) == pytest.approx(2.0, rel=0.05)


def test_a_resolution_is_in_the_interval(kit):
    recording, trial = kit.step(STIFF, hold=0.6, initial=15.0e6, size=5e6)
    rough = recording.with_values({kit.channel: np.round(recording[kit.channel] / 5e4) * 5e4})
    found = kit.measure("steady_state_error", rough, trial)
    assert found.high - found.low == pytest.approx(2 * 0.95 * 2.5e4, rel=0.02)
    assert [part.source for part in found.budget.parts] == ["resolution"]


def test_what_the_recording_says_of_its_sensor_counts(kit, noisy_step):
    recording, trial = noisy_step
    sensor = Sensor(resolution=2e5, uncertainty=3e4, relative=0.002).to_metadata(kit.channel)
    told = replace(recording, metadata={**recording.metadata, **sensor})
    own = samples(told, trial, kit.channel)
    assert (own.resolution, own.calibration(20e6)) == (2e5, pytest.approx(5e4))
    sources = {
        name: {part.source: part.standard for part in kit.measure(name, told, trial).budget.parts}
        for name in ("steady_state_error", "peak", "rise_time", "overshoot")
    }
    assert sources["steady_state_error"]["sensor"] == pytest.approx(5e4, rel=1e-3)
    assert sources["peak"]["sensor"] == pytest.approx(5.15e4, rel=1e-2)
    # an offset or a gain of the sensor moves no time and no share of the step
    assert "sensor" not in sources["rise_time"]
    assert "sensor" not in sources["overshoot"]
    assert all("resolution" in own for own in sources.values())
    plain, wider = (kit.measure("peak", item, trial) for item in (recording, told))
    assert wider.high - wider.low > 2 * (plain.high - plain.low)


def test_metadata_that_are_no_number_say_nothing():
    broken = {"sensor.force.resolution": "coarse", "sensor.force.uncertainty": "-1"}
    assert Sensor.of(broken, "force") == Sensor()


# --- notes ---------------------------------------------------------------------------------------


def test_clipping_is_said(kit, noisy_step):
    recording, trial = noisy_step
    clipped = recording.with_values({kit.channel: np.minimum(recording[kit.channel], 20.3e6)})
    reason = kit.measure("overshoot", clipped, trial).reason
    assert "clipped: " in reason
    assert "at exactly 2.03e+07 Pa" in reason
    # how far it went beyond is not known: at least this, and no time of a peak
    for name, level in (("overshoot", 0.06), ("peak", 20.3e6)):
        found = kit.measure(name, clipped, trial)
        assert "at least this, the sensor's end cut it off" in found.reason
        assert found.value == pytest.approx(level, rel=2e-2)
        assert found.low < found.value < found.high == math.inf
        truth = kit.measure(name, recording, trial).value
        assert judge(found, on(name, "<=", 2.0 * truth)) is ScoreStatus.UNDECIDED
        assert judge(found, on(name, "<=", 0.9 * level)) is ScoreStatus.FAILED
        assert judge(found, on(name, ">=", 0.9 * level)) is ScoreStatus.PASSED
        assert judge(found, on(name, ">=", 1.1 * level)) is ScoreStatus.UNDECIDED
    assert "the peak is clipped" in kit.measure("peak_time", clipped, trial).reason
    assert math.isfinite(kit.measure("undershoot", clipped, trial).high)
    assert "clipped" not in kit.measure("overshoot", recording, trial).reason


def test_a_channel_that_rests_before_it_moves_is_not_clipped(kit):
    recording, trial = kit.step(STIFF, hold=0.6, initial=0.0, size=5e6)
    assert np.count_nonzero(recording[kit.channel] == 0.0) > 5
    assert "clipped" not in kit.measure("overshoot", recording, trial).reason


def test_a_value_that_no_sensor_reads_is_said(kit, noisy_step):
    recording, trial = noisy_step
    wrong = recording.with_values({kit.channel: recording[kit.channel] * 1e6})
    assert "Pa is beyond the range of any such sensor" in kit.measure("peak", wrong, trial).reason


def test_few_samples_a_rise_are_said_and_priced(kit):
    for seed in range(10):
        natural = 600.0 + 70.0 * seed  # 1.3 to 2.7 samples from 10 to 90 %
        recording, trial = kit.step(
            ([1.0], [(1 / natural) ** 2, 2 * 0.5 / natural, 1.0]), hold=0.3, before=0.1
        )
        found = kit.measure("rise_time", recording, trial)
        assert found.low <= 1.63757 / natural <= found.high
        assert "few samples: " in found.reason


def on(name, sign, level):
    bounds = Bounds(high=level) if sign == "<=" else Bounds(low=level)
    return AcceptanceLimit(name, "x", bounds, f"{sign} {level}", "")


def test_a_clipped_step_down_is_open_below(kit):
    recording, trial = kit.step(STIFF, hold=0.6, initial=20e6, size=-5e6)
    noisy = kit.noisy(recording, 1e4, 3)
    clipped = noisy.with_values({kit.channel: np.maximum(noisy[kit.channel], 14.7e6)})
    peak, overshoot = (kit.measure(name, clipped, trial) for name in ("peak", "overshoot"))
    assert "at most this" in peak.reason
    assert peak.low == -math.inf < 14.7e6 - 5e4 < peak.value < peak.high
    assert overshoot.high == math.inf
    assert judge(peak, on("peak", ">=", 10e6)) is ScoreStatus.UNDECIDED
    assert judge(peak, on("peak", "<=", 16e6)) is ScoreStatus.PASSED


def test_readings_clipped_at_both_ends_are_open_to_both(kit):
    first_the_wrong_way = ([-0.02, 1.0], [1 / 900, 0.5 / 30, 1.0])
    recording, trial = kit.step(first_the_wrong_way, hold=1.0, initial=15e6, size=5e6)
    noisy = kit.noisy(recording, 1e4, 3)
    within = np.clip(noisy[kit.channel], 14.5e6, 21e6)
    clipped = noisy.with_values({kit.channel: within})
    for name, least in (("overshoot", 0.2), ("undershoot", 0.1)):
        found = kit.measure(name, clipped, trial)
        assert found.value == pytest.approx(least, rel=0.02)
        assert found.high == math.inf


def test_a_difference_is_cut_off_where_its_part_is(kit, noisy_step):
    recording, trial = noisy_step
    rng = np.random.default_rng(1)
    low = 2e6 + 1e4 * rng.normal(size=recording.time.size)
    high = recording[kit.channel] + 2e6
    parts = {"pressure_a": np.minimum(high, 22.3e6), "pressure_b": low}
    values = {"reference": recording["reference"], **parts}
    found = kit.measure("overshoot", replace(recording, values=values), trial)
    assert found.high == math.inf
    assert "samples of pressure_a at exactly 2.23e+07 Pa" in found.reason
    # pressure_b at its end makes the difference too large, and hides no overshoot
    values["pressure_a"] = high
    values["pressure_b"] = np.minimum(low, 2e6)
    found = kit.measure("overshoot", replace(recording, values=values), trial)
    assert "samples of pressure_b" in found.reason
    assert math.isfinite(found.high)


def test_what_stops_by_itself_is_not_clipped(kit):
    """A piston that overshoots and sticks for a while, and one that comes to rest for good."""
    since = np.arange(100) / 100.0
    arrives = 1.2 * (1.0 - (1.0 - since) ** 2)
    stuck = np.concatenate([arrives, np.full(60, 1.2), 1.2 - 0.2 * since**2, np.full(600, 1.0)])
    resting = np.concatenate([1.0 - (1.0 - since) ** 2, np.full(700, 1.0)])
    for shape in (stuck, resting):
        recording, trial = kit.step(
            lambda t, shape=shape: shape[np.minimum(np.round(t * 1e3), shape.size - 1).astype(int)],
            hold=0.8,
        )
        found = kit.measure("overshoot", recording, trial)
        assert "clipped" not in found.reason
        assert math.isfinite(found.high) or math.isnan(found.high)


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_clipping_of_coarse_readings_is_said_and_a_round_peak_is_not(kit, noisy_step, share):
    recording, trial = noisy_step
    coarse = 5e4
    values = np.round(recording[kit.channel] / coarse) * coarse
    assert (
        "clipped"
        not in kit.measure("peak", recording.with_values({kit.channel: values}), trial).reason
    )
    top = 20e6 + share * 5e5
    cut = recording.with_values({kit.channel: np.minimum(values, top)})
    assert "clipped" in kit.measure("peak", cut, trial).reason


def test_the_corner_of_what_stops_all_at_once_is_no_spike():
    """Fast up to a stop that a lag rounds: without one neighbour the others agree, but move."""
    places = np.arange(375) - 75.0
    for length in np.linspace(12.0, 30.0, 40):
        lag = 0.04 * length
        moved = [
            np.where(t > 0.0, t + lag * np.expm1(-np.maximum(t, 0.0) / lag), 0.0)
            for t in (places, places - length)
        ]
        shape = (moved[0] - moved[1]) / length
        noise = 7e-4 * np.random.default_rng(int(100 * length)).normal(size=shape.size)
        assert spikes(places, shape + noise, 0.0).size == 0
