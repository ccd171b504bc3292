"""The ends of a way behind a gear hold what the gear leads to, as much slower as it moves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive
from fed_rod_plant import FED_ROD

PLANT = """\
plant: vane_arm
nodes:
  supply:    {{kind: reservoir, pressure: 14 MPa}}
  tank:      {{kind: reservoir, pressure: 0.3 MPa}}
  chamber_a: {{kind: volume, bulk_modulus: 1.1 GPa, pressure: 7 MPa}}
  chamber_b: {{kind: volume, bulk_modulus: 1.1 GPa, pressure: 7 MPa}}
  vane:      {{kind: translation{stroke}}}
  arm:       {{kind: rotation, inertia: 1.5 kg*m^2}}
elements:
  valve:    {{kind: spool_valve, supply: supply, tank: tank, a: chamber_a, b: chamber_b,
             full_scale: 10 V, flow_gain: 8e-8 m^3/(s*Pa^0.5), natural_frequency: 300 rad/s,
             damping_ratio: 0.7}}
  cylinder: {{kind: cylinder, on: vane, a: chamber_a, b: chamber_b, area_a: {area} cm^2,
             area_b: {area} cm^2, volume_a: 250 cm^3, volume_b: 250 cm^3}}
  rack:     {{kind: gear, from: vane, to: arm, ratio: {ratio} m/rad}}
  leakage:  {{kind: laminar_leakage, between: [chamber_a, chamber_b],
             conductance: 6e-13 m^3/(s*Pa)}}
  bearing:  {{kind: friction, on: arm, coulomb: 12 N*m, viscous: 25 N*m*s/rad}}
inputs:   {{valve_command: valve.command}}
channels: {{pressure_a: chamber_a.pressure, pressure_b: chamber_b.pressure, arm_angle: arm.angle}}
"""


def model(folder: Path, ratio: float, stroke: str = "") -> Any:
    """An arm that a vane of 60 cm3/rad turns, written as a cylinder and a rack of some ratio."""
    path = folder / "plant.yaml"
    given = f", stroke: {stroke}" if stroke else ""
    path.write_text(PLANT.format(ratio=ratio, area=0.6 / abs(ratio), stroke=given))
    return load_model(path)


def angle(found: Any, volts: float = 4.0) -> np.ndarray:
    time = np.arange(0.0, 4.0, 2e-3)
    drive = Drive(time, {"valve_command": np.full(time.size, volts)}, {})
    values = found.plant.simulate(found.vector(), drive, 2e-4)
    return np.asarray(values[:, found.plant.outputs.index("arm_angle")])


def test_a_rack_of_any_ratio_is_the_same_arm(tmp_path: Path) -> None:
    """By hand: 250 cm3 over 60 cm3/rad is 4.17 rad to each side, less what the oil keeps."""
    plain, racked = (angle(model(tmp_path, ratio)) for ratio in (1.0, 0.05))
    np.testing.assert_allclose(racked, plain, atol=1e-6)
    assert 1.0 < plain[-1] < 4.17
    assert plain[-1] == pytest.approx(4.17, rel=0.05)


def test_a_rack_the_other_way_round_turns_the_arm_back(tmp_path: Path) -> None:
    ahead, back = (angle(model(tmp_path, ratio)) for ratio in (0.05, -0.05))
    np.testing.assert_allclose(back, -ahead, atol=1e-3)


def test_the_stroke_of_a_node_behind_a_gear_holds(tmp_path: Path) -> None:
    """-20 to 30 mm of a rack of 50 mm/rad are -0.4 to 0.6 rad, with the sign of the gear."""
    found = model(tmp_path, 0.05, "[-20 mm, 30 mm]")
    assert angle(found)[-1] == pytest.approx(0.6)
    assert angle(found, -4.0)[-1] == pytest.approx(-0.4)
    assert found.plant.position_range(found.vector())["arm_angle"] == pytest.approx((-0.4, 0.6))
    turned = model(tmp_path, -0.05, "[-20 mm, 30 mm]")
    assert angle(turned)[-1] == pytest.approx(-0.6)
    assert turned.plant.position_range(turned.vector())["arm_angle"] == pytest.approx((-0.6, 0.4))


def test_a_cylinder_behind_a_gear_says_its_ends_at_the_joint(tmp_path: Path) -> None:
    found = model(tmp_path, 0.05)
    low, high = found.plant.position_range(found.vector())["arm_angle"]
    assert (low, high) == pytest.approx((-25.0 / 6.0, 25.0 / 6.0))


def test_an_arm_that_a_gear_joins_to_the_rod_has_the_rods_ends(tmp_path: Path) -> None:
    """The same arm with the rod as its leader: 4.17 m to each side, and twice as many rad."""
    path = tmp_path / "plant.yaml"
    text = PLANT.format(ratio=1.0, area=0.6, stroke="")
    path.write_text(
        text.replace(
            "from: vane, to: arm, ratio: 1.0 m/rad", "from: arm, to: vane, ratio: -2 rad/m"
        )
    )
    found = load_model(path)
    low, high = found.plant.position_range(found.vector())["arm_angle"]
    assert (low, high) == pytest.approx((-2 * 25.0 / 6.0, 2 * 25.0 / 6.0))


def test_a_cylinder_between_reservoirs_has_no_ends(tmp_path: Path) -> None:
    path = tmp_path / "plant.yaml"
    path.write_text(FED_ROD)
    found = load_model(path)
    assert found.plant.position_range(found.vector())["rod_position"] == (-np.inf, np.inf)
