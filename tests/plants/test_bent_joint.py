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


GEARED = """\
plant: joint
nodes:
  rotor: {kind: rotation, inertia: 6e-5 kg*m^2}
  flex:  {kind: rotation}
  link:  {kind: rotation, inertia: 0.3 kg*m^2}
elements:
  motor:  {kind: motor, on: rotor, torque_constant: 0.11 N*m/A}
  gear:   {kind: gear, from: rotor, to: flex, ratio: 50}
  spline: {kind: coupling, between: [flex, link], stiffness: 8000 N*m/rad}
inputs: {current_command: motor.current}
channels: {motor_speed: rotor.speed, joint_angle: link.angle MORE}
"""


@pytest.mark.parametrize(("more", "bent"), [("", True), (", motor_angle: rotor.angle", False)])
def test_a_reading_before_the_gear_tells_it_as_well(tmp_path: Path, more: str, bent: bool) -> None:
    (tmp_path / "plant.yaml").write_text(GEARED.replace(" MORE", more))
    assert bool(load_plant(tmp_path / "plant.yaml").roles.bent) is bent
