"""A number of a drawing that is declared wrongly, and that nobody asked to calibrate."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from eha_bench.api import next_experiment, run
from eha_bench.core.recording import Recording
from eha_bench.diagnosis.diagnose import diagnose
from eha_bench.diagnosis.outcome.diagnosis import Verdict
from eha_bench.diagnosis.outcome.rival import Standing
from eha_bench.experiment.proposal import ProposalEnding
from eha_bench.recordings import write
from eha_bench.report.diagnosis_text import headline

RATIO, TORQUE_CONSTANT = 9.0, 0.105
"""Of the leg that is recorded."""

PLANT = """\
plant: leg
nodes:
  shaft: {kind: rotation, inertia: 1.1e-4 kg*m^2}
  joint: {kind: rotation, inertia: 9e-3 kg*m^2}
elements:
  motor: {kind: motor, on: shaft, torque_constant: 0.1 N*m/A}
  gear:  {kind: gear, from: shaft, to: joint, ratio: %s}
  drag:  {kind: friction, on: shaft, coulomb: 0.03 N*m, viscous: 3e-4 N*m*s/rad}
  link:  {kind: pendulum, on: joint, mass: 1.4 kg, length: 0.2 m}
inputs: {current_command: motor.current}
channels: {joint_angle: joint.angle, motor_speed: shaft.speed}
calibrate:
  - {parameter: motor.torque_constant, within: 15 %%}
  - {parameter: joint.inertia, within: 30 %%}
  - {parameter: link.mass, within: 15 %%}
  - {parameter: drag.coulomb, within: 30 %%}
  - {parameter: drag.viscous, within: 30 %%}
"""


def recorded(name: str, folder: Path, number: int, scale: float) -> str:
    """Swing the leg by a current of three sines, and read it at 200 Hz; return the log's name.

    Args:
        name: of the run. folder: of the log. number: of the run, for its sines and its noise.
        scale: of the speed's readings.
    """
    noise = np.random.default_rng(number)
    step, every = 1e-4, 50
    time = np.arange(0.0, 2.5, step)
    current = sum(
        size * np.sin(2.0 * np.pi * rate * (1.0 + 0.13 * number) * time + number)
        for size, rate in ((1.6, 0.5), (1.2, 1.3), (0.8, 2.9))
    )
    # what is given is held from one reading to the next
    current = np.repeat(current[::every], every)
    inertia = 1.1e-4 * RATIO**2 + 9e-3 + 1.4 * 0.2**2
    angle = speed = 0.0
    read = []
    for k, value in enumerate(current):
        if k % every == 0:
            read.append((angle, RATIO * speed))
        torque = TORQUE_CONSTANT * value - 0.03 * np.tanh(RATIO * speed / 0.05)
        torque = RATIO * (torque - 3e-4 * RATIO * speed)
        speed += step * (torque - 1.4 * 9.80665 * 0.2 * np.sin(angle)) / inertia
        angle += step * speed
    angles, speeds = np.array(read).T
    recording = Recording(
        time[::every],
        {
            "current_command": current[::every],
            "joint_angle": angles + 1e-4 * noise.standard_normal(angles.size),
            "motor_speed": scale * (speeds + 0.1 * noise.standard_normal(speeds.size)),
        },
    )
    write(folder / f"{name}.mcap", recording)
    return f"{name}.mcap"


def dataset(folder: Path, ratio: str, scale: float = 1.0) -> Path:
    """Declare the leg with a ratio, and three runs of it, with a scale of the speed's readings."""
    (folder / "plant.yaml").write_text(PLANT % ratio, encoding="utf-8")
    runs = [
        f"  - {{log: {recorded(f'run{k}', folder, k, scale)}, "
        f"use: {'holdout' if k == 2 else 'train'}}}\n"
        for k in range(3)
    ]
    path = folder / "dataset.yaml"
    path.write_text(
        "model: plant.yaml\ninputs: [current_command]\nruns:\n" + "".join(runs), encoding="utf-8"
    )
    return path


