"""Sizes that effects start from are those of the coordinate, whichever side of a gear declares."""

from __future__ import annotations

from pathlib import Path

import pytest

from eha_bench.plants.model import load_model
from eha_bench.plants.network.plant import NetworkPlant
from eha_bench.plants.network.roles import roles_of

ARM = """\
plant: arm
nodes:
  shaft: {{kind: rotation{shaft}}}
  arm:   {{kind: rotation{arm}}}
elements:
  motor:   {{kind: motor, on: shaft, torque_constant: 0.05 N*m/A, resistance: 1 ohm,
            supply_voltage: 24 V}}
  gear:    {{kind: gear, from: shaft, to: arm, ratio: 20}}
  bearing: {{kind: friction, on: {on}, coulomb: {coulomb} N*m, viscous: {viscous} N*m*s/rad,
            stribeck_speed: {speed} rad/s}}
inputs:   {{duty: motor.duty}}
channels: {{arm_angle: arm.angle}}
"""


def usual(folder: Path, **declared: str) -> dict[str, dict[str, float]]:
    """Role and place -> what is usual there."""
    path = folder / "plant.yaml"
    path.write_text(ARM.format(**declared))
    plant = load_model(path).plant
    assert isinstance(plant, NetworkPlant)
    return {
        f"{role}: {spot.name}": dict(spot.usual)
        for role, spots in roles_of(plant.system).items()
        for spot in spots
    }


def test_friction_and_inertia_of_the_motors_side_are_those_of_the_arm(tmp_path: Path) -> None:
    """By hand: behind 1 : 20 a torque is 20 times, a damping and an inertia 400 times as large."""
    motors = {"shaft": ", inertia: 1e-5 kg*m^2", "arm": "", "on": "shaft"}
    arms = {"shaft": "", "arm": ", inertia: 4e-3 kg*m^2", "on": "arm"}
    fast = usual(tmp_path, **motors, coulomb="0.01", viscous="1e-4", speed="2")
    slow = usual(tmp_path, **arms, coulomb="0.2", viscous="0.04", speed="0.1")
    assert fast.keys() == slow.keys()
    assert any(
        found["effort"] == pytest.approx(0.2) for found in slow.values() if "effort" in found
    )
    for place, sizes in slow.items():
        assert fast[place] == pytest.approx(sizes), place
