"""The simulator runs suites on any plant: its channels, its command, its units."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from strangers_plant import installed

import eha_bench
from eha_bench.core.errors import InputError
from eha_bench.plants.model import Model, load_model
from eha_bench.plants.plant import Drive
from eha_bench.suites import load_suite

DRIVE_MODEL = """\
model: linear_drive
parameters: {coulomb_friction: 20 N, voltage_limit: 10 V}
"""
DRIVE_CONTROLLER = """\
piston_position:
  controller: pid
  k_p: 39 kV/m
  k_i: 50 kV/(m*s)
  k_d: 243 V*s/m
  filter_time: 1 ms
"""
DRIVE_SUITE = """\
name: drive
model: model.yaml
controller: controller.yaml
trials:
  - id: step
    mode: piston_position
    duration: 0.5 s
    signal: {kind: step, initial: 0 mm, final: 2 mm, at: 10 ms}
    accept:
      response_time: <= 100 ms
      overshoot: <= 30 %
      steady_state_error: +- 0.2 mm
    safety: {piston_position: +- 100 mm}
  - id: start
    mode: piston_position
    duration: 50 ms
    signal: {kind: constant, value: 3 mm}
    accept: {tracking_max: <= 0.1 mm}
  - id: push
    mode: voltage
    duration: 0.2 s
    signal: {kind: step, initial: 0 V, final: 5 V, at: 10 ms}
"""
FLAP_CONTROLLER = """\
flap_angle: {controller: pid, k_p: 20 V/rad, k_i: 0.1 V/(deg*s), output_limit: 5 V}
spool_position: {controller: pid, k_p: 1 V/mm, k_f: 10 V/mm}
"""
FLAP_SUITE = """\
name: flap
model: model.yaml
controller: controller.yaml
defaults: {duration: 0.4 s}
trials:
  - id: turn
    mode: flap_angle
    setup: {initial: {flap_angle: 5 deg}}
    signal: {kind: step, initial: 5 deg, final: 20 deg, at: 10 ms}
    accept:
      response_time: <= 0.3 s
      peak: 19 deg .. 25 deg
      tracking_max: {channel: flap_angle, limit: <= 16 deg}
    scores: [steady_state_error]
    safety: {spool_position: +- 1.2 mm}
    matters: {steady_state_error: 0.1 deg}
  - id: open
    mode: spool_position
    signal: {kind: step, final: 0.5 mm, at: 10 ms}
    accept: {rise_time: <= 20 ms}
  - id: push
    mode: valve_command
    signal: {kind: sine, amplitude: 2 V, frequency: 5 Hz, cycles: 2}
"""


def write_drive(folder: Path) -> Path:
    (folder / "model.yaml").write_text(DRIVE_MODEL)
    (folder / "controller.yaml").write_text(DRIVE_CONTROLLER)
    (folder / "suite.yaml").write_text(DRIVE_SUITE)
    return folder / "suite.yaml"


@pytest.fixture
def flap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with the suite of a plant that a package of somebody else provides."""
    (tmp_path / "model.yaml").write_text("model: flap\n")
    (tmp_path / "controller.yaml").write_text(FLAP_CONTROLLER)
    (tmp_path / "suite.yaml").write_text(FLAP_SUITE)
    with installed(tmp_path / "site", monkeypatch):
        yield tmp_path
    for name in [name for name in sys.modules if name.startswith("flap_bench")]:
        del sys.modules[name]


def rewritten(path: Path, old: str, new: str) -> Path:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    return path