@pytest.mark.slow(5)
def test_a_ratio_that_is_not_calibrated_is_named_with_its_value(tmp_path: Path) -> None:
    found = diagnose(dataset(tmp_path, "10"))
    assert found.verdict is Verdict.NONE
    (note,) = (note for note in found.notes if "gear.ratio" in note)
    said = re.match(r"CAUTION: gear.ratio is declared as 10, .*the data ask for ([\d.]+),", note)
    assert said is not None
    assert float(said[1]) == pytest.approx(RATIO, rel=0.01)
    assert found.corrected == {"gear.ratio": 10.0}
    speed = found.holdout["motor_speed"]
    assert speed.after < 0.1 * speed.before


@pytest.mark.slow(12)
def test_a_speed_of_another_scale_is_read_right_where_a_ratio_takes_others_too_far(
    tmp_path: Path,
) -> None:
    """A gear of 9 * 1.6 explains it as well, with a torque constant that is off by a third."""
    found = diagnose(dataset(tmp_path, "9", 1.6))
    assert found.verdict is Verdict.NONE
    assert not found.corrected
    assert len(found.misread) == 1
    (note,) = (note for note in found.notes if note.startswith("CAUTION: 'motor_speed' reads"))
    assert float(note.split(" reads ")[1].split(" ")[0]) == pytest.approx(1.6, rel=0.01)
    assert found.calibrated["motor.torque_constant"].value == pytest.approx(0.105, rel=0.05)
    # held-out runs are read right as well
    speed = found.holdout["motor_speed"]
    assert speed.after == pytest.approx(speed.before, rel=0.1)
    assert speed.after < 5.0 * speed.noise_floor


@pytest.mark.slow
def test_a_right_ratio_is_left_alone(tmp_path: Path) -> None:
    found = diagnose(dataset(tmp_path, "9"))
    assert found.verdict is Verdict.NONE
    assert not [note for note in found.notes if "gear.ratio" in note]


@pytest.mark.slow(5)
def test_a_number_that_others_make_up_for_is_named_where_these_are_not_as_believed(
    tmp_path: Path,
) -> None:
    """All torques are in proportion: a motor's constant makes all loads too large by a fourth."""
    path = dataset(tmp_path, "9")
    plant = (tmp_path / "plant.yaml").read_text(encoding="utf-8")
    plant = plant.replace("torque_constant: 0.1 N*m/A", "torque_constant: 0.131 N*m/A")
    plant = plant.replace("  - {parameter: motor.torque_constant, within: 15 %}\n", "")
    plant = re.sub(r"within: \d+ %", "within: 8 %", plant)
    (tmp_path / "plant.yaml").write_text(plant, encoding="utf-8")
    found = diagnose(path)
    assert found.verdict is Verdict.NONE
    (note,) = (note for note in found.notes if note.startswith("CAUTION: nothing is missing"))
    said = re.search(r"motor.torque_constant of ([\d.]+) N\*m/A, declared as 0.131 and not", note)
    assert said is not None
    assert float(said[1]) == pytest.approx(TORQUE_CONSTANT, rel=0.03)
    assert any("motor.torque_constant" in words for words in found.doubtful)
    status, verdict, _ = headline(found)
    assert status == "warned"
    assert "all would be as believed with motor.torque_constant" in verdict


