"""Scores of readings that a sensor's end cut off hold what was hidden, or say that they cannot."""

import math

import numpy as np
import pytest

from eha_bench.core.recording import Recording

MODEL = {"torque_constant": 0.13, "piston_area_a": 3e-4, "piston_area_b": 2e-4}
METADATA = {"signal_start": "0.0"} | {f"model.{key}": repr(value) for key, value in MODEL.items()}
TIME = np.arange(2000) / 1000


@pytest.fixture
def driven(kit):
    """Two seconds of channels that move, with noise and a trial that follows nothing much."""
    generator = np.random.default_rng(5)
    noise = generator.normal(size=(4, TIME.size))
    signal = kit.Steps((0.0,), (0.0, 15e6), 2.0)
    swing = np.sin(2 * np.pi * TIME)
    values = {
        "pressure_a": 15e6 + 5e6 * swing + 1e4 * noise[0],
        "pressure_b": 5e6 + 1e6 * swing + 1e4 * noise[1],
        "current": 10.0 * swing + 0.05 * noise[2],
        "motor_speed": 100.0 * swing + 0.5 * noise[3],
        kit.channel: 15e6 + 5e6 * swing + 1e4 * noise[0],
        "reference": np.full(TIME.size, 15e6),
    }
    trial = kit.trial(signal, 2.0)
    return Recording(TIME, values, metadata=METADATA), trial


def clipped(recording, name, low=-math.inf, high=math.inf):
    return recording.with_values({name: np.clip(recording[name], low, high)})


@pytest.mark.parametrize("name", ["tracking_max", "tracking_rms", "tracking_nrmse"])
def test_a_tracking_error_has_no_upper_end(kit, driven, name) -> None:
    recording, trial = driven
    if name == "tracking_nrmse":
        reference = recording["reference"] + 5e6 * np.sin(4 * np.pi * TIME)
        recording = recording.with_values({"reference": reference})
    truth = kit.measure(name, recording, trial)
    cut = kit.measure(name, clipped(recording, kit.channel, high=19e6), trial)
    assert math.isfinite(truth.high)
    assert cut.high == math.inf
    assert cut.low <= truth.value
    assert "the sensor's end cut readings off" in cut.reason


def test_an_error_that_only_hidden_readings_had_may_have_been_none(kit, driven) -> None:
    recording, trial = driven
    high = np.where(recording[kit.channel] > 18e6, 25e6, 15e6)
    asked = recording.with_values({"reference": high})
    cut = kit.measure("tracking_max", clipped(asked, kit.channel, high=18e6), trial)
    # where it was cut off, 25 MPa were asked for and may have been there; elsewhere 5 MPa are off
    assert cut.value == pytest.approx(7e6, rel=0.02)
    assert cut.low == pytest.approx(5e6, rel=0.02)
    assert cut.high == math.inf


def test_a_percentile_that_few_hidden_readings_reach_is_finite(kit, driven) -> None:
    recording, trial = driven
    few = clipped(recording, kit.channel, high=19.98e6)
    many = clipped(recording, kit.channel, high=19e6)
    assert np.mean(few[kit.channel] == 19.98e6) < 0.05
    assert math.isfinite(kit.measure("tracking_p95", few, trial).high)
    assert kit.measure("tracking_p95", many, trial).high == math.inf


@pytest.mark.parametrize(
    ("metric", "channel", "low", "high"),
    [
        ("peak_force", "pressure_a", -math.inf, 19e6),
        ("peak_force", "pressure_b", 4.2e6, math.inf),
        ("peak_power", "current", -math.inf, 9.0),
        ("peak_power", "motor_speed", -90.0, math.inf),
    ],
)
def test_a_peak_of_several_channels_has_no_upper_end(
    kit, driven, metric, channel, low, high
) -> None:
    recording, trial = driven
    truth = kit.measure(metric, recording, trial, "")
    cut = kit.measure(metric, clipped(recording, channel, low, high), trial, "")
    assert cut.high == math.inf
    assert cut.low <= truth.value
    assert f"{channel}: the sensor's end cut readings off" in cut.reason
    assert math.isfinite(truth.high)


def test_energy_is_open_to_the_side_that_was_hidden(kit, driven) -> None:
    recording, trial = driven
    # the speed is positive where the current was cut off: what it gave was more
    cut = kit.measure("energy", clipped(recording, "current", high=9.0), trial, "")
    assert math.isfinite(cut.low)
    assert cut.high == math.inf


@pytest.mark.parametrize(
    ("speed", "ends"),
    [
        (100.0 * np.cos(np.pi * TIME), {"high": 9.0}),  # cut off once forwards and once backwards
        (np.full(TIME.size, 100.0), {"low": -9.0, "high": 9.0}),  # cut off at both ends
    ],
)
def test_energy_that_may_have_been_more_or_less_is_open_to_both_sides(
    kit, driven, speed, ends
) -> None:
    recording, trial = driven
    turning = recording.with_values({"motor_speed": speed})
    cut = kit.measure("energy", clipped(turning, "current", **ends), trial, "")
    assert math.isfinite(cut.value)
    assert cut.open == "both"


def test_nothing_changes_where_nothing_is_cut_off(kit, driven) -> None:
    recording, trial = driven
    for name in ("peak_force", "peak_power", "energy"):
        assert "cut" not in kit.measure(name, recording, trial, "").reason
