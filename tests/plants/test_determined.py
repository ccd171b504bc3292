"""Which channels inputs determine: also a chamber whose oil only finds its way back to the tank."""

from pathlib import Path

import pytest

from eha_bench.plants.network.file import load_plant

PRESS = """\
plant: press
nodes:
  tank:      {kind: reservoir, pressure: 1 bar}
  chamber_a: {kind: volume, bulk_modulus: 1.1 GPa}
  chamber_b: {kind: volume, bulk_modulus: 1.1 GPa}
  shaft:     {kind: rotation, inertia: 2e-3 kg*m^2}
  rod:       {kind: translation, mass: 80 kg, stroke: [-50 mm, 50 mm]}
elements:
  motor:    {kind: motor, on: shaft, torque_constant: 0.2 N*m/A}
  pump:     {kind: pump, on: shaft, from: tank, to: chamber_a, displacement: 2e-7 m^3/rad}
  slip:     {kind: laminar_leakage, between: [chamber_a, tank], conductance: 2e-13 m^3/(s*Pa)}
  return:   {kind: WAY, between: [chamber_b, tank], SIZE}
  cylinder: {kind: cylinder, on: rod, a: chamber_a, b: chamber_b, area_a: 8 cm^2, area_b: 5 cm^2,
             dead_volume_a: 60 cm^3, dead_volume_b: 60 cm^3}
  spring:   {kind: spring, on: rod, stiffness: 40 kN/m}
inputs: {current_command: motor.current}
channels: {motor_speed: shaft.speed, pressure_a: chamber_a.pressure,
           pressure_b: chamber_b.pressure, piston_position: rod.position}
"""
WAYS = {
    "laminar_leakage": "conductance: 4e-10 m^3/(s*Pa)",
    "orifice": "area: 2 mm^2",
}


@pytest.mark.parametrize("way", WAYS)
def test_a_rod_whose_other_side_is_vented_is_driven(tmp_path: Path, way: str) -> None:
    text = PRESS.replace("WAY", way).replace("SIZE", WAYS[way])
    (tmp_path / "plant.yaml").write_text(text)
    plant = load_plant(tmp_path / "plant.yaml")
    everything = ("motor_speed", "pressure_a", "pressure_b", "piston_position")
    assert plant.determined(("current_command",)) == everything
    assert plant.determined(("pressure_a",)) == (
        "pressure_a",
        "pressure_b",
        "piston_position",
    )
    # a rod does not say what the pump does
    known = plant.determined(("piston_position",))
    assert "pressure_b" in known
    assert "pressure_a" not in known


def test_oil_that_a_valve_moves_unsaid_is_not_known(valve_cylinder_file: Path) -> None:
    plant = load_plant(valve_cylinder_file)
    known = plant.determined(("pressure_a", "supply_pressure"))
    assert "pressure_b" not in known
    assert "piston_position" not in known
    assert "pressure_b" in plant.determined(("valve_command",))


VANE = """\
plant: vane
nodes:
  supply:    {kind: reservoir, pressure: 10 MPa}
  tank:      {kind: reservoir, pressure: 2 bar}
  chamber_a: {kind: volume, volume: 80 cm^3, bulk_modulus: 1.2 GPa}
  chamber_b: {kind: volume, volume: 80 cm^3, bulk_modulus: 1.2 GPa}
  vane:      {kind: rotation, inertia: 0.08 kg*m^2}
elements:
  valve: {kind: spool_valve, supply: supply, tank: tank, a: chamber_a, b: chamber_b,
          full_scale: 10 V, flow_gain: 3e-8 m^3/(s*Pa^0.5)}
  rotor: {kind: pump, on: vane, from: chamber_a, to: chamber_b, displacement: 40 cm^3/rad}
inputs: {valve_command: valve.command}
channels: {pressure_a: chamber_a.pressure, pressure_b: chamber_b.pressure, vane_angle: vane.angle}
"""


def test_a_shaft_that_oil_turns_is_driven(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(VANE)
    plant = load_plant(tmp_path / "plant.yaml")
    assert plant.determined(("valve_command",)) == (
        "pressure_a",
        "pressure_b",
        "vane_angle",
    )
    assert plant.determined(("pressure_a", "pressure_b")) == (
        "pressure_a", "pressure_b", "vane_angle",
    )  # fmt: skip
    # a motor on the shaft, whose current nothing says, may turn it as well
    motor = "  servo: {kind: motor, on: vane, torque_constant: 0.2 N*m/A}\n"
    (tmp_path / "driven.yaml").write_text(VANE.replace("inputs:", f"{motor}inputs:"))
    driven = load_plant(tmp_path / "driven.yaml")
    assert "vane_angle" not in driven.determined(("pressure_a", "pressure_b"))


@pytest.fixture
def valve_cylinder_file(repository: Path) -> Path:
    return repository / "suites" / "plants" / "valve_cylinder.yaml"
