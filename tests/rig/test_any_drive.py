"""A drive that is not a knee: a voltage in, a carriage's position and a channel of its own out."""

import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from eha_bench.control.controller_file import load_controllers
from eha_bench.core.errors import InputError
from eha_bench.core.trial import ControlMode
from eha_bench.plants.model import load_model
from eha_bench.rig.drive import RigDrive
from eha_bench.rig.faults import Faults, parse_fault
from eha_bench.rig.log import RigLog
from eha_bench.rig.process import Rig, RigOptions
from eha_bench.rig.real_plant import RealPlant
from eha_bench.suites import load_suite
from eha_bench.targets.can.load import load_drive
from eha_bench.targets.resolve import open_target

from .conftest import Bench

DBC = """\
VERSION ""
NS_ :
BS_:
BU_: BENCH DRIVE
BO_ 128 Sync: 1 BENCH
 SG_ Counter : 0|8@1+ (1,0) [0|255] "" DRIVE
BO_ 513 Command: 6 BENCH
 SG_ Control : 0|8@1+ (1,0) [0|255] "" DRIVE
 SG_ Mode M : 8|8@1+ (1,0) [0|1] "" DRIVE
 SG_ Voltage m0 : 16|32@1- (0.000001,0) [-20|20] "V" DRIVE
 SG_ Position m1 : 16|32@1- (0.000001,0) [-500|500] "mm" DRIVE
BO_ 385 Status: 8 DRIVE
 SG_ Position : 0|24@1- (0.0001,0) [-500|500] "mm" BENCH
 SG_ Warmth : 24|16@1- (0.01,0) [-100|300] "degC" BENCH
 SG_ State : 40|4@1+ (1,0) [0|15] "" BENCH
 SG_ Number : 48|8@1+ (1,0) [0|255] "" BENCH
"""
TARGET = """\
target: can
name: carriage
dbc: carriage.dbc
bus: {interface: slcan, channel: "socket://127.0.0.1:28733", bitrate: 1000000}
control: host
model: model.yaml
controller: controller.yaml
sync: {message: Sync, counter: Counter}
channels:
  piston_position: {message: Status, signal: Position, unit: mm}
  winding_temperature: {message: Status, signal: Warmth, unit: degC}
counters: {Status: Number}
commands:
  voltage: {message: Command, signal: Voltage, unit: V, with: {Mode: 0}}
  piston_position: {message: Command, signal: Position, unit: mm, with: {Mode: 1}}
state: {message: Status, signal: State, values: {"off": 0, enabled: 1, fault: 2}}
control_word: {signal: Control, enable: [{word: 1, state: enabled}], disable: 0, reset: 2}
setup: {piston: free, bypass: closed}
limits: {winding_temperature: {high: 120 degC, rate: 5 K/s}}
"""
SUITE = """\
name: carriage
trials:
  - id: step
    mode: piston_position
    setup: {initial: {piston_position: 0 mm}}
    duration: 0.3 s
    signal: {kind: step, final: 2 mm, at: 10 ms}
    safety: {winding_temperature: <= 100 degC}
  - id: push
    mode: voltage
    setup: {initial: {piston_position: 0 mm}}
    duration: 0.1 s
    signal: {kind: step, final: 5 V, at: 10 ms}
"""
FILES = {
    "carriage.dbc": DBC,
    "carriage.yaml": TARGET,
    "suite.yaml": SUITE,
    "model.yaml": "model: linear_drive\nparameters: {voltage_limit: 10 V}\n",
    "controller.yaml": "piston_position: {controller: pid, k_p: 39 kV/m, k_d: 243 V*s/m}\n",
}
VOLTAGE = ControlMode("voltage")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.fixture
def bench(folder: Path) -> Iterator[Bench]:
    drive, log = load_drive(folder / "carriage.yaml"), folder / "rig.jsonl"
    with_log = RigLog(log)
    played = RigDrive(
        drive,
        RealPlant(load_model(folder / "model.yaml"), 0),
        load_controllers(folder / "controller.yaml"),
        Faults([]),
        with_log,
    )
    yield Bench(drive, played, log)
    with_log.close()


def test_a_voltage_moves_the_carriage_as_the_model_says(bench: Bench) -> None:
    bench.enable(VOLTAGE)
    start = bench.readings["piston_position"]
    for tick in range(500):
        bench.tick(tick, VOLTAGE, 5.0, 1)
    assert bench.state == "enabled"
    # F = 35.15 N/V * 5 V against 203.5 N s/m, from rest: x = v (t - tau (1 - exp(-t / tau)))
    tau, speed = 95.11 / 203.5, 35.15065188248547 * 5.0 / 203.5
    expected = speed * (0.5 - tau * (1.0 - math.exp(-0.5 / tau)))
    assert bench.readings["piston_position"] - start == pytest.approx(expected, rel=0.01)


def test_the_drive_closes_the_loop_itself(bench: Bench) -> None:
    mode = ControlMode.PISTON_POSITION
    bench.enable(mode)
    for tick in range(600):
        bench.tick(tick, mode, 2e-3, 1)
    assert bench.readings["piston_position"] == pytest.approx(2e-3, abs=2e-5)


def check(folder: Path) -> None:
    target = open_target(folder / "carriage.yaml")
    for trial in load_suite(folder / "suite.yaml").trials:
        target.check(trial)


def test_trials_are_checked_and_previewed(folder: Path) -> None:
    target = open_target(folder / "carriage.yaml")
    step, push = load_suite(folder / "suite.yaml").trials
    for trial in (step, push):
        target.check(trial)
    assert any("at most 10 V" in line for line in target.preview(step))
    assert any("5 V" in line for line in target.preview(push))


@pytest.mark.parametrize(
    ("file", "old", "new", "says"),
    [
        ("suite", "<= 100 degC", "<= 100 mm", "winding_temperature in m, and the drive"),
        ("suite", "mode: voltage", "mode: valve_command", "controls valve_command, which"),
        (
            "carriage",
            "unit: degC}\ncounters",
            "unit: turnip}\ncounters",
            r"carriage.yaml:11, key 'channels.winding_temperature.unit': unknown",
        ),
        ("carriage", "  winding_temperature:", "  pressure_c:", "did you mean 'pressure"),
        ("controller", "39 kV/m", "39 kA/m", "wrong dimension"),
    ],
)
def test_what_does_not_fit_is_refused(
    folder: Path, file: str, old: str, new: str, says: str
) -> None:
    path = folder / f"{file}.yaml"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=says):
        check(folder)


def test_the_rig_refuses_a_model_that_does_not_hang_on_the_drive(folder: Path) -> None:
    (folder / "model.yaml").write_text("model: eha_knee\n")
    with pytest.raises(InputError, match="commanded by voltage, and the model's plant by current"):
        Rig(folder / "carriage.yaml", RigOptions())
    (folder / "model.yaml").write_text(FILES["model.yaml"])
    with pytest.raises(InputError, match="no pressure_a"):
        Rig(folder / "carriage.yaml", RigOptions(faults=(parse_fault("over-pressure@1 s"),)))
