"""A joint that gives way between two parts that the plant takes for one."""

from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.network.file import load_plant
from eha_bench.plants.network.plant import NetworkPlant
from eha_bench.plants.network.rigid_joint import rigid_joints
from eha_bench.plants.plant import Drive

NODES = """\
  rotor: {kind: rotation, inertia: 1e-4 kg*m^2}
  joint: {kind: rotation, inertia: 0.01 kg*m^2}
"""
ELEMENTS = """\
  motor: {kind: motor, on: rotor, torque_constant: 0.1 N*m/A, current_limit: 30 A}
  drag:  {kind: friction, on: joint, coulomb: 0.5 N*m, viscous: 0.1 N*m*s/rad}
"""
LINK = "  link:  {kind: pendulum, on: joint, mass: 2 kg, length: 300 mm}\n"
GEAR = "  belt:  {kind: gear, from: rotor, to: joint, ratio: 10}\n"
SPRING = """\
  belt:  {kind: gear, from: rotor, to: wheel, ratio: 10}
  give:  {kind: coupling, first: joint, second: wheel, stiffness: 200 N*m/rad,
          damping: 0.4 N*m*s/rad, play: 0.01 rad}
"""
CHANNELS = """\
inputs:   {current_command: motor.current}
channels: {current: motor.current, motor_speed: rotor.speed, joint_angle: joint.angle}
"""
TIME = np.arange(0.0, 0.6, 1e-3)
COMMAND = {"current_command": 6.0 * np.sin(2.0 * np.pi * 4.0 * TIME)}


def _plant(folder: Path, nodes: str, elements: str) -> NetworkPlant:
    path = folder / "plant.yaml"
    path.write_text(f"plant: leg\nnodes:\n{nodes}elements:\n{elements}{CHANNELS}")
    plant = load_plant(path)
    assert isinstance(plant, NetworkPlant)
    return plant


def _with(plant: NetworkPlant, effect: str, **values: float | str) -> FloatArray:
    vector = plant.layout.defaults()
    for name, value in values.items():
        key = f"{effect}.{name}"
        vector[plant.layout.index[key]] = plant.layout.by_key[key].encode(value)
    return vector


@pytest.fixture(scope="module")
def leg(tmp_path_factory: pytest.TempPathFactory) -> NetworkPlant:
    return _plant(tmp_path_factory.mktemp("leg"), NODES, ELEMENTS + LINK + GEAR)


@pytest.fixture(scope="module")
def free(tmp_path_factory: pytest.TempPathFactory) -> NetworkPlant:
    """The same without friction and weight: a rotor and a joint, and the belt between them."""
    motor = ELEMENTS.splitlines(keepends=True)[0]
    return _plant(tmp_path_factory.mktemp("free"), NODES, motor + GEAR)


def test_joints_are_rigid_where_both_sides_weigh_something(
    leg: NetworkPlant, free: NetworkPlant
) -> None:
    found = {joint.name: joint for joint in rigid_joints(leg.system)}
    assert [*found] == ["belt", "joint"]
    # 10^2 * 1e-4 of the rotor; before the link are the rotor and the joint's own 0.01
    declared = leg.layout.defaults()
    assert found["belt"].inertia(declared) == pytest.approx(0.01)
    assert found["joint"].inertia(declared) == pytest.approx(0.02)
    assert [joint.name for joint in rigid_joints(free.system)] == ["belt"]


def test_what_pulls_from_outside_pulls_beyond_the_joint(tmp_path: Path) -> None:
    """A weight on a rope hangs at what is carried: at rest the coupling is bent by all of it."""
    weight = "  hook:  {kind: load, on: joint, force: 4 N*m}\n"
    elements = ELEMENTS.replace("coulomb: 0.5 N*m, ", "") + LINK + GEAR + weight
    plant = _plant(tmp_path, NODES, elements)
    joint = next(item for item in rigid_joints(plant.system) if item.name == "joint")
    assert set(joint.moved) == {("link", "on"), ("hook", "on")}
    vector = _with(plant, "joint_elasticity", at="joint", sensors="before", compliance=5e-3)
    # the motor holds the weight; on the shaft alone either would turn it by 0.04 rad in 20 ms
    still = {"current_command": np.full(TIME.size, 4.0)}
    out = plant.simulate(vector, Drive(TIME, still, {}), 1e-4)
    angle = out[:, plant.outputs.index("joint_angle")]
    assert abs(angle[20]) < 1e-3


