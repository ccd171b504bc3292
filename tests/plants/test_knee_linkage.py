"""A joint behind a linkage: how it turns with the rod, and what its inertia does meanwhile."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import InputError
from eha_bench.plants.elements.knee_linkage import (
    angle,
    angle_of_pins,
    joint_angle_bend,
    joint_angle_bend_of_pins,
    joint_angle_per_rod,
    joint_angle_per_rod_of_pins,
)
from eha_bench.plants.network.file import load_plant
from eha_bench.plants.network.plant import NetworkPlant
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


def _leg(tmp_path: Path, *changes: tuple[str, str]) -> NetworkPlant:
    text = LEG
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "plant.yaml").write_text(text)
    return load_plant(tmp_path / "plant.yaml")


BY_PINS = ("link_c0: 240 mm", "link_length: 300 mm")
"""The same leg: c_0 and half the stroke, 37.2 cm^3 / 6.2 cm^2."""
SHOWN = ("velocity: rod.velocity", "velocity: rod.velocity, knee: joint.angle")


@given(position=st.floats(-0.05, 0.05))
def test_a_length_between_pins_is_that_of_the_cylinder_and_half_its_stroke(position: float) -> None:
    pins = {"link_a": 0.3, "link_b": 0.07, "link_length": 0.3}
    assert angle_of_pins(position, **pins) == pytest.approx(angle(position, **LINKS))
    ratio = joint_angle_per_rod(position, **LINKS)
    assert joint_angle_per_rod_of_pins(position, **pins) == pytest.approx(ratio)
    bend = joint_angle_bend(position, **LINKS)
    assert joint_angle_bend_of_pins(position, **pins) == pytest.approx(bend)


def test_a_drawing_gives_the_length_between_pins(tmp_path: Path) -> None:
    plants = [_leg(tmp_path, SHOWN), _leg(tmp_path, SHOWN, BY_PINS)]
    lines = [plant.linkage(plant.layout.defaults()) for plant in plants]
    positions = np.linspace(-0.05, 0.05, 7)
    first, second = (line.angle(positions) for line in lines if line is not None)
    assert second == pytest.approx(first)
    # the cylinder's volumes are its ends both times
    ranges = [plant.position_range(plant.layout.defaults()) for plant in plants]
    assert ranges[1]["knee"] == pytest.approx(ranges[0]["knee"])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("link_c0: 240 mm", "link_c0: 240 mm, link_length: 0.3 m"), "and not both; leave one"),
        ((", link_c0: 240 mm", ""), "needs 'link_c0' or 'link_length'; add 'link_c0: ... m'"),
        (
            ("link_c0: 240 mm", "link_length: 400 mm"),
            "with the rod at 0 mm the actuator is 400 mm long, and they allow 230 to 370 mm",
        ),
        (
            ("piston_position: rod.position, ", "knee: joint.angle, "),
            "'knee' follows from the position of 'rod', which no channel shows; add a channel",
        ),
        (
            ("velocity: rod.velocity", "knee: joint.speed"),
            "the speed of 'joint' cannot be shown: it is behind a linkage; show its angle, and "
            "rod.velocity",
        ),
    ],
)
def test_a_linkage_that_says_nothing_is_refused(
    tmp_path: Path, change: tuple[str, str], says: str
) -> None:
    with pytest.raises(InputError, match=re.escape(says)):
        _leg(tmp_path, change)


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
