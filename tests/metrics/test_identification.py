"""The constants of Section 4.2, from recordings made by its own equations and by the simulator."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from eha_bench.core.recording import Recording
from eha_bench.core.trial import Bypass, ControlMode, Piston, Setup
from eha_bench.metrics import metric

TRUE = {
    "torque_constant": 0.13,
    "static_torque": 0.2537,
    "coulomb_torque": 0.16,
    "viscous_torque": 0.00498,
    "stribeck_speed": 18.0,
    "leakage": 2.0e-15,
    "pump_displacement": 1.0982e-7,
    "bulk_modulus": 9e8,
    "volume_a": 1.2535e-5,
}
METADATA = {"signal_start": "0.0"} | {f"model.{name}": repr(v) for name, v in TRUE.items()}


def open_loop(kit, signal, duration, bypass):
    setup = Setup(Piston.LOCKED, bypass)
    return replace(kit.trial(signal, duration), mode=ControlMode.CURRENT, setup=setup)


def staircase(kit, levels, hold):
    times = tuple(0.1 + hold * k for k in range(len(levels)))
    return kit.Steps(times, (0.0, *levels), 0.1 + hold * len(levels))


def settled_speed(current):
    """Eq. (23); with these figures friction grows with speed throughout."""

    def rest(speed):
        extra = TRUE["static_torque"] - TRUE["coulomb_torque"]
        friction = TRUE["coulomb_torque"] + TRUE["viscous_torque"] * speed
        friction += extra * math.exp(-((speed / TRUE["stribeck_speed"]) ** 2))
        return friction - TRUE["torque_constant"] * abs(current)

    return math.copysign(brentq(rest, 0.0, 400.0), current)


def bypass_run(kit, sign=1.0, noise=0.1, levels=(10, 8, 6, 5, 4, 3.5, 3, 2.5, 2.1)):
    signal = staircase(kit, tuple(sign * level for level in levels), 1.0)
    trial = open_loop(kit, signal, signal.duration, Bypass.OPEN)
    time = np.arange(round(signal.duration * 1000)) / 1000
    rng = np.random.default_rng(1)
    current = signal(time)
    speed = np.array([settled_speed(level) if level else 0.0 for level in current])
    values = {
        "reference": current,
        "current": current + 0.05 * rng.normal(size=time.size),
        "motor_speed": speed + noise * rng.normal(size=time.size),
    }
    return Recording(time, values, metadata=METADATA), trial


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("name", ["coulomb_torque", "viscous_torque", "stribeck_speed"])
def test_friction_from_settled_speeds(kit, name, sign):
    recording, trial = bypass_run(kit, sign)
    found = kit.measure(name, recording, trial, "")
    assert found.value == pytest.approx(TRUE[name], rel=0.03), found.reason
    assert found.low < TRUE[name] < found.high
    assert f"model: {TRUE[name]:.4g}" in found.reason
    assert metric(name).applies(trial)


def test_friction_needs_a_known_torque_constant(kit):
    recording, trial = bypass_run(kit)
    unknown = replace(recording, metadata={"signal_start": "0.0"})
    found = kit.measure("coulomb_torque", unknown, trial, "")
    assert math.isnan(found.value)
    assert "no torque_constant" in found.reason


def test_speeds_that_have_not_settled_are_left_out(kit):
    recording, trial = bypass_run(kit)
    values = np.array(recording["motor_speed"])
    drifting = (recording.time > 1.1) & (recording.time < 2.1)
    values[drifting] += 30.0 * (recording.time[drifting] - 2.1)
    found = kit.measure("viscous_torque", recording.with_values({"motor_speed": values}), trial, "")
    assert found.value == pytest.approx(TRUE["viscous_torque"], rel=0.03)
    assert "8 settled speeds, 1 levels left out" in found.reason


def locked_run(kit, levels=(8, 12, 16, 20, 24), noise=1.0):
    """Pressure sags from a peak until static friction gives way; then the rotor moves on."""
    hold = 4.0
    signal = staircase(kit, levels, hold)
    trial = open_loop(kit, signal, signal.duration, Bypass.CLOSED)
    time = np.arange(round(signal.duration * 1000)) / 1000
    rng = np.random.default_rng(2)
    stiffness = TRUE["bulk_modulus"] / TRUE["volume_a"]
    rate = TRUE["leakage"] * stiffness * 2.0  # both chambers: P1 and P2 move against each other
    pressure, speed = np.zeros(time.size), np.zeros(time.size)
    for number, level in enumerate(levels):
        span = (time >= 0.1 + hold * number) & (time < 0.1 + hold * (number + 1))
        since = time[span] - time[span][0]
        slip = TRUE["torque_constant"] * level - TRUE["static_torque"]
        slip /= TRUE["pump_displacement"]
        after = 1.0 + 0.4 * number / len(levels)  # s of rest before the break-away
        sag = slip * np.exp(-rate * (since - after))
        pressure[span] = np.where(since < after, sag, slip)
        moving = np.clip(since - after, 0.0, 0.15)
        speed[span] = np.where(since - after < 0.15, 100.0 * moving**2, 0.3)
    values = {
        "reference": signal(time),
        "current": signal(time) + noise * 0.05 * rng.normal(size=time.size),
        "motor_speed": speed + noise * 0.1 * rng.normal(size=time.size),
        "pressure_difference": pressure + noise * 4e4 * rng.normal(size=time.size),
        "pressure_a": 0.5 * pressure + noise * 3e4 * rng.normal(size=time.size),
    }
    return Recording(time, values, metadata=METADATA), trial


@pytest.mark.parametrize(
    ("name", "tolerance"), [("torque_constant", 0.01), ("static_torque", 0.05), ("leakage", 0.05)]
)
def test_break_aways_and_sags(kit, name, tolerance):
    recording, trial = locked_run(kit)
    found = kit.measure(name, recording, trial, "")
    assert found.value == pytest.approx(TRUE[name], rel=tolerance), found.reason
    assert found.low < found.value < found.high
    assert metric(name).applies(trial)


def test_one_current_draws_no_line(kit):
    recording, trial = locked_run(kit, levels=(16,))
    found = kit.measure("torque_constant", recording, trial, "")
    assert math.isnan(found.value)
    assert "hold the currents for longer" in found.reason


@pytest.mark.parametrize("channel", ["motor_speed", "current", "pressure_difference"])
def test_a_missing_channel_is_said(kit, channel):
    recording, trial = locked_run(kit)
    found = kit.measure("static_torque", kit.without(recording, channel), trial, "")
    assert found.reason == f"no {channel}"


def test_only_its_own_experiment_is_scored(kit):
    _, locked = locked_run(kit)
    _, bypass = bypass_run(kit)
    assert not metric("torque_constant").applies(bypass)
    assert not metric("coulomb_torque").applies(locked)
    assert not metric("leakage").applies(replace(locked, mode=ControlMode.PRESSURE))


@pytest.mark.slow
@pytest.mark.parametrize("target", ["paper", "physical"])
def test_the_shipped_suite_finds_the_model_that_made_it(kit, repository, target):
    from eha_bench.suites import load_suite
    from eha_bench.targets.resolve import open_target

    suite = load_suite(repository / "suites" / "identify.yaml")
    simulator = open_target(repository / "suites" / "targets" / f"{target}.yaml")
    asked = {
        "locked_staircase": ("torque_constant", "static_torque", "leakage"),
        "bypass_staircase-forward": ("coulomb_torque", "viscous_torque", "stribeck_speed"),
    }
    trials = {trial.id: trial for trial in suite.trials}
    with simulator:
        for name, constants in asked.items():
            recording = simulator.run(trials[name], 0).recording
            for constant in constants:
                found = kit.measure(constant, recording, trials[name], "")
                truth = float(recording.metadata[f"model.{constant}"])
                assert found.value == pytest.approx(truth, rel=0.05), (constant, found)
                assert found.low - 0.5 * (found.high - found.low) < truth, (constant, found)
                assert truth < found.high + 0.5 * (found.high - found.low), (constant, found)


@pytest.mark.parametrize("name", ["torque_constant", "static_torque"])
def test_a_line_through_break_aways_says_how_many_and_what_the_model_has(kit, name):
    recording, trial = locked_run(kit)
    found = kit.measure(name, recording, trial, "")
    assert found.reason.startswith("Eq. (21), 5 break-aways at 5 currents")
    assert found.reason.endswith(f"model: {TRUE[name]:.4g} {metric(name).spec.unit}")


def test_five_settled_speeds_leave_one_degree_of_freedom_for_four_constants(kit):
    levels = (10, 6, 4, 3, 2.1)
    recording, trial = bypass_run(kit, levels=levels)
    found = kit.measure("coulomb_torque", recording, trial, "")
    assert "5 settled speeds" in found.reason
    assert found.low < found.value < found.high