@pytest.mark.parametrize("inertia", [1e-4, 1e-7, 0.0])
def test_a_lighter_side_asks_for_no_shorter_steps(free: NetworkPlant, inertia: float) -> None:
    """A fit may take a rotor's inertia to nothing: it stood still there, for hours."""
    rotor, declared = "rotor.inertia", 1e-4
    vector = free.layout.defaults()
    assert vector[free.layout.index[rotor]] == declared
    vector[free.layout.index[rotor]] = inertia
    loose = free._loosened("belt", beyond=False)
    stiff = loose.at(vector, 1e-12, 1e-3, 0.0)._loose.vector[
        loose.loose.layout.index["belt~coupling.stiffness"]
    ]
    # by hand: n^2 J_m w^2, at most 1000 rad/s
    assert stiff == pytest.approx(max(100.0 * inertia, 1e-30 * 0.01) * 1e6, abs=0.0)


@pytest.mark.slow  # compiles kernels
def test_two_masses_swing_at_their_frequency_and_keep_their_momentum(free: NetworkPlant) -> None:
    vector = _with(free, "joint_elasticity", compliance=1 / 50.0, damping_time=0.0)
    # by hand: w = sqrt(k (1/J + 1/(n^2 J_m))) = sqrt(50 * 200) = 100 rad/s
    time = np.arange(0.0, 2.0 * np.pi / 100.0 * 3.0, 1e-4)
    drive = Drive(time, {"current_command": np.zeros(time.size)})
    start = {"joint_angle": 0.0, "belt~bend": 0.02}
    out = free.at(vector).simulate(drive, start, 1e-5)
    joint = out[:, free.outputs.index("joint_angle")]
    # both sides weigh the same, and what they meet in stays where it was
    expected = -0.01 + 0.01 * np.cos(100.0 * time)
    assert joint == pytest.approx(expected, abs=2e-5)
    rotor = out[:, free.outputs.index("motor_speed")] / 10.0
    assert rotor == pytest.approx(np.sin(100.0 * time), abs=2e-3)


@pytest.mark.slow  # compiles kernels
def test_it_is_what_a_declared_coupling_does(leg: NetworkPlant, tmp_path: Path) -> None:
    declared = _plant(tmp_path, NODES + "  wheel: {kind: rotation}\n", ELEMENTS + LINK + SPRING)
    vector = _with(
        leg, "gear_backlash", play=0.01, damping_time=0.002, compliance=1 / 200.0, at="belt",
        sensors="before",
    )  # fmt: skip
    drive = Drive(TIME, COMMAND)
    ours = leg.at(vector).simulate(drive, {"joint_angle": 0.0, "belt~bend": 0.002}, 1e-3)
    start = {"joint_angle": 0.0, "wheel_angle": -0.002}
    theirs = declared.at(declared.layout.defaults()).simulate(drive, start, 1e-3)
    for name in ("motor_speed", "joint_angle"):
        one, other = ours[:, leg.outputs.index(name)], theirs[:, declared.outputs.index(name)]
        assert np.ptp(other) > 0.0
        assert one == pytest.approx(other, abs=1e-6 * float(np.ptp(other)))


@pytest.mark.slow  # compiles kernels
def test_a_stiff_joint_is_a_rigid_one_and_nothing_is_exactly_that(leg: NetworkPlant) -> None:
    drive = Drive(TIME, COMMAND, {"joint_angle": 0.3})
    rigid = leg.simulate(leg.layout.defaults(), drive, 1e-3)
    nothing = _with(leg, "joint_elasticity", compliance=0.0, at="joint")
    assert np.array_equal(leg.simulate(nothing, drive, 1e-3), rigid)
    angle = leg.outputs.index("joint_angle")
    for place in ("belt", "joint"):
        for sensors in ("before", "beyond"):
            stiff = _with(
                leg, "joint_elasticity", compliance=1e-6, damping_time=0.002, at=place,
                sensors=sensors,
            )  # fmt: skip
            found = leg.simulate(stiff, drive, 1e-3)
            assert found[:, angle] == pytest.approx(rigid[:, angle], abs=2e-3)