def test_a_linear_drive_is_positioned_and_pushed(tmp_path: Path) -> None:
    result = eha_bench.run(write_drive(tmp_path), out=tmp_path / "out")
    assert result.status.value == "passed"
    scores = {(run.id, s.metric, s.channel): s for run in result.trials for s in run.scores}
    assert scores["step", "response_time", "piston_position"].value < 0.1
    recording = eha_bench.read(tmp_path / "out/recordings/step-0.mcap")
    assert {"voltage", "piston_position", "piston_velocity"} <= set(recording.values)
    assert "current_command" not in recording
    assert recording.units["reference"] == "m"
    start = eha_bench.read(tmp_path / "out/recordings/start-0.mcap")
    assert start["piston_position"][0] == pytest.approx(3e-3, abs=3e-5)
    report = (tmp_path / "out/report.html").read_text()
    assert "Piston position: step 0 → 2" in report
    assert "Voltage: step 0 → 5" in report


def test_a_recorded_push_is_what_the_plant_computes_from_its_voltage(tmp_path: Path) -> None:
    write_drive(tmp_path)
    (tmp_path / "target.yaml").write_text(
        "target: simulator\nmodel: model.yaml\ncontroller: controller.yaml\nsensors: {}\n"
    )
    eha_bench.run(tmp_path / "suite.yaml", tmp_path / "target.yaml", tmp_path / "out")
    recording = eha_bench.read(tmp_path / "out/recordings/push-0.mcap")
    model = load_model(tmp_path / "model.yaml")
    drive = Drive(recording.time, {"voltage": recording["voltage"]})
    whole = model.plant.simulate(model.vector(), drive, 12.5e-6)
    np.testing.assert_allclose(recording["piston_position"], whole[:, 1], atol=1e-12)


def test_a_strangers_plant_runs_with_limits_and_a_report(flap: Path) -> None:
    result = eha_bench.run(flap / "suite.yaml", out=flap / "out")
    assert result.status.value == "passed"
    recording = eha_bench.read(flap / "out/recordings/turn-0.mcap")
    assert dict(recording.units) == {
        "reference": "rad", "valve_command": "V", "spool_position": "m", "flap_angle": "rad",
    }  # fmt: skip
    assert recording["flap_angle"][0] == pytest.approx(math.radians(5.0))
    assert np.abs(recording["valve_command"]).max() <= 5.0
    unit = {s.metric: s.unit for s in result.trials[0].scores}
    assert (unit["peak"], unit["steady_state_error"], unit["tracking_max"]) == ("rad",) * 3
    report = (flap / "out/report.html").read_text()
    assert "flap_angle: step 5 → 20" in report
    assert "19 deg … 25 deg" in report.replace("\N{NO-BREAK SPACE}", " ")
    again = eha_bench.read(flap / "out/recordings/open-0.mcap")
    assert json.loads(again.attachments["trial.json"])["unit"] == "m"


def test_a_plant_in_python_is_simulated_whole_as_well(flap: Path) -> None:
    model = Model("flap")
    time = np.arange(50) * 1e-3
    drive = Drive(time, {"valve_command": np.full(50, 2.0), "wind": np.full(50, 0.1)})
    found = model.plant.simulate(model.vector(), drive, 1e-4)
    opened = 2e-4 * (1.0 - np.exp(-time / 5e-3))
    np.testing.assert_allclose(found[:, 0], opened, atol=1e-15)
    angle = 5e3 * (2e-4 * time - 5e-3 * opened) + 0.1 * time
    np.testing.assert_allclose(found[:, 1], angle, atol=1e-12)
    with pytest.raises(InputError, match="'voltage' cannot be an input of flap"):
        model.plant.simulate(model.vector(), Drive(time, {"voltage": time}), 1e-4)