PUMP = """\
plant: locked_pump
nodes:
  shaft:     {kind: rotation, inertia: 9e-4 kg*m^2}
  rod:       {kind: translation, mass: 55 kg, stroke: [-40 mm, 40 mm]}
  chamber_a: {kind: volume, bulk_modulus: 900 MPa, pressure: 0.6 MPa}
  chamber_b: {kind: volume, bulk_modulus: 900 MPa, pressure: 0.6 MPa}
  reservoir: {kind: reservoir, pressure: 6 bar}
elements:
  motor:    {kind: motor, on: shaft, torque_constant: 0.13 N*m/A}
  pump:     {kind: pump, on: shaft, from: chamber_b, to: chamber_a, displacement: 1.1e-7 m^3/rad}
  cylinder: {kind: cylinder, on: rod, a: chamber_a, b: chamber_b, area_a: 3.2 cm^2,
             area_b: 3.2 cm^2, volume_a: 16 cm^3, volume_b: 16 cm^3}
  drag:     {kind: friction, on: shaft, coulomb: 0.16 N*m, viscous: 0.005 N*m*s/rad}
  leak:     {kind: laminar_leakage, between: [chamber_a, chamber_b], conductance: 3e-14 m^3/(s*Pa)}
  suck_a:   {kind: check_valve, from: reservoir, to: chamber_a, conductance: 5e-10 m^3/(s*Pa)}
  suck_b:   {kind: check_valve, from: reservoir, to: chamber_b, conductance: 5e-10 m^3/(s*Pa)}
inputs:   {current_command: motor.current}
channels: {motor_speed: shaft.speed, pressure_a: chamber_a.pressure,
           pressure_b: chamber_b.pressure}
calibrate: [shaft.inertia, drag.viscous, drag.coulomb, leak.conductance,
            chamber_a.bulk_modulus, chamber_b.bulk_modulus]
"""
ONE_WAY = """\
name: one_way
defaults: {mode: current_command, sample_rate: 500 Hz, setup: {piston: locked}}
trials:
  - {id: a, duration: 4 s, signal: {kind: sine, amplitude: 4 A, offset: 6 A, frequency: 0.6 Hz}}
  - {id: b, duration: 4 s, signal: {kind: sine, amplitude: 3 A, offset: 6 A, frequency: 0.4 Hz}}
"""


@pytest.mark.slow(8)
def test_an_effect_that_explains_as_much_as_a_number_is_a_rival_to_separate(tmp_path: Path) -> None:
    """A pump that turns one way only: friction by the pressure is a smaller torque constant."""
    files = {
        "plant.yaml": PUMP,
        "truth.yaml": "model: plant.yaml\neffects:\n  - {effect: pressure_dependent_friction, "
                      "at: shaft, friction_coefficient: 0.06}\n",
        "rig.yaml": "target: simulator\nmodel: truth.yaml\n",
        "one_way.yaml": ONE_WAY,
        "limits.yaml": "name: limits\ndefaults: {mode: current_command, sample_rate: 500 Hz}\n"
                       "trials:\n  - {id: a, duration: 1 s, setup: {piston: locked},\n"
                       "     signal: {kind: constant, value: 0 A},\n"
                       "     safety: {pressure_a: <= 25 MPa, pressure_b: <= 25 MPa,\n"
                       "              current_command: -8 A .. 8 A}}\n",
        "dataset.yaml": "model: plant.yaml\ninputs: [current_command]\nruns:\n"
                        "  - {log: runs/recordings/a-0.mcap, piston: locked}\n"
                        "  - {log: runs/recordings/b-0.mcap, piston: locked, use: holdout}\n",
    }  # fmt: skip
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    run(tmp_path / "one_way.yaml", tmp_path / "rig.yaml", tmp_path / "runs")
    found = diagnose(tmp_path / "dataset.yaml", out=tmp_path / "diagnosis")
    assert found.verdict is Verdict.NONE
    # or the pump's displacement: what one turn of it takes is all that these runs show
    ((number, declared),) = found.corrected.items()
    said = f"do not distinguish {number} from pressure_dependent_friction"
    assert any(said in note for note in found.notes)
    equal = {item.cause: item for item in found.rivals if item.standing is not Standing.RUNNER_UP}
    assert {"none", "pressure_dependent_friction"} <= {*equal}
    # each has the number that it needs
    at = found.revised.plant.layout.index[number]
    needed = {name: item.model.vector()[at] / declared for name, item in equal.items()}
    assert needed["pressure_dependent_friction"] == pytest.approx(1.0)
    assert abs(needed["none"] - 1.0) > 0.03
    planned = next_experiment(tmp_path / "diagnosis", safety=tmp_path / "limits.yaml")
    assert planned.ending is ProposalEnding.PROPOSED
    assert set(planned.rivals) >= {"none", "pressure_dependent_friction"}
