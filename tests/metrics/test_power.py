"""Energy, power, force and torque; tracking without its lag and by phase of the motion."""

import math

import numpy as np
import pytest

from eha_bench.core.linkage import Linkage
from eha_bench.core.recording import Recording

MODEL = {
    "torque_constant": 0.13,
    "piston_area_a": 3e-4,
    "piston_area_b": 2e-4,
    "volume_a": 1.2e-5,
    "link_a": 0.32,
    "link_b": 0.05,
    "link_c0": 0.25,
}
METADATA = {"signal_start": "1.0"} | {f"model.{key}": repr(value) for key, value in MODEL.items()}


def run(kit, model=True, **channels):
    """Two seconds of channels, functions of the signal's time, after one of settling."""
    time = np.arange(-1000, 2000) / 1000
    signal = kit.Steps((0.0,), (0.0, 1.0), 2.0)
    values = {name: function(time) for name, function in channels.items()}
    metadata = METADATA if model else {"signal_start": "1.0"}
    recording = Recording(time - time[0], values | {"reference": signal(time)}, metadata=metadata)
    return recording, kit.trial(signal, 2.0, settle=1.0)


def test_energy_is_the_integral_of_torque_and_speed(kit):
    recording, trial = run(
        kit, current=lambda t: np.full_like(t, 10.0), motor_speed=lambda t: 50.0 * np.maximum(t, 0)
    )
    found = kit.measure("energy", recording, trial, "")
    assert found.value == pytest.approx(0.13 * 10 * 50 * 2.0**2 / 2, rel=2e-3)
    assert kit.measure("peak_power", recording, trial, "").value == pytest.approx(130, rel=1e-3)


def test_energy_given_back_counts_as_such(kit):
    recording, trial = run(
        kit,
        current=lambda t: np.full_like(t, 10.0),
        motor_speed=lambda t: 100.0 * np.sin(np.pi * t),
    )
    assert kit.measure("energy", recording, trial, "").value == pytest.approx(0.0, abs=0.2)
    assert kit.measure("peak_power", recording, trial, "").value == pytest.approx(130, rel=1e-3)


def test_noise_gives_energy_an_interval(kit):
    rng = np.random.default_rng(0)
    truth = 0.13 * 10 * 50 * 2.0
    inside = 0
    for _ in range(30):
        recording, trial = run(
            kit,
            current=lambda t: 10.0 + 0.5 * rng.normal(size=t.size),
            motor_speed=lambda t: np.full_like(t, 50.0),
        )
        found = kit.measure("energy", recording, trial, "")
        inside += found.low <= truth <= found.high
    assert inside >= 25


@pytest.mark.parametrize("name", ["energy", "peak_power"])
def test_power_needs_current_speed_and_a_torque_constant(kit, name):
    current = {"current": np.ones_like}
    recording, trial = run(kit, **current)
    assert kit.measure(name, recording, trial, "").reason == "no motor_speed"
    recording, trial = run(kit, model=False, **current, motor_speed=np.ones_like)
    assert "no torque_constant" in kit.measure(name, recording, trial, "").reason


def test_force_of_unequal_areas(kit):
    recording, trial = run(
        kit,
        pressure_a=lambda t: np.where(t > 1.0, 2e7, 1e7),
        pressure_b=lambda t: np.full_like(t, 1e6),
    )
    found = kit.measure("peak_force", recording, trial, "")
    assert found.value == pytest.approx(3e-4 * 2e7 - 2e-4 * 1e6)


def test_torque_goes_through_the_linkage(kit):
    angle = 1.5
    recording, trial = run(
        kit,
        pressure_a=lambda t: np.full_like(t, 2e7),
        pressure_b=lambda t: np.full_like(t, 1e6),
        joint_angle=lambda t: np.full_like(t, angle),
    )
    a, b = MODEL["link_a"], MODEL["link_b"]
    length = math.sqrt(a * a + b * b - 2 * a * b * math.cos(angle))
    expected = (3e-4 * 2e7 - 2e-4 * 1e6) * a * b * math.sin(angle) / length
    found = kit.measure("peak_joint_torque", recording, trial, "")
    assert found.value == pytest.approx(expected)
    linkage = Linkage(a, b, MODEL["link_c0"], MODEL["volume_a"] / MODEL["piston_area_a"])
    same = recording.with_values(
        {"piston_position": np.full(len(recording), linkage.position_at(angle))}
    )
    assert kit.measure("peak_joint_torque", same, trial, "").value == pytest.approx(expected)


