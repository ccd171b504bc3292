"""Sine fits against IEEE 1057 and the Cramér-Rao bound; sine metrics against known responses."""

import math
from dataclasses import replace

import numpy as np
import pytest

from eha_bench.metrics.sine_fit import fit4

RATE = 1000.0


def sample(frequency, amplitude, phase, offset, count):
    time = np.arange(count) / RATE
    return time, offset + amplitude * np.sin(2 * np.pi * frequency * time + phase)


def test_four_parameters_find_the_frequency():
    time, values = sample(6.7, 3.0, 0.4, -7.0, 731)
    fit = fit4(time, values, 6.4)
    assert fit.frequency == pytest.approx(6.7, abs=1e-9)
    assert (fit.amplitude, fit.phase, fit.offset) == pytest.approx((3.0, 0.4, -7.0), abs=1e-7)


def test_four_parameters_reach_the_cramer_rao_bound():
    count, noise = 500, 0.2
    time, clean = sample(10.0, 1.0, 0.3, 0.0, count)
    rng = np.random.default_rng(8)
    fits = [fit4(time, clean + rng.normal(0, noise, count), 10.02) for _ in range(300)]
    # Rife and Boorstyn 1974: var(f) = 6 sigma^2 fs^2 / (pi^2 A^2 N (N^2 - 1)) for a real sine
    bound = noise * RATE * math.sqrt(6 / (math.pi**2 * count * (count**2 - 1)))
    assert np.std([fit.frequency for fit in fits]) == pytest.approx(bound, rel=0.15)
    # and of the phase at the first sample: 4 sigma^2 (2 N - 1) / (A^2 N (N + 1))
    bound = noise * math.sqrt(4 * (2 * count - 1) / (count * (count + 1)))
    assert np.std([fit.phase for fit in fits]) == pytest.approx(bound, rel=0.15)


@pytest.mark.parametrize("frequency", [1.0, 6.7, 33.3])
@pytest.mark.parametrize("own", [True, False])
def test_ratio_and_lag_of_a_clean_response(kit, frequency, own):
    recording, trial = kit.sine(frequency, ratio=0.8, lag=0.6, amplitude=2e7, own=own)
    assert kit.measure("amplitude_ratio", recording, trial).value == pytest.approx(0.8, abs=1e-6)
    assert kit.measure("phase_lag", recording, trial).value == pytest.approx(0.6, abs=1e-6)
    assert kit.measure("time_lag", recording, trial).value == pytest.approx(
        0.6 / (2 * np.pi * frequency), rel=1e-5
    )
    assert kit.measure("distortion", recording, trial).value == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("lag", "expected"), [(-0.5, -0.5), (2.5, 2.5), (3.5, 3.5), (4.5, 4.5)])
def test_a_lag_beyond_half_a_period_is_no_lead(kit, lag, expected):
    recording, trial = kit.sine(5.0, lag=lag)
    assert kit.measure("phase_lag", recording, trial).value == pytest.approx(expected, abs=1e-6)


def test_the_transient_is_left_out(kit):
    recording, trial = kit.sine(
        6.7, ratio=0.9, lag=0.3, periods=12, extra=lambda t: 2.0 * np.exp(-t / 0.08)
    )
    ratio = kit.measure("amplitude_ratio", recording, trial)
    assert ratio.value == pytest.approx(0.9, abs=2e-3)
    assert "settled periods of 12" in ratio.reason


def test_a_response_that_keeps_changing_is_not_scored(kit):
    recording, trial = kit.sine(
        5.0, periods=12, extra=lambda t: 1.5 * t * np.sin(2 * np.pi * 5.0 * t)
    )
    found = kit.measure("amplitude_ratio", recording, trial)
    assert math.isnan(found.value)
    assert "not settled" in found.reason


def test_distortion_is_the_harmonics_share(kit):
    def harmonics(t):
        return 0.03 * np.sin(2 * np.pi * 15 * t + 1) + 0.04 * np.cos(2 * np.pi * 25 * t)

    recording, trial = kit.sine(5.0, ratio=0.5, extra=harmonics)
    assert kit.measure("distortion", recording, trial).value == pytest.approx(0.1, abs=1e-6)
    noisy = kit.noisy(recording, 0.02, 1)
    found = kit.measure("distortion", noisy, trial)
    assert found.low < 0.1 < found.high
    assert kit.measure("sine_residual", noisy, trial).value == pytest.approx(0.02, rel=0.1)


def test_noise_is_not_taken_for_distortion(kit):
    recording, trial = kit.sine(5.0, periods=20)
    values = [
        kit.measure("distortion", kit.noisy(recording, 0.05, seed), trial) for seed in range(20)
    ]
    assert np.mean([item.value for item in values]) < 0.005
    assert sum(item.low == 0.0 for item in values) >= 17


