"""A drive is its DBC and its target.yaml; what is wrong in them is said with file, line and key."""

from pathlib import Path

import pytest

from eha_bench.core.errors import InputError
from eha_bench.core.shipped import shipped_rig
from eha_bench.suites import load_suite
from eha_bench.targets.can.load import load_drive
from eha_bench.targets.resolve import open_target

from .conftest import Writer


@pytest.mark.parametrize("name", ["eha_drive.yaml", "cia402_drive.yaml"])
def test_the_shipped_drives_are_valid(name: str) -> None:
    drive = load_drive(shipped_rig(name))
    assert drive.states.keys() == set(drive.file.state.values.values())
    assert drive.model is not None
    assert drive.model.is_file()
    assert open_target(shipped_rig(name)).identity.digests.keys() >= {"dbc_sha256", "model_sha256"}


def test_keys_of_a_target_take_the_place_of_its_bases(target: Writer) -> None:
    drive = load_drive(target("control: set-point\nname: other\n"))
    assert drive.file.name == "other"
    assert drive.file.control == "set-point"
    assert drive.dbc == shipped_rig("eha_drive.yaml").parent / "eha_drive.dbc"


@pytest.mark.parametrize(
    ("more", "line", "said"),
    [
        ("limits: {current: {hi: 3 A}}", 3, "unknown key 'hi'"),
        ("name: a b", 3, "name"),
        (
            'bus: {interface: slcan, channel: "socket://192.0.2.1:1"}',
            3,
            "a network cannot keep a drive safe",
        ),
        ("dbc: missing.dbc", 3, "missing.dbc"),
        ("heartbeat: {message: Hearbeat, timeout: 1 s}", 3, "Heartbeat"),
        ("fault_code: {message: Heartbeat, signal: Code}", 3, "no signal 'Code'"),
        ("limits:\n  presure_a: {high: 3 Pa}", 4, "pressure_a"),
        ("sync: {message: Sync, counter: Count}", 3, "Counter"),
        ("counters: {Heartbeat: Alive}", 3, "not a message with channels"),
        ("state: {message: DriveStatus2, signal: State, values: {off: 0, enabled: 1}}", 3, "fault"),
        (
            "control_word: {signal: Control, enable: [{word: 1, state: on}], disable: 0, reset: 2}",
            3,
            "unknown state 'on'",
        ),
        (
            "channels: {current: {message: DriveStatus1, signal: MotorCurrent, unit: V}}\n"
            "counters: {}\nlimits: {}\nfollowing: {}",
            3,
            "dimension",
        ),
        ("commands: {current: {message: Sync, signal: Counter, unit: A}}", 3, "Control"),
    ],
)
def test_a_mistake_is_said_with_its_place(target: Writer, more: str, line: int, said: str) -> None:
    path = target(more + "\n")
    with pytest.raises(InputError) as error:
        open_target(path)
    assert said in str(error.value)
    base = said == "Control"  # where the key in question stands in the base
    assert f"{shipped_rig('eha_drive.yaml') if base else path}:" in str(error.value)
    assert base or f":{line}" in str(error.value)


def test_a_target_is_not_its_own_base(tmp_path: Path) -> None:
    path = tmp_path / "self.yaml"
    path.write_text("target: can\nbase: self.yaml\n", encoding="utf-8")
    with pytest.raises(InputError, match="own base"):
        load_drive(path)


def test_a_dbc_that_is_none_is_an_error(tmp_path: Path, target: Writer) -> None:
    (tmp_path / "bad.dbc").write_text("this is not a DBC {", encoding="utf-8")
    with pytest.raises(InputError, match="not a DBC"):
        load_drive(target("dbc: bad.dbc\n"))


def test_a_drive_takes_its_command_by_either_name() -> None:
    """A suite may ask for `current_command`; the drive's own word for it is `current`."""
    target = open_target(shipped_rig("eha_drive.yaml"))
    lines = []
    for mode in ("current", "current_command"):
        signal = {"kind": "constant", "value": "1 A"}
        setup = {"piston": "locked"}
        only = {"id": "a", "mode": mode, "duration": "10 ms", "setup": setup, "signal": signal}
        (trial,) = load_suite({"name": "next", "trials": [only]}).trials
        target.check(trial)
        lines.append([line for line in target.preview(trial) if "(1 A)" in line])
    assert lines[0] == lines[1] != []
