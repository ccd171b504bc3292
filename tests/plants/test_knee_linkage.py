"""A joint behind a linkage: how it turns with the rod, and what its inertia does meanwhile."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.elements.knee_linkage import angle, joint_angle_bend, joint_angle_per_rod
from eha_bench.plants.network.file import load_plant
from eha_bench.plants.plant import Drive

LINKS = {"link_a": 0.3, "link_b": 0.07, "link_c0": 0.24,
         "cylinder_volume_a": 37.2e-6, "cylinder_area_a": 6.2e-4}  # fmt: skip
# equal pressures on equal areas: nothing but the weight and what moves acts
LEG = """\
plant: leg
nodes:
  oil_a: {kind: reservoir, pressure: 5 bar}
  oil_b: {kind: reservoir, pressure: 5 bar}
  rod:   {kind: translation, mass: 1.4 kg}
  joint: {kind: rotation, inertia: 0.2 kg*m^2}
  wheel: {kind: rotation, inertia: 0.01 kg*m^2}
elements:
  cylinder: {kind: cylinder, on: rod, a: oil_a, b: oil_b, area_a: 6.2 cm^2, area_b: 6.2 cm^2,
             volume_a: 37.2 cm^3, volume_b: 37.2 cm^3}
  knee: {kind: knee_linkage, on: rod, to: joint, cylinder: cylinder,
         link_a: 300 mm, link_b: 70 mm, link_c0: 240 mm}
  gear: {kind: gear, from: wheel, to: joint, ratio: 3}
  leg:  {kind: pendulum, on: joint, mass: 5 kg, length: 250 mm, hanging_angle: 1.5 rad}
inputs:   {pull: oil_a.pressure}
channels: {piston_position: rod.position, velocity: rod.velocity}
"""


@given(position=st.floats(-0.05, 0.05))
def test_the_ratio_is_the_slope_of_the_angle_and_the_bend_that_of_the_ratio(
    position: float,
) -> None:
    step = 1e-5
    slope = (angle(position + step, **LINKS) - angle(position - step, **LINKS)) / (2.0 * step)
    assert joint_angle_per_rod(position, **LINKS) == pytest.approx(slope, rel=1e-6)
    bend = joint_angle_per_rod(position + step, **LINKS)
    bend = (bend - joint_angle_per_rod(position - step, **LINKS)) / (2.0 * step)
    assert joint_angle_bend(position, **LINKS) == pytest.approx(bend, rel=1e-5, abs=1e-4)


def _energies(position: FloatArray, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the energy of the leg's motion and that of its weight's height, J."""
    ratio = np.array([joint_angle_per_rod(x, **LINKS) for x in position])
    turned = np.array([angle(x, **LINKS) for x in position])
    inertia = 0.2 + 9 * 0.01 + 5.0 * 0.25**2
    moving = 0.5 * (1.4 + inertia * ratio**2) * velocity**2
    return moving, -5.0 * 9.80665 * 0.25 * np.cos(turned - 1.5)


@pytest.mark.slow  # compiles a kernel
def test_a_leg_without_friction_keeps_its_energy(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(LEG)
    plant = load_plant(tmp_path / "plant.yaml")
    time = np.arange(0.0, 2.0, 1e-3)
    drive = Drive(time, {"pull": np.full(time.size, 5e5)})
    start = {"piston_position": 0.03, "velocity": 0.0}
    out = plant.at(plant.layout.defaults()).simulate(drive, start, 2e-5)
    position, velocity = (out[:, plant.outputs.index(n)] for n in ("piston_position", "velocity"))
    moving, height = _energies(position, velocity)
    assert moving.max() > 1.0, "it swings"
    # without -J r r' v^2 they do not
    assert np.ptp(moving + height) < 1e-3 * moving.max()
