"""A position servo whose simulation begins in the midst of a motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive

PLANT = """\
plant: servo
nodes:
  shaft:  {kind: rotation}
  output: {kind: rotation, inertia: 0.03 kg*m^2}
elements:
  motor: {kind: motor, on: shaft, resistance: 2.3 ohm, torque_constant: 0.0083 N*m/A,
          supply_voltage: 12 V}
  gear:  {kind: gear, from: shaft, to: output, ratio: 193}
  arm:   {kind: pendulum, on: output, mass: 0.8 kg, length: 180 mm}
  drag:  {kind: friction, on: output, viscous: 0.1 N*m*s/rad}
  loop:  {kind: position_servo, on: output, motor: motor, proportional: 6 1/rad, derivative: D,
          period: 1 ms}
inputs:   {goal: {to: loop.reference, between_samples: hold}}
channels: {angle: output.angle, speed: output.speed, current: motor.current}
"""


@pytest.mark.parametrize("derivative", ["0 s/rad", "0.05 s/rad"])
def test_a_window_begins_with_what_the_loop_had_asked_for(tmp_path: Path, derivative: str) -> None:
    path = tmp_path / "plant.yaml"
    path.write_text(PLANT.replace("derivative: D", f"derivative: {derivative}"))
    model = load_model(path)
    plant, vector, names = model.plant, model.vector(), list(model.plant.outputs)
    time = np.arange(0.0, 2.0, 0.01)
    # sent at half the rate of the log, as a bus does
    goal = np.repeat(0.8 * np.sin(3.0 * time[::2]), 2)
    whole = plant.simulate(vector, Drive(time, {"goal": goal}), 1e-4)
    current = whole[:, names.index("current")]
    first = 80
    start = {name: float(whole[first, names.index(name)]) for name in ("angle", "speed")}
    rows = slice(first - 10, first + 40)
    drive = Drive(time[rows], {"goal": goal[rows]}, start, first=10)
    window = plant.simulate(vector, drive, 1e-4)[10:]
    apart = np.abs(window[:, names.index("current")] - current[first : first + 40])
    # without the loop's command it was 1 A at first
    assert np.ptp(current) > 1.0
    assert apart.max() < 0.005 * np.ptp(current)
