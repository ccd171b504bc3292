"""Friction that creeps at rest, seen through a gear."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive

RATIO = 1000.0
"""Of the gear, rad/m."""
PLANT = """plant: screw
nodes:
  shaft: {{kind: rotation, inertia: 4e-4 kg*m^2}}
  carriage: {{kind: translation, mass: 80 kg}}
elements:
  motor: {{kind: motor, on: shaft, torque_constant: 0.5 N*m/A}}
  screw: {{kind: gear, from: shaft, to: carriage, ratio: 1000 rad/m}}
{frictions}
inputs: {{current_command: motor.current}}
channels: {{motor_speed: shaft.speed}}
"""
ON_SHAFT = (
    "  {name}: {{kind: friction, on: shaft, coulomb: {torque} N*m, creep_speed: {creep} rad/s}}"
)
ON_CARRIAGE = (
    "  {name}: {{kind: friction, on: carriage, coulomb: {force} N, creep_speed: {creep} m/s}}"
)


def speed(folder: Path, *frictions: str) -> FloatArray:
    """Return the shaft's speed where the motor pushes half as hard as both frictions hold."""
    (folder / "plant.yaml").write_text(PLANT.format(frictions="\n".join(frictions)))
    model = load_model(folder / "plant.yaml")
    time = np.arange(0.0, 0.5, 2e-3)
    drive = Drive(time, {"current_command": np.full(time.size, 0.1)})
    return model.plant.simulate(model.vector(), drive, 1e-4)[:, 0]


def test_a_friction_creeps_as_fast_whichever_side_of_a_gear_it_is_declared_on(
    tmp_path: Path,
) -> None:
    on_shaft = speed(tmp_path, ON_SHAFT.format(name="drag", torque=0.1, creep=0.2))
    force, creep = 0.1 * RATIO, 0.2 / RATIO
    behind = speed(tmp_path, ON_CARRIAGE.format(name="guide", force=force, creep=creep))
    # half of its level at rest: 0.2 rad/s * artanh(1/2)
    assert on_shaft[-1] == pytest.approx(0.2 * np.arctanh(0.5), rel=1e-3)
    assert behind == pytest.approx(on_shaft, rel=1e-9)


def test_of_two_frictions_the_softer_one_lets_the_shaft_creep(tmp_path: Path) -> None:
    drag = ON_SHAFT.format(name="drag", torque=0.06, creep=0.02)
    guide = ON_CARRIAGE.format(name="guide", force=40.0, creep=2e-4)
    assert speed(tmp_path, drag, guide)[-1] == pytest.approx(0.2 * np.arctanh(0.5), rel=1e-3)
