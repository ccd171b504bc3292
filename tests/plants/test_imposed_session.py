"""A session of a machine that nothing commands: a motion of one of its parts is imposed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import eha_bench as eb
from eha_bench.core.errors import InputError
from eha_bench.plants.model import Model, load_model
from eha_bench.plants.plant import Drive
from eha_bench.plants.session import Session
from eha_bench.recordings import read
from imposed_plants import PUMPED, SEAL

STEP = 1e-4
SUITE = """\
name: speeds
defaults: {sample_rate: 500 Hz}
trials:
  - {id: sine, mode: MODE, duration: 1 s, signal: {kind: sine, amplitude: AMPLITUDE,
     frequency: 1 Hz}}
"""


@pytest.fixture
def pumped(tmp_path: Path) -> Model:
    (tmp_path / "plant.yaml").write_text(PUMPED)
    return load_model(tmp_path / "plant.yaml")


def test_moment_by_moment_is_the_whole_simulation(pumped: Model) -> None:
    plant, vector = pumped.plant, pumped.vector()
    time = np.arange(400) * 2e-3
    # straight: a speed that bends does so between its samples only where the next one is known
    speed = 30.0 - 90.0 * time
    whole = plant.simulate(vector, Drive(time, {"motor_speed": speed}), STEP)
    going = Session(plant, vector, {"motor_speed": speed[0]}, step=STEP, command="motor_speed")
    for k in range(time.size - 1):
        np.testing.assert_allclose(going.reading, whole[k], rtol=1e-9, atol=1e-9)
        # an imposed speed is there at the end of the time that it was given for
        going.advance(time[k + 1], speed[k + 1])
    np.testing.assert_allclose(going.reading, whole[-1], rtol=1e-9, atol=1e-9)
    assert np.ptp(whole[:, plant.outputs.index("piston_position")]) > 5e-3


def test_a_rod_that_is_moved_does_not_jump(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(SEAL)
    model = load_model(tmp_path / "plant.yaml")
    going = Session(model.plant, model.vector(), {}, step=STEP, command="carriage_position")
    forces = []
    for k in range(1, 200):
        going.advance(1e-3 * k, 0.05 * 1e-3 * k)
        forces.append(float(going.reading[1]))
    # 0.05 m/s: 20 N and 5 N, not the force of a step every millisecond
    assert np.abs(forces[-50:]) == pytest.approx(25.0, rel=0.01)


def test_a_suite_imposes_the_speed_of_a_pump(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(PUMPED)
    (tmp_path / "rig.yaml").write_text(
        "target: simulator\nmodel: plant.yaml\nsensors: {motor_speed: {noise: 0.01 rad/s}}\n"
    )
    speeds = SUITE.replace("MODE", "motor_speed").replace("AMPLITUDE", "20 rad/s")
    (tmp_path / "suite.yaml").write_text(speeds)
    eb.run(tmp_path / "suite.yaml", tmp_path / "rig.yaml", tmp_path / "out")
    recording = read(tmp_path / "out/recordings/sine-0.mcap")
    apart = recording["motor_speed"] - recording["reference"]
    # what is recorded was measured: with its noise, and one sample behind what was asked for
    assert 0.0 < np.abs(apart).max() < 0.02 * 20.0 + 0.1
    assert np.ptp(recording["piston_position"]) > 1e-3


def test_a_rod_starts_beside_a_carriage_that_starts_far_away(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(SEAL)
    (tmp_path / "rig.yaml").write_text("target: simulator\nmodel: plant.yaml\nsensors: {}\n")
    sine = "{kind: sine, amplitude: 5 mm, offset: 100 mm, frequency: 1 Hz}"
    (tmp_path / "suite.yaml").write_text(
        "name: far\ntrials:\n  - {id: far, mode: carriage_position, duration: 1 s, "
        f"signal: {sine}}}\n"
    )
    eb.run(tmp_path / "suite.yaml", tmp_path / "rig.yaml", tmp_path / "out")
    recording = read(tmp_path / "out/recordings/far-0.mcap")
    assert recording["carriage_position"][0] == pytest.approx(0.1)
    # 0.031 m/s: 20 N and 3 N of friction, and not 4 kN of a bent load cell
    assert np.abs(recording["cell_force"]).max() < 30.0


def test_an_imposed_position_that_jumps_is_refused(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(SEAL)
    (tmp_path / "rig.yaml").write_text("target: simulator\nmodel: plant.yaml\n")
    (tmp_path / "suite.yaml").write_text(
        "name: jump\ntrials:\n  - {id: jump, mode: carriage_position, duration: 1 s, "
        "signal: {kind: step, final: 10 mm, at: 0.1 s}}\n"
    )
    with pytest.raises(InputError, match=r"lets the imposed carriage_position jump at 0.1 s") as no:
        eb.run(tmp_path / "suite.yaml", tmp_path / "rig.yaml", tmp_path / "out")
    assert no.value.where.line == 3
    assert not (tmp_path / "out").exists()


def test_a_controller_of_an_imposed_motion_is_refused(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(PUMPED)
    (tmp_path / "control.yaml").write_text("motor_speed: {controller: pid, k_p: 1}\n")
    (tmp_path / "rig.yaml").write_text(
        "target: simulator\nmodel: plant.yaml\ncontroller: control.yaml\n"
    )
    speeds = SUITE.replace("MODE", "motor_speed").replace("AMPLITUDE", "20 rad/s")
    (tmp_path / "suite.yaml").write_text(speeds)
    with pytest.raises(InputError, match="the controller for that mode would do nothing"):
        eb.run(tmp_path / "suite.yaml", tmp_path / "rig.yaml", tmp_path / "out")
    # nor are its gains varied, also not those of the shipped file
    (tmp_path / "over.yaml").write_text("over: {gains: {motor_speed.k_p: [1, 2]}}\n")
    (tmp_path / "plain.yaml").write_text("target: simulator\nmodel: plant.yaml\n")
    with pytest.raises(InputError, match="no controller closes that loop"):
        eb.sweep(tmp_path / "suite.yaml", tmp_path / "over.yaml", tmp_path / "plain.yaml",
                 tmp_path / "sweep")  # fmt: skip


@pytest.mark.parametrize(
    ("mode", "amplitude"), [("pressure", "1 MPa"), ("piston_position", "1 mm")]
)
def test_what_cannot_be_imposed_is_refused(tmp_path: Path, mode: str, amplitude: str) -> None:
    # with its position alone imposed, the speed of the shaft would be anybody's guess
    (tmp_path / "plant.yaml").write_text(PUMPED)
    (tmp_path / "rig.yaml").write_text("target: simulator\nmodel: plant.yaml\n")
    text = SUITE.replace("MODE", mode).replace("AMPLITUDE", amplitude)
    (tmp_path / "suite.yaml").write_text(text)
    with pytest.raises(InputError, match="no input that a controller commands") as no:
        eb.run(tmp_path / "suite.yaml", tmp_path / "rig.yaml", tmp_path / "out")
    assert "with `mode: motor_speed`" in str(no.value)
    assert no.value.where.file.endswith("suite.yaml")