# --- tracking ----------------------------------------------------------------------------------


def test_a_pure_lag_is_no_error_once_it_is_taken_off(kit):
    recording, trial = kit.sine(2.0, ratio=1.0, lag=2 * np.pi * 2.0 * 0.0305, periods=6)
    plain = kit.measure("tracking_rms", recording, trial)
    found = kit.measure("tracking_rms_lag_compensated", recording, trial)
    assert plain.value > 0.2
    assert found.value < 1e-4
    assert "0.0305 s" in found.reason


def test_what_is_no_lag_stays(kit):
    recording, trial = kit.sine(2.0, extra=lambda t: np.full_like(t, 0.3))
    found = kit.measure("tracking_rms_lag_compensated", recording, trial)
    assert found.value == pytest.approx(0.3, rel=1e-2)


def test_motion_and_rest_are_told_apart(kit):
    time = np.arange(4000) / 1000

    def ramp(t):
        return np.clip(np.asarray(t) - 1.0, 0.0, 1.0)

    recording, trial = kit.step(np.ones_like, hold=4.0, before=0.0)
    error = np.where((time > 1.0) & (time < 2.0), 0.2, 0.05)
    moved = recording.with_values({"reference": ramp(time), kit.channel: ramp(time) - error})
    moving = kit.measure("tracking_rms_moving", moved, trial)
    resting = kit.measure("tracking_rms_resting", moved, trial)
    assert moving.value == pytest.approx(0.2, rel=1e-2)
    assert resting.value == pytest.approx(0.05, rel=1e-2)
    still = recording.with_values({"reference": np.zeros(4000)})
    assert math.isnan(kit.measure("tracking_rms_moving", still, trial).value)


@pytest.mark.parametrize("equal", [True, False])
def test_a_sensor_of_the_difference_gives_the_force_of_equal_areas_only(equal):
    from eha_bench.core.errors import MissingChannelError
    from eha_bench.metrics.power import rod_force

    areas = MODEL | ({"piston_area_b": MODEL["piston_area_a"]} if equal else {})
    metadata = {f"model.{key}": repr(value) for key, value in areas.items()}
    time = np.arange(10) / 1000
    recording = Recording(time, {"pressure_difference": np.full(10, 5e6)}, metadata=metadata)
    if equal:
        assert rod_force(recording) == pytest.approx(np.full(10, 3e-4 * 5e6))
    else:
        with pytest.raises(MissingChannelError, match="pressure_a"):
            rod_force(recording)


def test_a_peak_reaches_as_far_as_its_samples_noise():
    from eha_bench.metrics.power import _Scored, largest

    values = np.array([1.0, -10.0, 3.0])
    found = largest(_Scored(np.arange(3.0), values, 2.0), "largest")
    assert found.value == 10.0
    # below it by what the largest of three samples is above its mean, above it by one sample's
    assert found.low == pytest.approx(10.0 - 2.0 * math.sqrt(2.0 * math.log(3.0)))
    assert found.high == pytest.approx(10.0 + 1.96 * 2.0)


@pytest.mark.parametrize("metric", ["energy", "peak_power", "peak_force", "peak_joint_torque"])
def test_every_trial_that_lasts_has_power_and_force(kit, metric):
    from dataclasses import replace

    from eha_bench.core import plugins

    _, trial = run(kit, current=np.ones_like)
    scorer = plugins.load("metrics", metric)()
    assert scorer.applies(trial)
    assert not scorer.applies(replace(trial, duration=0.0))
