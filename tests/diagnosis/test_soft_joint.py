"""A leg joint with a soft belt, simulated by equations of its own: the belt is named."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eha_bench
from eha_bench.core.arrays import FloatArray

PLANT = """\
plant: leg_joint
nodes:
  rotor: {kind: rotation, inertia: 1.2e-4 kg*m^2}
  joint: {kind: rotation, inertia: 0.011 kg*m^2}
elements:
  motor: {kind: motor, on: rotor, torque_constant: 0.1 N*m/A, current_limit: 30 A}
  belt:  {kind: gear, from: rotor, to: joint, ratio: 9}
  drag:  {kind: friction, on: joint, coulomb: 0.5 N*m, viscous: 0.14 N*m*s/rad}
  shank: {kind: pendulum, on: joint, mass: 2.4 kg, length: 280 mm}
inputs:   {current_command: motor.current}
channels: {current: motor.current, motor_speed: rotor.speed, joint_angle: joint.angle}
calibrate:
  - {parameter: motor.torque_constant, within: 8 %}
  - {parameter: drag.coulomb, within: 30 %}
  - {parameter: drag.viscous, within: 30 %}
  - {parameter: shank.mass, within: 3 %}
"""
DATASET = """\
model: plant.yaml
inputs: [current_command]
runs:
  - {log: run_0.csv, use: train}
  - {log: run_1.csv, use: train}
  - {log: run_2.csv, use: holdout}
"""
COMPLIANCE = 1.0 / 250.0
PERIOD = 0.002


def _current(time: FloatArray, number: int) -> FloatArray:
    a, b = ((0.7, 3.1), (1.1, 4.3), (0.9, 2.3))[number]
    swing = 5.0 * np.sin(2.0 * np.pi * a * time) + 4.0 * np.sin(2.0 * np.pi * b * time)
    return np.asarray(np.round(swing / 0.004) * 0.004)


def _run(number: int) -> FloatArray:
    """Return time, current, motor speed and joint angle: friction at the motor, encoder beyond."""
    time = np.arange(0.0, 2.0, PERIOD)
    current = _current(time, number)
    motor_side, load = 9.0**2 * 1.2e-4 + 0.011, 2.45 * 0.28**2

    def rates(t: float, y: FloatArray) -> list[float]:
        a, wa, b, wb = y
        torque = 9.0 * 0.098 * current[min(int(t / PERIOD + 1e-9), current.size - 1)]
        friction = 0.52 * np.tanh(wa / 0.01) + 0.13 * wa
        belt = (a - b) / COMPLIANCE + 0.5 * (wa - wb)
        weight = 2.45 * 9.80665 * 0.28 * np.sin(b)
        return [wa, (torque - friction - belt) / motor_side, wb, (belt - weight) / load]

    state, rows = np.zeros(4), [np.zeros(4)]
    for tick in time[:-1]:
        span = (tick, tick + PERIOD)
        state = solve_ivp(rates, span, state, "LSODA", rtol=1e-7, atol=1e-9).y[:, -1]
        rows.append(state)
    _, wa, b, _ = np.array(rows).T
    noise = np.random.default_rng(number)
    speed = 9.0 * wa + 0.05 * noise.standard_normal(time.size)
    angle = b + 2e-4 * noise.standard_normal(time.size)
    # the drive logs what flowed until now
    flowed = np.concatenate([current[:1], current[:-1]]) + 0.01 * noise.standard_normal(time.size)
    return np.column_stack([time, current, flowed, speed, angle])


@pytest.mark.slow(12)
def test_a_soft_belt_is_named_with_its_compliance(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(PLANT)
    (tmp_path / "dataset.yaml").write_text(DATASET)
    header = "time [s],current_command [A],current [A],motor_speed [rad/s],joint_angle [rad]"
    for number in range(3):
        log = tmp_path / f"run_{number}.csv"
        np.savetxt(log, _run(number), "%.9g", ",", header=header, comments="")
    found = eha_bench.diagnose(tmp_path / "dataset.yaml", out=tmp_path / "out")
    assert [effect.id for effect in found.effects] == ["joint_elasticity"]
    effect = found.effects[0]
    assert effect.at == "joint"
    assert effect.settings["sensors"] == "beyond"
    assert effect.parameters["compliance"].value == pytest.approx(COMPLIANCE, rel=0.05)
