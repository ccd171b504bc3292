"""An elastic coupling between two shafts: its swing, its play, and steps that resolve it."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.plants.elements.coupling import force_on_first, force_on_second, transmitted
from eha_bench.plants.network.file import load_plant
from eha_bench.plants.plant import Drive

JOINT = """\
plant: series_elastic
nodes:
  motor_side: {kind: rotation, inertia: 0.02 kg*m^2}
  link:       {kind: rotation, inertia: 0.08 kg*m^2}
elements:
  motor:  {kind: motor, on: motor_side, torque_constant: 1 N*m/A}
  spring: {kind: coupling, between: [motor_side, link], stiffness: 400 N*m/rad MORE}
inputs:   {current_command: motor.current}
channels: {motor_angle: motor_side.angle, angle: link.angle, spring_torque: spring.force}
"""

sizes = st.floats(-1.0, 1.0)


@given(bent=sizes, rate=sizes, play=st.floats(0.0, 0.5))
def test_it_pushes_equally_and_never_pulls_across_its_play(
    bent: float, rate: float, play: float
) -> None:
    state = {"position_first": bent, "position_second": 0.0, "speed_first": rate,
             "speed_second": 0.0, "stiffness": 50.0, "damping": 3.0, "play": play}  # fmt: skip
    force = force_on_second(**state)
    assert force_on_first(**state) == -force
    if play == 0.0:
        assert force == pytest.approx(50.0 * bent + 3.0 * rate)
    elif abs(bent) <= 0.5 * play:
        assert force == 0.0
    else:
        assert force * bent >= 0.0


def test_a_hand_worked_force() -> None:
    # 0.03 rad apart with a play of 0.02 rad: 0.02 rad of it bend the teeth
    assert transmitted(0.03, 0.0, 1e3, 5.0, 0.02) == pytest.approx(20.0)
    assert transmitted(-0.03, -0.5, 1e3, 5.0, 0.02) == pytest.approx(-22.5)


def _plant(tmp_path: Path, more: str = ""):
    (tmp_path / "plant.yaml").write_text(JOINT.replace(" MORE", more))
    return load_plant(tmp_path / "plant.yaml")


@pytest.mark.slow  # compiles a kernel
def test_two_shafts_swing_against_each_other(tmp_path: Path) -> None:
    plant = _plant(tmp_path)
    time = np.arange(0.0, 1.0, 1e-3)
    drive = Drive(time, {"current_command": np.zeros(time.size)})
    start = {"motor_angle": 0.02, "angle": 0.0}
    torque = plant.at(plant.layout.defaults()).simulate(drive, start, 2e-4)[
        :, plant.outputs.index("spring_torque")
    ]
    # sqrt(k (1 / J_1 + 1 / J_2)) = 158.1 rad/s
    swing = 8.0 * np.cos(np.sqrt(400.0 * (1 / 0.02 + 1 / 0.08)) * time)
    assert torque == pytest.approx(swing, abs=0.25)


@pytest.mark.slow  # compiles a kernel
def test_a_step_resolves_what_is_stiffer_than_it(tmp_path: Path) -> None:
    plant = _plant(tmp_path, ", damping: 0.4 N*m*s/rad")
    vector = plant.layout.defaults()
    vector[plant.layout.index["spring.stiffness"]] = 4e7
    time = np.arange(0.0, 0.2, 1e-2)
    drive = Drive(time, {"current_command": np.full(time.size, 2.0)})
    out = plant.at(vector).simulate(drive, {"motor_angle": 0.0, "angle": 0.0}, 3.4e-4)
    # rigid: 2 N*m turn 0.1 kg*m^2
    assert out[:, plant.outputs.index("angle")] == pytest.approx(0.5 * 20.0 * time**2, abs=1e-4)


@pytest.mark.slow  # compiles a kernel
def test_the_link_waits_until_the_play_is_crossed(tmp_path: Path) -> None:
    plant = _plant(tmp_path, ", damping: 2 N*m*s/rad, play: 0.1 rad")
    time = np.arange(0.0, 0.4, 1e-3)
    drive = Drive(time, {"current_command": np.full(time.size, 0.2)})
    out = plant.at(plant.layout.defaults()).simulate(
        drive, {"motor_angle": -0.05, "angle": 0.0}, 1e-4
    )
    motor, link = (out[:, plant.outputs.index(name)] for name in ("motor_angle", "angle"))
    # the motor's side alone is accelerated over 0.1 rad by 10 rad/s^2
    meets = np.sqrt(2.0 * 0.1 / 10.0)
    assert link[time < meets - 2e-3] == pytest.approx(0.0, abs=1e-6)
    assert motor[time < meets - 2e-3] == pytest.approx(
        -0.05 + 5.0 * time[time < meets - 2e-3] ** 2, abs=1e-4
    )
    assert link[-1] > 0.1


def test_what_a_force_tells_of_the_other_side(tmp_path: Path) -> None:
    plant = _plant(tmp_path, ", play: 0.02 rad")
    found = plant.through_parts(
        plant.layout.defaults(), {"motor_angle": 1.0, "spring_torque": -4.0}
    )
    # 0.01 rad of bending, and half of the play
    assert found["angle"] == pytest.approx(1.0 + 0.01 + 0.01)


@pytest.mark.slow  # compiles a kernel
def test_a_missing_play_is_the_declared_one(tmp_path: Path) -> None:
    """A lever of 10 mrad play, swung to and fro: the effect's play is that of the element."""
    time = np.arange(0.0, 1.0, 1e-3)
    drive = Drive(time, {"current_command": 0.5 * np.sin(12.0 * time)})
    start = {"motor_angle": 0.0, "angle": 0.0}
    declared = _plant(tmp_path, ", damping: 2 N*m*s/rad, play: 0.01 rad")
    there = declared.at(declared.layout.defaults()).simulate(drive, start, 2e-4)
    plant = _plant(tmp_path, ", damping: 2 N*m*s/rad")
    vector = plant.layout.defaults()
    assert plant.at(vector).simulate(drive, start, 2e-4) != pytest.approx(there, abs=1e-4)
    vector[plant.layout.index["coupling_backlash.play"]] = 0.01
    np.testing.assert_allclose(plant.at(vector).simulate(drive, start, 2e-4), there, atol=1e-9)


def test_what_is_bolted_on_changes_with_the_part_that_no_motor_drives(tmp_path: Path) -> None:
    assert _plant(tmp_path).changed_between_runs == ("link.inertia",)
