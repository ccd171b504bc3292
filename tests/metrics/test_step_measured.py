"""Step metrics on recordings as rigs make them: noise, offsets, foreign clocks, several edges."""

import math
from dataclasses import replace

import numpy as np
import pytest

from eha_bench.core.recording import Recording

STIFF = ([1.0], [(1 / 70.0) ** 2, 2 * 0.5 / 70.0, 1.0])  # 2nd order, 70 rad/s, damping 0.5
TRUTH = {
    "rise_time": 1.63757 / 70,
    "peak_time": 3.6276 / 70,
    "settling_time": 8.0764 / 70,
    "overshoot": 0.163034,
}


def pressure(kit, **options):
    given = {"hold": 0.6, "edge": 0.001, "initial": 15e6, "size": 5e6, **options}
    return kit.step(STIFF, **given)


@pytest.mark.parametrize("name", sorted(TRUTH))
@pytest.mark.parametrize("colour", [0.0, 0.6])
def test_noise_moves_the_value_no_further_than_its_interval(kit, name, colour):
    recording, trial = pressure(kit)
    inside = 0
    for seed in range(20):
        noisy = kit.noisy(recording, 0.003 * 5e6, seed, colour)
        found = kit.measure(name, noisy, trial)
        assert found.low <= found.value <= found.high
        inside += found.low <= TRUTH[name] <= found.high
    assert inside >= 16


def test_intervals_are_as_wide_as_the_scatter(kit):
    recording, trial = pressure(kit)
    found = [kit.measure("rise_time", kit.noisy(recording, 2e4, seed), trial) for seed in range(30)]
    scatter = np.std([item.value for item in found])
    width = np.mean([item.high - item.low for item in found]) / (2 * 1.96)
    assert 0.6 < width / scatter < 1.7


def test_response_time_counts_from_the_edge_not_from_the_start(kit):
    early, trial = pressure(kit, edge=0.001)
    late, late_trial = pressure(kit, edge=0.101, hold=0.7)
    assert kit.measure("response_time", early, trial).value == pytest.approx(
        kit.measure("response_time", late, late_trial).value, abs=1e-6
    )


def test_recorded_levels_decide_not_those_of_the_suite(kit):
    recording, trial = pressure(kit)
    lower = recording.with_values(
        {"reference": np.where(recording["reference"] > 16e6, 18e6, 15e6)}
    )
    found = kit.measure("steady_state_error", lower, trial)
    assert found.value == pytest.approx(18e6 - 20e6, rel=1e-3)


# --- recordings made elsewhere ---------------------------------------------------------------


def test_a_foreign_recording_is_found_by_its_own_reference(kit):
    own, trial = pressure(kit)
    foreign = replace(own, time=own.time + 12.345, metadata={})
    for name in ("rise_time", "response_time", "overshoot", "settling_time"):
        ours, theirs = (kit.measure(name, item, trial) for item in (own, foreign))
        assert theirs.value == pytest.approx(ours.value, abs=1e-9)
    found = kit.measure("response_time", foreign, trial)
    assert "reference" in found.reason
    # the command may have come any time since the sample before
    assert found.high >= found.value + 0.9e-3


def test_a_foreign_recording_without_reference_is_not_guessed_at(kit):
    own, trial = pressure(kit)
    foreign = kit.without(replace(own, metadata={}), "reference")
    found = kit.measure("rise_time", foreign, trial)
    assert math.isnan(found.value)
    assert "no reference" in found.reason


def test_our_own_recording_needs_no_reference_channel(kit):
    own, trial = pressure(kit)
    found = kit.measure("rise_time", kit.without(own, "reference"), trial)
    assert found.value == pytest.approx(TRUTH["rise_time"], abs=1e-5)


def test_the_right_one_of_several_jumps_is_found(kit):
    single, trial = pressure(kit, hold=0.5, edge=0.0, before=0.2)
    signal = kit.Steps((0.5, 1.0, 1.5), (15e6, 17e6, 15e6, 20e6), 2.0)
    time = np.arange(2000) * 1e-3
    reference = signal(time)
    shape = single[kit.channel][200:] - 15e6
    response = np.full(time.size, 15e6)
    for start, size in ((500, 0.4), (1000, -0.4), (1500, 1.0)):
        response[start:] += size * np.append(shape, np.full(time.size, 5e6))[: time.size - start]
    foreign = Recording(time, {kit.channel: response, "reference": reference})
    found = kit.measure("steady_state_error", foreign, trial)
    assert found.value == pytest.approx(0.0, abs=2e4), found.reason
    assert kit.measure("rise_time", foreign, trial).value == pytest.approx(
        TRUTH["rise_time"], abs=1e-4
    )


