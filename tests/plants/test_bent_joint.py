"""An elastic joint whose far side nothing reads: what it holds is known from a run's start only."""

from pathlib import Path

import pytest

from eha_bench.plants.network.file import load_plant

BELT = """\
plant: belt_drive
nodes:
  motor_shaft: {kind: rotation, inertia: 4e-4 kg*m^2}
  load:        {kind: rotation, inertia: 3.2e-3 kg*m^2}
elements:
  motor: {kind: motor, on: motor_shaft, torque_constant: 0.11 N*m/A}
  belt:  {kind: load_cell, between: [load, motor_shaft], stiffness: 35 N*m/rad}
inputs: {current_command: motor.current}
channels: {motor_speed: motor_shaft.speed, angle: load.angle MORE}
"""


@pytest.mark.parametrize(
    ("more", "bent"),
    [
        ("", True),
        (", motor_angle: motor_shaft.angle", False),
        (", belt_torque: belt.force", False),
    ],
)
def test_how_far_it_is_bent(tmp_path: Path, more: str, bent: bool) -> None:
    (tmp_path / "plant.yaml").write_text(BELT.replace(" MORE", more))
    assert bool(load_plant(tmp_path / "plant.yaml").roles.bent) is bent
