"""Tracking error, and loop overruns."""

import math
from dataclasses import replace

import numpy as np
import pytest

from eha_bench.core.score import Measure
from eha_bench.metrics.coverage import NORMAL, type_b
from eha_bench.metrics.tracking import with_sensor


def followed(kit, error):
    """A sine whose measurement misses the reference by `error(time)`."""
    recording, trial = kit.sine(2.0, amplitude=4.0, periods=6)
    return recording.with_values(
        {kit.channel: recording["reference"] - error(recording.time)}
    ), trial


def test_a_constant_error(kit):
    recording, trial = followed(kit, lambda t: np.full(t.size, 0.5))
    assert kit.measure("tracking_rms", recording, trial).value == pytest.approx(0.5)
    assert kit.measure("tracking_max", recording, trial).value == pytest.approx(0.5)
    assert kit.measure("tracking_nrmse", recording, trial).value == pytest.approx(
        0.5 / 8.0, rel=1e-4
    )
    assert kit.measure("tracking_p95", recording, trial).value == pytest.approx(0.5)


def test_a_sine_error(kit):
    recording, trial = followed(kit, lambda t: 0.3 * np.sin(2 * np.pi * 5 * t))
    assert kit.measure("tracking_rms", recording, trial).value == pytest.approx(0.3 / math.sqrt(2))
    assert kit.measure("tracking_max", recording, trial).value == pytest.approx(0.3, rel=1e-3)


def test_the_time_of_settling_is_not_scored(kit):
    recording, trial = kit.step(np.ones_like, before=0.5, hold=0.5)
    values = np.array(recording[kit.channel])
    values[:400] = 77.0
    moved = recording.with_values({kit.channel: values})
    assert kit.measure("tracking_max", moved, trial).value == pytest.approx(0.0, abs=1e-12)


def test_the_error_of_a_step_is_normalised_by_the_step(kit):
    recording, trial = kit.step(lambda t: 0.9 * np.ones_like(t), size=5.0, before=0.1, hold=0.5)
    assert kit.measure("tracking_nrmse", recording, trial).value == pytest.approx(0.1)


def test_noise_gives_the_rms_an_interval(kit):
    truth = math.hypot(0.3 / math.sqrt(2), 0.05)
    inside = 0
    for seed in range(40):
        recording, trial = followed(kit, lambda t: 0.3 * np.sin(2 * np.pi * 5 * t))
        found = kit.measure("tracking_rms", kit.noisy(recording, 0.05, seed), trial)
        inside += found.low <= truth <= found.high
    assert inside >= 34


def test_a_sensors_calibration_widens_both_sides():
    # noise of 3 and a calibration of 4 make 5
    noise = Measure(10.0, 10.0 - 3.0 * NORMAL, 10.0 + 3.0 * NORMAL, "why")
    found = with_sensor(noise, type_b("calibration", 4.0))
    assert (found.low, found.high) == pytest.approx((10.0 - 5.0 * NORMAL, 10.0 + 5.0 * NORMAL))
    parts = {part.source: part.standard for part in found.budget.parts}
    assert parts == pytest.approx({"calibration": 4.0, "noise": 3.0})
    assert (found.value, found.reason) == (10.0, "why")
    assert with_sensor(Measure(1.0, 0.5, 1.5), type_b("calibration", 4.0)).low == 0.0


def test_what_is_measured_is_said(kit):
    recording, trial = followed(kit, lambda t: np.full(t.size, 0.5))
    reasons = {
        name: kit.measure(name, recording, trial).reason
        for name in ("tracking_rms", "tracking_p95")
    }
    assert "measured error, sensor noise included" in reasons["tracking_rms"]
    assert "95 % of the samples are within it" in reasons["tracking_p95"]


def test_another_channel_does_not_follow_the_reference(kit):
    recording, trial = kit.sine(2.0)
    other = recording.with_values({"motor_speed": recording[kit.channel]})
    found = kit.measure("tracking_rms", other, trial, "motor_speed")
    assert math.isnan(found.value)
    assert "motor_speed" in found.reason


def test_a_missing_value_is_placed(kit):
    recording, trial = kit.sine(2.0)
    values = np.array(recording[kit.channel])
    values[1234] = np.inf
    found = kit.measure("tracking_rms", recording.with_values({kit.channel: values}), trial)
    assert math.isnan(found.value)
    assert "1.234 s" in found.reason


def test_a_recording_that_ends_early_is_scored_as_far_as_it_goes_and_says_so(kit):
    recording, trial = kit.sine(2.0)
    found = kit.measure("tracking_rms", recording.between(0.0, 4.0), trial)
    assert "ends at 4 s" in found.reason
    assert math.isnan(kit.measure("tracking_rms", recording.between(0.0, 1.0), trial).value)


# --- loop overruns ---------------------------------------------------------------------------


def test_late_ticks_are_counted(kit):
    recording, trial = kit.sine(2.0)
    assert kit.measure("loop_overruns", recording, trial, "").value == 0
    time = np.array(recording.time)
    time[100:] += 0.8e-3
    time[200:] += 0.4e-3  # within half a period: not late
    time[300:] += 2e-3
    late = replace(recording, time=time)
    assert kit.measure("loop_overruns", late, trial, "").value == 2


def test_what_the_target_counted_comes_first(kit):
    recording, trial = kit.sine(2.0)
    own = replace(recording, metadata={**recording.metadata, "loop_overruns": "7"})
    assert kit.measure("loop_overruns", own, trial, "").value == 7
    odd = replace(recording, metadata={"loop_overruns": "many"})
    assert "not a count" in kit.measure("loop_overruns", odd, trial, "").reason


def test_times_that_a_rate_made_hide_late_ticks(kit):
    recording, trial = kit.sine(2.0)
    made = replace(recording, metadata={**recording.metadata, "resampled": '["time"]'})
    assert math.isnan(kit.measure("loop_overruns", made, trial, "").value)
    # other channels' clocks do not hide the ticks of this one
    carried = replace(recording, metadata={**recording.metadata, "resampled": '["pressure_a"]'})
    assert kit.measure("loop_overruns", carried, trial, "").value == 0.0


def test_a_log_of_another_rate_has_no_overruns(kit):
    recording, trial = kit.sine(2.0, rate=100.0)
    slower = replace(recording, metadata={"signal_start": "0.0"})
    found = kit.measure("loop_overruns", slower, replace(trial, sample_rate=1000.0), "")
    assert math.isnan(found.value)
    assert "not at the trial's 1000 Hz" in found.reason