@pytest.mark.slow  # compiles kernels
def test_a_link_begins_as_its_weight_bends_the_joint(leg: NetworkPlant) -> None:
    """The joint rests by its friction, the link hangs from it on the spring: nothing moves."""
    angle = 0.05
    weight = 2.0 * 9.80665 * 0.3 * np.sin(angle)
    assert weight < 0.5, "friction holds it"
    soft = _with(leg, "joint_elasticity", compliance=1 / 50.0, damping_time=0.0, at="joint")
    drive = Drive(TIME, {"current_command": np.zeros(TIME.size)}, {"joint_angle": angle})
    out = leg.simulate(soft, drive, 1e-3)[:, leg.outputs.index("joint_angle")]
    assert out == pytest.approx(angle, abs=1e-9)
    beyond = _with(
        leg, "joint_elasticity", compliance=1 / 50.0, damping_time=0.0, at="joint",
        sensors="beyond",
    )  # fmt: skip
    out = leg.simulate(beyond, drive, 1e-3)[:, leg.outputs.index("joint_angle")]
    assert out == pytest.approx(angle, abs=1e-6)


@pytest.mark.slow  # compiles kernels
def test_other_effects_keep_their_places(leg: NetworkPlant) -> None:
    soft = _with(leg, "joint_elasticity", compliance=1 / 50.0, damping_time=0.002, at="joint")
    layout, drive = leg.layout, Drive(TIME, COMMAND, {"joint_angle": 0.3})
    alone = leg.simulate(soft, drive, 1e-3)
    both = soft.copy()
    both[layout.index["coulomb_friction.friction_force"]] = 0.3
    angle = leg.outputs.index("joint_angle")
    assert np.ptp(leg.simulate(both, drive, 1e-3)[:, angle] - alone[:, angle]) > 1e-3


@pytest.mark.slow  # compiles kernels
def test_a_session_goes_on_as_a_simulation_does(leg: NetworkPlant) -> None:
    soft = _with(leg, "joint_elasticity", compliance=1 / 50.0, damping_time=0.002, at="belt")
    at = leg.at(soft)
    state, memory = at.start({"joint_angle": 0.1})
    assert state[at.state_places["joint_angle"]] == 0.1
    inputs = np.zeros((TIME.size, len(leg.inputs)))
    inputs[:, leg.inputs.index("current_command")] = COMMAND["current_command"]
    out = np.full((TIME.size, len(leg.outputs)), np.nan)
    for first, last in ((0, 100), (100, TIME.size - 1)):
        at.advance(
            first, last, TIME, inputs, False, False, 1e-3, first == 0, memory, state, out
        )  # fmt: skip
    whole = at.simulate(Drive(TIME, COMMAND), {"joint_angle": 0.1}, 1e-3)
    assert out[1:] == pytest.approx(whole[1:], abs=0.05 * float(np.ptp(whole)))


@pytest.mark.slow  # compiles kernels
@pytest.mark.parametrize("sensors", ["before", "beyond"])
def test_a_measured_motion_is_imposed_under_its_own_name(leg: NetworkPlant, sensors: str) -> None:
    soft = _with(
        leg, "joint_elasticity", compliance=1 / 50.0, damping_time=0.002, at="joint",
        sensors=sensors,
    )  # fmt: skip
    speed = 0.5 * np.sin(2.0 * np.pi * 3.0 * TIME)
    drive = Drive(TIME, {**COMMAND, "joint_speed": speed}, {"joint_angle": 0.1})
    out = leg.simulate(soft, drive, 1e-3)[:, leg.outputs.index("joint_angle")]
    turned = 0.1 + 0.5 * (1.0 - np.cos(2.0 * np.pi * 3.0 * TIME)) / (2.0 * np.pi * 3.0)
    assert out == pytest.approx(turned, abs=1e-4)