@pytest.mark.parametrize("start", ["nonsense", "nan", "inf"])
def test_a_damaged_start_is_said(kit, start):
    own, trial = pressure(kit)
    found = kit.measure("rise_time", replace(own, metadata={"signal_start": start}), trial)
    assert math.isnan(found.value)
    assert "signal_start" in found.reason


# --- several edges ---------------------------------------------------------------------------


def test_of_several_edges_the_worst_counts(kit):
    signal = kit.Steps((0.0, 1.0), (0.0, 1.0, 3.0), 2.0)
    time = np.arange(-200, 2000) * 1e-3
    values = np.where(time >= 0, 1 - np.exp(-np.maximum(time, 0) / 0.02), 0.0)
    values += np.where(time >= 1, 2 - 2 * np.exp(-np.maximum(time - 1, 0) / 0.05), 0.0)
    recording = Recording(
        time - time[0],
        {kit.channel: values, "reference": signal(time)},
        metadata={"signal_start": "0.2"},
    )
    found = kit.measure("rise_time", recording, kit.trial(signal, 2.0, settle=0.2))
    assert found.value == pytest.approx(0.05 * math.log(9), abs=1e-4)
    assert "2 edges" in found.reason
    assert "1 s" in found.reason


# --- what cannot be scored ---------------------------------------------------------------------


def test_a_value_missing_in_the_scored_time_is_placed(kit):
    recording, trial = pressure(kit)
    values = np.array(recording[kit.channel])
    values[150] = np.nan
    found = kit.measure("rise_time", recording.with_values({kit.channel: values}), trial)
    assert math.isnan(found.value)
    assert "0.15 s" in found.reason


def test_a_value_missing_before_the_scored_time_is_not_missed(kit):
    recording, trial = pressure(kit, before=0.5)
    values = np.array(recording[kit.channel])
    values[:50] = np.nan
    found = kit.measure("rise_time", recording.with_values({kit.channel: values}), trial)
    assert found.value == pytest.approx(TRUTH["rise_time"], abs=1e-5)


def test_a_response_against_the_command_is_no_rise(kit):
    recording, trial = pressure(kit)
    mirrored = recording.with_values({kit.channel: 30e6 - recording[kit.channel]})
    found = kit.measure("rise_time", mirrored, trial)
    assert math.isnan(found.value)
    assert "against the command" in found.reason


def test_a_response_that_has_not_settled_has_no_final_level(kit):
    recording, trial = kit.step(lambda t: t, hold=1.0)
    for name in ("rise_time", "settling_time", "overshoot"):
        found = kit.measure(name, recording, trial)
        assert math.isnan(found.value)
        assert "not settled" in found.reason


def test_a_hold_that_was_cut_short_is_not_scored(kit):
    recording, trial = pressure(kit)
    found = kit.measure("rise_time", recording.between(0.0, 0.25), trial)
    assert math.isnan(found.value)
    assert "ends" in found.reason


def test_noise_without_a_step_is_no_step(kit):
    recording, trial = pressure(kit)
    flat = recording.with_values({kit.channel: np.full(len(recording), 15e6)})
    for case in (flat, kit.noisy(flat, 1e5, 0)):
        found = kit.measure("rise_time", case, trial)
        assert math.isnan(found.value)
        assert "no step" in found.reason


def test_settling_below_the_noise_floor_is_told_by_two_modes(kit):
    recording, trial = pressure(kit)
    clean = kit.measure("settling_time", recording, trial).value
    inside = 0
    for seed in range(10):
        found = kit.measure("settling_time", kit.noisy(recording, 0.05 * 5e6, seed), trial)
        assert "noise floor" in found.reason
        assert "two modes" in found.reason
        assert found.high - found.low > 0.002
        inside += found.low <= clean <= found.high
    assert inside >= 8


def test_settling_below_the_noise_floor_is_no_guess(kit):
    # a beat: four modes
    recording, trial = kit.step(
        lambda t: 1 - np.exp(-t / 0.3) * np.cos(60 * t) * np.cos(6 * t), hold=3.0
    )
    found = kit.measure("settling_time", kit.noisy(recording, 0.05, 1), trial)
    assert math.isnan(found.value)
    assert "noise floor" in found.reason
    assert "not that of two decaying modes" in found.reason


def test_a_jump_within_a_sample_has_no_overshoot(kit):
    # a polynomial through a jump would swing over on either side of it
    recording, trial = kit.step(lambda t: (t > 0.0005).astype(float), hold=0.2)
    for seed in range(5):
        noisy = kit.noisy(recording, 0.004, seed)
        for name in ("overshoot", "undershoot"):
            found = kit.measure(name, noisy, trial)
            assert found.low < 0.004
            assert found.value < 0.02
        settled = kit.measure("settling_time", noisy, trial)
        assert settled.value == pytest.approx(0.001, abs=0.5e-3)


