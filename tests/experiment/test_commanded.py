"""What an experiment commands: a command, what a servo follows, or a motion that a rig imposes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from experiment_question import rival, write_question

import eha_bench as eb
from eha_bench.core.errors import InputError
from eha_bench.core.trial import Bypass, Piston
from eha_bench.core.yaml_file import load
from eha_bench.experiment.commanded import Commanded
from eha_bench.experiment.hypothesis import read_question
from eha_bench.experiment.permitted import Limit
from eha_bench.experiment.proposal import ProposalEnding
from eha_bench.experiment.response import Bench, Responses, respond
from eha_bench.suites import load_suite
from eha_bench.targets.resolve import open_target
from imposed_plants import PUMPED, SEAL

PUMPED_AT = {
    "motor_speed": (-40.0, 40.0),
    "pressure_a": (-2e6, 3e6),
    "pressure_b": (-2e6, 3e6),
    "piston_position": (-0.05, 0.05),
}
SERVO = """\
plant: servo
nodes:
  shaft:  {kind: rotation}
  output: {kind: rotation, inertia: 0.03 kg*m^2}
elements:
  motor: {kind: motor, on: shaft, resistance: 2.3 ohm, torque_constant: 0.0083 N*m/A,
          supply_voltage: 12 V}
  gear:  {kind: gear, from: shaft, to: output, ratio: 193}
  drag:  {kind: friction, on: output, coulomb: 0.05 N*m, viscous: 0.1 N*m*s/rad}
  loop:  {kind: position_servo, on: output, motor: motor, proportional: 6 1/rad, period: 1 ms}
