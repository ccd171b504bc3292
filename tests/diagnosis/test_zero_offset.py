"""A small weight beside a declared one is said to look like a zero that is off."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from eha_bench.diagnosis.fit.uncertainty import Estimate
from eha_bench.diagnosis.outcome.confounded import zero_offset_notes
from eha_bench.diagnosis.outcome.diagnosis import FoundEffect
from eha_bench.plants.network.file import load_plant

ARM = """\
plant: arm
nodes:
  joint: {kind: rotation, inertia: 0.01 kg*m^2}
elements:
  motor: {kind: motor, on: joint, torque_constant: 1 N*m/A}
  shank: {kind: pendulum, on: joint, mass: 2 kg, length: 250 mm, gravity: 10 m/s^2}
inputs:   {current_command: motor.current}
channels: {joint_angle: joint.angle}
"""
ZERO, HEAVIER = 0.02, 0.03


def notes(path: Path, torque: float, level: float, at: str = "joint") -> tuple[str, ...]:
    path.write_text(ARM)
    plant = load_plant(path)
    values = {"gravity_torque": torque, "level_angle": level}
    numbers = {name: Estimate(value, -1.0, 1.0, "") for name, value in values.items()}
    effect = FoundEffect("gravity_load", "torque", numbers, {"posture": "link"}, at=at)
    return zero_offset_notes(plant, plant.layout.defaults(), [effect])


def test_a_small_weight_is_a_zero_that_is_off_and_a_heavier_pendulum(tmp_path: Path) -> None:
    # 5 N*m hang there; G cos(q - a) = W (zero cos q - heavier sin q)
    torque, level = 5.0 * math.hypot(ZERO, HEAVIER), math.atan2(-HEAVIER, ZERO)
    (note,) = notes(tmp_path / "plant.yaml", torque, level)
    assert "zero is 1.1 deg off" in note
    assert "3.0 % larger" in note
    angle = np.linspace(-1.5, 1.5, 31)
    seen = -5.0 * (1.0 + HEAVIER) * np.sin(angle - ZERO)
    assert -5.0 * np.sin(angle) + torque * np.cos(angle - level) == pytest.approx(seen, abs=5e-3)


@pytest.mark.parametrize(("torque", "at"), [(2.0, "joint"), (0.1, "elsewhere")])
def test_a_weight_of_its_own_is_not_said_to(tmp_path: Path, torque: float, at: str) -> None:
    assert notes(tmp_path / "plant.yaml", torque, 0.3, at) == ()