@pytest.mark.parametrize(
    ("file", "old", "new", "line", "key", "says"),
    [
        ("suite", "mode: flap_angle", "mode: flap_angel", 7, "trials.turn.mode",
         "'flap_angle'"),
        ("suite", "final: 0.5 mm", "final: 0.5 kg", 18, "trials.open.mode",
         "spool_position in kg, and flap has it in m"),
        ("suite", "{flap_angle: 5 deg}", "{flap_angle: 5 mm}", None, "",
         "flap_angle in m, and flap has it in rad"),
        ("suite", "{flap_angle: 5 deg}", "{flap_angle: 90 deg}", None, None, "flap_angle"),
        ("suite", "{flap_angle: 5 deg}", "{wind: 1}", None, None, "which is not a state of flap"),
        ("suite", "+- 1.2 mm}", "+- 1.2 bar}", None, "",
         "spool_position in Pa, and flap has it in m"),
        ("suite", "peak: 19 deg .. 25 deg", "peak: 19 mm .. 25 mm", 12, "trials.turn.accept.peak",
         "wrong dimension"),
        ("suite", "initial: 5 deg, final", "initial: 5 mm, final", 9, "trials.turn.signal.final",
         "wrong dimension"),
        ("suite", "mode: valve_command", "mode: voltage", 22, "trials.push.mode",
         "controls voltage, which flap does not have"),
        ("suite", "mode: spool_position", "setup: {piston: locked}\n    mode: spool_position",
         None, None, "nothing to lock"),
        ("controller", "20 V/rad", "20 V/m", 1, "flap_angle.k_p", "wrong dimension"),
        ("controller", "20 V/rad", "20 V/turnip", 1, "flap_angle.k_p", "turnip"),
        ("controller", "output_limit: 5 V", "output_limit: 0 V", 1, "flap_angle.output_limit",
         "not above 0"),
        ("controller", "spool_position:", "spool_postion:", None, None,
         "no controller for mode 'spool_position'"),
    ],
)  # fmt: skip
def test_what_does_not_suit_the_plant_is_refused_before_a_run(
    flap: Path, file: str, old: str, new: str, line: int | None, key: str | None, says: str
) -> None:
    path = rewritten(flap / f"{file}.yaml", old, new)
    with pytest.raises(InputError, match=says) as refused:
        eha_bench.run(flap / "suite.yaml", out=flap / "out")
    if line is not None:
        assert refused.value.where.file == str(path)
        assert (refused.value.where.line, refused.value.where.key) == (line, key)
    assert not (flap / "out").exists()


def test_sensors_of_a_strangers_channel_are_in_its_unit(flap: Path) -> None:
    target = flap / "target.yaml"
    target.write_text(
        "target: simulator\nmodel: model.yaml\ncontroller: controller.yaml\n"
        "sensors:\n  spool_position: {noise: 2 um}\n"
    )
    eha_bench.run(flap / "suite.yaml", target, flap / "out")
    recording = eha_bench.read(flap / "out/recordings/open-0.mcap")
    assert np.std(recording["spool_position"][:10]) == pytest.approx(2e-6, rel=0.6)
    rewritten(target, "2 um", "2 bar")
    with pytest.raises(InputError, match="wrong dimension") as refused:
        eha_bench.run(flap / "suite.yaml", target, flap / "out")
    assert (refused.value.where.line, refused.value.where.key) == (5, "sensors.spool_position")


def test_quantities_without_a_unit_are_taken_in_that_of_the_plant(flap: Path) -> None:
    rewritten(flap / "suite.yaml", "{kind: step, final: 0.5 mm", "{kind: step, final: 0.5e-3")
    assert load_suite(flap / "suite.yaml").trials[1].mode.declared is None
    eha_bench.run(flap / "suite.yaml", out=flap / "out")
    recording = eha_bench.read(flap / "out/recordings/open-0.mcap")
    assert recording.units["reference"] == "m"


def test_a_trial_on_a_strangers_channel_is_scored_from_its_recording(flap: Path) -> None:
    first = eha_bench.run(flap / "suite.yaml", out=flap / "out").trials[0]
    recording = eha_bench.read(flap / "out/recordings/turn-0.mcap")
    trial = eha_bench.suites.trial_from_source(recording.attachments["trial.json"].decode())
    assert trial == load_suite(flap / "suite.yaml").trials[0]
    found = {(s.metric, s.channel): s for s in eha_bench.score(recording, trial)}
    for score in first.scores:
        again = found[score.metric, score.channel]
        assert again.unit == score.unit
        np.testing.assert_equal(again.value, score.value)