inputs:   {goal: {to: loop.reference, between_samples: hold}}
channels: {angle: output.angle, speed: output.speed}
"""
SERVO_AT = {"goal": (0.5, 1.5), "angle": (0.4, 1.6), "speed": (-4.0, 4.0)}


def responses(
    folder: Path, how: str, value: str, limits: Mapping[str, Limit] | None = None
) -> tuple[Responses, tuple[str, ...]]:
    """Return what a trial of 0.2 s at a constant value is foreseen to record, and its channels."""
    question = read_question(folder)
    rivals, commanded = question.rivals, Commanded.of(question)
    plant = rivals[0].model.plant
    bench = Bench.of(question.covered, plant, commanded.channel)
    (folder / "hold.yaml").write_text(
        f"name: next\ntrials:\n  - {{id: hold, {how}, duration: 0.2 s,"
        f" signal: {{kind: constant, value: {value}}}}}\n"
    )
    trial = load_suite(folder / "hold.yaml").trials[0]
    draws = [np.zeros((1, len(rivals[0].keys)))]
    return respond(rivals, draws, trial, bench, limits or {}, commanded), tuple(plant.outputs)


def test_a_measured_pump_speed_is_what_the_experiment_asks_for(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(PUMPED)
    plant, known = str(tmp_path / "plant.yaml"), ("drag.coulomb", "drag.viscous")
    rivals = [
        rival("asymmetric_friction", {"asymmetry": 0.4}, source=plant, known=known),
        rival(None, source=plant, known=known),
    ]
    noise = {"pressure_a": 1e4, "pressure_b": 1e4, "piston_position": 2e-5}
    folder = write_question(
        tmp_path / "diagnosis", rivals, noise=noise, extremes=PUMPED_AT, command="motor_speed",
        piston="free",
    )  # fmt: skip
    found = eb.next_experiment(folder, tmp_path / "next.yaml", budget=3.0)
    assert found.ending is ProposalEnding.PROPOSED
    suite = load_suite(tmp_path / "next.yaml")
    (tmp_path / "rig.yaml").write_text("target: simulator\nmodel: plant.yaml\n")
    rig = open_target(str(tmp_path / "rig.yaml"))
    for trial in suite.trials:
        assert trial.mode.name == "motor_speed"
        assert np.abs(trial.reference(trial.clock())).max() <= 40.0
        rig.check(trial)
        assert rig.run(trial, 0).ending == "complete"
    content = load(tmp_path / "next-dataset.yaml")
    assert list(content["inputs"]) == ["motor_speed"]


@pytest.mark.parametrize(("limit", "low", "high"), [
    ("-25 rad/s .. 25 rad/s", -25.0, 25.0),
    ("<= 25 rad/s", -30.0, 25.0),
    (None, -30.0, 30.0),
])  # fmt: skip
def test_an_imposed_motion_keeps_its_own_limit_by_its_sensors_noise(
    tmp_path: Path, limit: str | None, low: float, high: float
) -> None:
    (tmp_path / "plant.yaml").write_text(PUMPED)
    plant, known = str(tmp_path / "plant.yaml"), ("drag.coulomb", "drag.viscous")
    rivals = [
        rival("asymmetric_friction", {"asymmetry": 0.4}, source=plant, known=known),
        rival(None, source=plant, known=known),
    ]
    sigma = 0.1
    folder = write_question(
        tmp_path / "diagnosis", rivals,
        noise={"pressure_a": 1e4, "pressure_b": 1e4, "piston_position": 2e-5},
        extremes={**PUMPED_AT, "motor_speed": (-30.0, 30.0)}, input_noise={"motor_speed": sigma},
        command="motor_speed", piston="free",
    )  # fmt: skip
    safety = None
    if limit is not None:
        safety = tmp_path / "safe.yaml"
        safety.write_text(
            "name: safe\ntrials:\n  - {id: a, mode: motor_speed, duration: 1 s, setup: {piston: "
            f"free}}, signal: {{kind: constant, value: 0 rad/s}}, safety: {{motor_speed: {limit}, "
            "pressure_a: -10 MPa .. 10 MPa, piston_position: -90 mm .. 90 mm}}\n"
        )
    found = eb.next_experiment(folder, tmp_path / "next.yaml", budget=3.0, safety=safety)
    assert found.ending is ProposalEnding.PROPOSED
    for trial in load_suite(tmp_path / "next.yaml").trials:
        reference = trial.reference(trial.clock())
        assert reference.min() >= low + 4 * sigma
        assert reference.max() <= high - 4 * sigma
        (carried,) = [item for item in trial.safety if item.channel == "motor_speed"]
        assert carried.bounds.high <= high + 4 * sigma
        assert carried.bounds.low <= low + 4 * sigma
        rooms = {room.channel: room for room in found.trials[0].rooms}
        assert 0.0 < rooms["motor_speed"].used <= 1.0


def test_a_servo_is_asked_through_its_own_loop_and_starts_where_it_is_asked_to_be(
    tmp_path: Path,
) -> None:
    (tmp_path / "plant.yaml").write_text(SERVO)
    plant, known = str(tmp_path / "plant.yaml"), ("drag.viscous",)
    rivals = [
        rival("command_delay", {"delay": 8e-3}, source=plant, known=known),
        rival("current_lag", {"time_constant": 8e-3}, source=plant, known=known),
    ]
    noise = {"angle": 1e-3, "speed": 2e-2}
    folder = write_question(
        tmp_path / "diagnosis", rivals, noise=noise, extremes=SERVO_AT, command="goal",
        piston="free",
    )  # fmt: skip
    question = read_question(folder)
    assert Commanded.of(question).follows == "angle"
    found = eb.next_experiment(folder, tmp_path / "next.yaml", budget=4.0)
    assert found.ending is ProposalEnding.PROPOSED
    assert " rad" in found.trials[0].words
    (tmp_path / "rig.yaml").write_text("target: simulator\nmodel: plant.yaml\n")
    rig = open_target(str(tmp_path / "rig.yaml"))
    for trial in load_suite(tmp_path / "next.yaml").trials:
        assert trial.mode.name == "goal"
        reference = trial.reference(trial.clock())
        assert reference.min() >= 0.5
        assert reference.max() <= 1.5
        recording = rig.run(trial, 0).recording
        assert recording["angle"][0] == pytest.approx(reference[0])


def test_an_imposed_position_is_asked_for_nothing_that_jumps(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(SEAL)
    plant, known = str(tmp_path / "plant.yaml"), ("seal.coulomb", "seal.viscous")
    rivals = [
        rival("asymmetric_friction", {"asymmetry": 0.3}, source=plant, known=known),
        rival(None, source=plant, known=known),
    ]
    folder = write_question(
        tmp_path / "diagnosis", rivals, noise={"cell_force": 0.1},
        extremes={"carriage_position": (-0.02, 0.02), "cell_force": (-40.0, 40.0)},
        command="carriage_position", piston="free",
    )  # fmt: skip
    found = eb.next_experiment(folder, tmp_path / "next.yaml", budget=6.0)
    assert found.ending is ProposalEnding.PROPOSED
    for trial in load_suite(tmp_path / "next.yaml").trials:
        reference = trial.reference(trial.clock())
        assert np.abs(np.diff(reference)).max() < 1e-3


def test_what_nothing_can_command_is_refused(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(
        "plant: tank\nnodes:\n  tank: {kind: volume, bulk_modulus: 1 GPa, volume: 1e-3 m^3}\n"
        "  drain: {kind: reservoir, pressure: 0 bar}\n"
        "elements:\n"
        "  leak: {kind: laminar_leakage, between: [tank, drain], conductance: 1e-12 m^3/(s*Pa)}\n"
        "inputs: {drain_pressure: drain.pressure}\nchannels: {pressure_a: tank.pressure}\n"
    )
    plant = str(tmp_path / "plant.yaml")
    folder = write_question(
        tmp_path / "diagnosis", [rival(None, source=plant, known=("leak.conductance",))],
        noise={"pressure_a": 1e4},
        extremes={"pressure_a": (0.0, 1e6), "drain_pressure": (0.0, 1e5)},
        command="drain_pressure", piston="free",
    )  # fmt: skip
    with pytest.raises(InputError, match=r"is a motion that a rig could impose: drain_pressure"):
        eb.next_experiment(folder, tmp_path / "next.yaml")


def test_a_trial_starts_from_the_pressures_that_recordings_began_with(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(PUMPED)
    plant, known = str(tmp_path / "plant.yaml"), ("drag.coulomb",)
    began = {"pressure_a": 5.0e6, "pressure_b": 5.1e6, "motor_speed": 0.0, "piston_position": 0.03}
    folder = write_question(
        tmp_path / "diagnosis",
        [rival("gravity_load", {"gravity_force": 60.0}, source=plant, known=known)],
        noise={"pressure_a": 1e4, "piston_position": 2e-5}, extremes=PUMPED_AT, starts=began,
        command="motor_speed", piston="free",
    )  # fmt: skip
    found, outputs = responses(folder, "mode: motor_speed", "20 rad/s")
    readings = dict(zip(outputs, found.outputs[0][0].T, strict=True))
    # friction holds the weight: nothing has moved on the way, and nothing was commanded yet
    assert readings["pressure_a"][0] == pytest.approx(5.0e6, abs=2e5)
    assert readings["piston_position"][0] == 0.0
    assert readings["motor_speed"][0] == pytest.approx(20.0)
    assert readings["piston_position"][-1] > 1e-3


def test_what_is_predicted_beyond_the_recordings_is_less_certain() -> None:
    setup = (Piston.FREE, Bypass.CLOSED)
    bench = Bench(
        ("speed",), np.array([0.1]), {}, {}, 1000.0, recorded={setup: {"speed": (-4.0, 6.0)}}
    )
    inside = bench.beyond(setup, {"speed": np.array([-3.0, 6.0])})
    assert inside.noise == pytest.approx([0.1])
    # 10 further up and 2 further down: 1 % of 12, of which 20 ms are as one sample
    outside = bench.beyond(setup, {"speed": np.array([-6.0, 16.0])})
    assert outside.noise == pytest.approx([np.hypot(0.1, np.sqrt(20.0) * 0.12)])
    never = bench.beyond((Piston.LOCKED, Bypass.CLOSED), {"speed": np.array([0.0, 10.0])})
    assert never.noise == pytest.approx([np.hypot(0.1, np.sqrt(20.0) * 0.1)])


def test_a_locked_trial_keeps_its_limits_also_where_nothing_was_commanded_before_it(
    tmp_path: Path,
) -> None:
    """Recordings at rest under 6 A: a rig that is switched off before a trial jumps to them."""
    at_rest = {"current_command": 6.0, "pressure_a": 8e6, "pressure_b": 0.6e6}
    folder = write_question(
        tmp_path / "diagnosis", [rival("command_delay", {"delay": 4e-3})], starts=at_rest
    )
    limits = {"motor_speed": Limit(-5.0, 5.0)}
    found, outputs = responses(folder, "mode: current, setup: {piston: locked}", "6 A", limits)
    column = outputs.index("motor_speed")
    assert np.abs(found.outputs[0][:, :, column]).max() < 1.0
    assert found.rooms[0].high > 15.0
    assert not found.safe


@pytest.mark.parametrize(("piston", "command", "cases"), [
    # under 6 A: switched off, and never used yet
    ("locked", 6.0, [(6.0, True), (0.0, True), (0.0, False)]),
    # what is hardly a command: as at rest
    ("locked", 0.01, [(0.01, True), (0.0, True)]),
    # it was moving: what it is at rest is not in the log
    ("free", None, [(0.0, True), (0.0, False)]),
    # it holds a weight, and would fall without its command
    ("free", 6.0, [(6.0, True)]),
])  # fmt: skip
def test_how_a_machine_may_stand_before_a_trial(
    tmp_path: Path, piston: str, command: float | None, cases: list[tuple[float, bool]]
) -> None:
    folder = write_question(tmp_path / "diagnosis", [rival("command_delay", {"delay": 4e-3})])
    commanded = Commanded.of(read_question(folder))
    (tmp_path / "hold.yaml").write_text(
        f"name: next\ntrials:\n  - {{id: hold, mode: current, setup: {{piston: {piston}}}, "
        "duration: 0.2 s, signal: {kind: constant, value: 6 A}}\n"
    )
    trial = load_suite(tmp_path / "hold.yaml").trials[0]
    pressures = {"pressure_a": 8e6, "pressure_b": 0.6e6}
    own = {} if command is None else {commanded.channel: command}
    found = commanded.before(trial, np.full(20, 6.0), {**pressures, **own})
    assert [(case.command, bool(case.pressures)) for case in found] == cases
    assert all(case.pressures in ({}, pressures) for case in found)


def test_a_lower_limit_is_that_of_a_machine_that_nobody_has_used_yet(tmp_path: Path) -> None:
    """Recordings began at 8 and 3 MPa under a command: at rest both chambers hold less."""
    at_rest = {"current_command": 6.0, "pressure_a": 8e6, "pressure_b": 3e6}
    folder = write_question(
        tmp_path / "diagnosis", [rival("command_delay", {"delay": 4e-3})], starts=at_rest
    )
    limits = {"pressure_b": Limit(2e6, 30e6)}
    found, _ = responses(folder, "mode: current, setup: {piston: locked}", "6 A", limits)
    assert found.rooms[0].low < 1e6
    assert not found.safe


@pytest.mark.parametrize(("measured", "mode"), [(False, "current_command"), (True, "current")])
def test_a_command_is_called_by_what_was_recorded(
    tmp_path: Path, measured: bool, mode: str
) -> None:
    """A machine without a sensor of its current has no channel `current` to ask for."""
    (tmp_path / "log.csv").write_text("t,i,w\n" + "".join(f"{k / 100},{k},0\n" for k in range(20)))
    own = "current: {column: i, unit: A}, " if measured else ""
    (tmp_path / "channels.yaml").write_text(
        f"time: {{column: t, unit: s}}\nchannels: {{{own}current_command: {{column: i, unit: A}}, "
        "motor_speed: {column: w, unit: rad/s}}\n"
    )
    (tmp_path / "dataset.yaml").write_text(
        "model: paper\ninputs: [current_command]\nchannels: channels.yaml\n"
        "runs: [{log: log.csv, use: train}]\n"
    )
    folder = write_question(tmp_path / "diagnosis", [rival("command_delay", {"delay": 4e-3})])
    file = folder / "diagnosis.json"
    content = json.loads(file.read_text())
    content["covered"]["dataset"] = str(tmp_path / "dataset.yaml")
    file.write_text(json.dumps(content))
    assert Commanded.of(read_question(folder)).mode == mode