@pytest.mark.parametrize("colour", [0.0, 0.95])
def test_intervals_hold_under_correlated_noise(kit, colour):
    recording, trial = kit.sine(6.7, ratio=0.8, lag=0.6, periods=10)
    hits = {"amplitude_ratio": 0, "phase_lag": 0}
    for seed in range(60):
        noisy = kit.noisy(recording, 0.05, seed, colour)
        for name, truth in (("amplitude_ratio", 0.8), ("phase_lag", 0.6)):
            found = kit.measure(name, noisy, trial)
            hits[name] += found.low <= truth <= found.high
    assert all(count >= 52 for count in hits.values()), hits


def test_too_few_periods_or_samples_are_said(kit):
    recording, trial = kit.sine(5.0, periods=3)
    assert "period" in kit.measure("amplitude_ratio", recording, trial).reason
    recording, trial = kit.sine(300.0, periods=50)
    assert "samples in a period" in kit.measure("amplitude_ratio", recording, trial).reason


def test_a_reference_without_the_sine_is_said(kit):
    recording, trial = kit.sine(5.0)
    still = recording.with_values({"reference": np.zeros(len(recording))})
    found = kit.measure("amplitude_ratio", still, trial)
    assert math.isnan(found.value)
    assert "reference" in found.reason


def test_a_silent_response_has_no_phase(kit):
    recording, trial = kit.sine(5.0, ratio=0.0)
    noise = kit.noisy(recording, 0.1, 2)
    assert math.isnan(kit.measure("phase_lag", noise, trial).value)
    assert kit.measure("amplitude_ratio", noise, trial).value < 0.02


def test_a_foreign_clock_that_runs_slow_is_followed(kit):
    recording, trial = kit.sine(5.0, ratio=0.8, lag=0.6, periods=20, own=False)
    from dataclasses import replace

    slow = replace(recording, time=recording.time * 1.001 + 3.0)
    assert kit.measure("amplitude_ratio", slow, trial).value == pytest.approx(0.8, abs=1e-3)
    assert kit.measure("phase_lag", slow, trial).value == pytest.approx(0.6, abs=1e-2)


# --- lags of more than 270 degrees -------------------------------------------------------------


@pytest.mark.parametrize("degrees", [0, 60, 200, 260, 300, 350, 400, 500, 700])
def test_whole_turns_of_a_lag_come_from_the_onset(kit, degrees):
    frequency, lag = 2.0, math.radians(degrees)
    recording, trial = kit.sine(frequency, lag=lag, periods=12)
    time = recording.time
    values = np.where(time * frequency * 2 * math.pi >= lag, recording[kit.channel], 0.0)
    rng = np.random.default_rng(degrees)
    late = recording.with_values({kit.channel: values + 0.01 * rng.normal(size=time.size)})
    found = kit.measure("phase_lag", late, trial)
    assert found.value == pytest.approx(lag, abs=0.02)
    assert ("whole turn" in found.reason) == (degrees >= 270)
    assert kit.measure("time_lag", late, trial).value == pytest.approx(
        lag / (2 * math.pi * frequency), abs=2e-3
    )


def test_a_lead_stays_a_lead_and_a_record_without_its_start_says_what_it_cannot_tell(kit):
    recording, trial = kit.sine(2.0, lag=-1.0, periods=12)
    assert kit.measure("phase_lag", recording, trial).value == pytest.approx(-1.0, abs=1e-3)
    later = replace(recording.between(0.4, 6.0), metadata={"signal_start": "0.0"})
    found = kit.measure("phase_lag", later, trial)
    assert found.value == pytest.approx(-1.0, abs=1e-3)
    assert "a lag of 270 deg and more looks the same" in found.reason


def test_a_decaying_offset_and_a_ringing_start_are_taken_off(kit):
    def transient(time):
        return 0.8 * np.exp(-time / 1.0) + 0.3 * np.exp(-time / 0.8) * np.sin(31.0 * time)

    recording, trial = kit.sine(2.0, ratio=0.9, lag=0.7, periods=8, extra=transient)
    noisy = kit.noisy(recording, 0.002, 1)
    for name, truth in (("amplitude_ratio", 0.9), ("phase_lag", 0.7)):
        found = kit.measure(name, noisy, trial)
        assert found.value == pytest.approx(truth, abs=4e-3)
        assert found.low <= truth <= found.high
        assert "transient" in found.reason


def test_one_sample_without_a_value_and_one_spike_leave_a_sine_alone(kit):
    recording, trial = kit.sine(2.0, ratio=0.9, lag=0.7)
    values = np.array(kit.noisy(recording, 0.01, 1)[kit.channel])
    values[[700, 3000]] = [math.nan, 9.0]
    found = kit.measure("amplitude_ratio", recording.with_values({kit.channel: values}), trial)
    assert found.value == pytest.approx(0.9, abs=2e-3)
    assert "1 outlier(s) replaced by their neighbours, the first at 3 s" in found.reason