def test_a_limit_cycle_never_settles(kit):
    recording, trial = kit.step(
        lambda t: 1 - np.exp(-t / 0.05) + 0.05 * np.sin(40 * t) * (1 - np.exp(-t / 0.05)), hold=3.0
    )
    found = kit.measure("settling_time", recording, trial)
    assert math.isnan(found.value)
    assert "not settled" in found.reason


# --- holding and steady state ------------------------------------------------------------------


def test_holding_current_is_the_mean_of_the_end(kit):
    recording, trial = pressure(kit)
    rng = np.random.default_rng(0)
    current = 11.0 + rng.normal(0.0, 0.05, len(recording))
    with_current = recording.with_values({"current": current})
    found = kit.measure("holding_current", with_current, trial, "current")
    assert found.low < 11.0 < found.high
    assert found.high - found.low < 0.05
    drifting = recording.with_values({"current": current + 5 * recording.time})
    assert "not stationary" in kit.measure("holding_current", drifting, trial, "current").reason
    steady = kit.measure("holding_current", recording, trial, "current").reason
    assert "not stationary" not in steady


def test_holding_current_without_current_says_so(kit):
    recording, trial = pressure(kit)
    found = kit.measure("holding_current", recording, trial, "current")
    assert math.isnan(found.value)
    assert found.reason == "no current"


def test_steady_state_error_is_reference_minus_final(kit):
    recording, trial = pressure(kit)
    low = recording.with_values({kit.channel: recording[kit.channel] - 1e5})
    assert kit.measure("steady_state_error", low, trial).value == pytest.approx(1e5, rel=1e-3)


@pytest.mark.parametrize(("seconds", "scored"), [(0.25, False), (0.5, True)])
def test_a_hold_that_is_cut_off_in_its_first_half_has_no_end(kit, seconds, scored):
    recording, trial = pressure(kit)
    found = kit.measure("steady_state_error", recording.between(0.0, seconds), trial)
    assert math.isfinite(found.value) == scored
    assert ("in the first half of its hold" in found.reason) != scored


def test_a_single_sample_jump_is_timed_between_its_samples(kit):
    """A drive's current follows within one tick: nothing to fit a curve to."""
    signal = kit.Steps((0.0,), (0.0, 6.0), 0.5)
    time = np.arange(-100, 500) * 1e-3
    rng = np.random.default_rng(4)
    values = np.where(time >= 0.9e-3, 6.0, 0.0) + rng.normal(0, 0.05, time.size)
    recording = Recording(
        time - time[0],
        {kit.channel: values, "reference": signal(time)},
        metadata={"signal_start": "0.1"},
    )
    trial = kit.trial(signal, 0.5, settle=0.1)
    assert kit.measure("delay_time", recording, trial).value == pytest.approx(0.5e-3, abs=0.1e-3)
    assert kit.measure("rise_time", recording, trial).value == pytest.approx(0.8e-3, abs=0.1e-3)


@pytest.mark.parametrize("lag", [5e-5, 2e-4, 5e-4, 2e-3])
@pytest.mark.parametrize("noise", [0.006, 0.03])
def test_nothing_settles_before_it_has_responded(kit, lag, noise):
    recording, trial = kit.step(
        lambda time: 1.0 - np.exp(-time / lag), hold=0.35, before=0.05, size=6.0
    )
    scored = 0
    for seed in range(12):
        noisy = kit.noisy(recording, noise * 6.0, seed)
        settled, reached = (
            kit.measure(name, noisy, trial) for name in ("settling_time", "response_time")
        )
        if math.isnan(settled.value):
            continue
        scored += 1
        assert settled.value >= reached.value
        assert settled.low <= settled.value <= settled.high
    assert scored


def test_the_tail_of_a_lag_in_few_samples_is_not_read_too_early(kit):
    tau, rate = 0.01, 160.0  # 3.5 samples a rise
    recording, trial = kit.step(([1.0], [tau, 1.0]), hold=0.75, period=1.0 / rate, before=0.25)
    slope = 0.05 / tau / rate  # at 95 %, per sample
    errors, early = [], 0
    for seed in range(60):
        found = kit.measure("response_time", kit.noisy(recording, 0.25 * slope, seed), trial)
        errors.append((found.value - tau * math.log(20.0)) * rate)
        early += found.high < tau * math.log(20.0)
    # a cubic over as many samples as the rise takes was early by 0.2 of a sample on average
    assert abs(float(np.mean(errors))) < 0.1
    assert early <= 6
