"""Bench and rig as two processes over the bus, as a user runs them.

Nothing here asserts how fast this machine is. What has to hold in time is judged by the rig's own
log on its own clock.
"""

import json
import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import eha_bench as eb
from eha_bench.core.result import Result, Status

from .conftest import RigProcess, relaxed

Rigs = Callable[..., RigProcess]
Suites = Callable[..., Path]
BASE = "eha_drive.yaml"
LONG = {"duration": "60 s", "rate": "100 Hz"}


def wait_for(holds: Callable[[], object], seconds: float = 30.0) -> None:
    until = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < until, "it did not come"
        time.sleep(0.02)


@pytest.mark.slow
def test_a_run_leaves_scores_recordings_and_a_drive_without_torque(
    rig: Rigs, suite: Suites, tmp_path: Path
) -> None:
    played = rig("--watchdog", "2 s")
    accept = "    accept:\n      tracking_max: {channel: current, max: 12 A}\n"
    status, said = played.do(
        "run",
        suite(more=accept),
        "--target",
        played.target,
        "--out",
        tmp_path / "out",
        "--retries",
        3,
    )
    assert status == 0, said
    result = Result.read(tmp_path / "out" / "result.json")
    recording = eb.read(tmp_path / "out" / result.trials[0].recording)
    assert recording["current"][-5:].mean() == pytest.approx(5.0, abs=0.5)
    assert recording.metadata["ending"] == "complete"
    assert recording.metadata["safe_state"] == "confirmed by the drive"
    assert int(recording.metadata["loop_ticks"]) > 0
    assert float(recording.metadata["model.torque_constant"]) == pytest.approx(0.13)
    assert {"target.yaml", "drive.dbc", "trial.json"} <= recording.attachments.keys()
    assert not played.torque_is_on()
    assert not list((played.folder / "state").glob("*.latch"))


@pytest.mark.slow
def test_silence_stops_the_run_latches_the_rig_and_a_person_clears_it(
    rig: Rigs, suite: Suites, tmp_path: Path
) -> None:
    played = rig("--fault", "silent@0.1+4", "--watchdog", "2 s", more=relaxed(BASE, "0.5 s"))
    path, out = suite(**LONG), tmp_path / "out"
    words = ("run", path, "--target", played.target, "--out", out)
    status, said = played.do(*words)
    assert status == 3, said
    trial = Result.read(out / "result.json").trials[0]
    assert trial.status is Status.FAULT
    assert trial.reason
    recording = eb.read(out / trial.recording)
    assert recording.metadata["ending"] in ("safety stop", "fault")
    assert recording.metadata["ending_reason"] in trial.reason
    assert trial.reason.split(":")[0] in (out / "report.html").read_text(encoding="utf-8")
    assert "<error" in (out / "junit.xml").read_text(encoding="utf-8")
    assert not played.torque_is_on()
    status, said = played.do(*words)
    assert status == 3
    assert "latched" in said
    assert "clear" in said
    assert Result.read(out / "result.json").status is Status.FAULT
    for name in ("junit.xml", "summary.md", "report.html"):
        assert "latched" in (out / name).read_text(encoding="utf-8")
    wait_for(lambda: played.now() > played.events("injected")[0]["t"] + 4)
    status, said = played.do("clear", played.target, "--by", "Ada")
    assert status == 0, said
    assert "the latch reads" in said


@pytest.mark.slow
def test_a_killed_bench_leaves_no_torque_and_a_readable_recording(
    rig: Rigs, suite: Suites, tmp_path: Path
) -> None:
    # A machine busy with other tests stalls for longer than 20 ms: that figure is held in
    # simulated time (test_drive.py) and measured on a quiet machine (docs/rig.md).
    played = rig("--watchdog", "1 s")
    path, out = suite(**LONG), tmp_path / "out"
    run = played.start_until_torque("run", path, "--target", played.target, "--out", out)
    run.kill()
    run.communicate()
    wait_for(lambda: not played.torque_is_on())
    off = played.events("torque off")[-1]
    assert 0.9 <= off["t"] - off["last_command"] <= 1.5
    assert off["reason"] == "no command for too long"
    file = out / "recordings" / "trial-0.mcap"
    wait_for(lambda: "ending" in eb.read(file).metadata)
    recording = eb.read(file)
    assert recording.metadata["ending"] == "fault"
    status, said = played.do("score", file, "--out", tmp_path / "scored")
    assert status == 3, said
    assert Result.read(tmp_path / "scored" / "result.json").status is Status.FAULT
    status, said = played.do("run", path, "--target", played.target, "--out", out)
    assert status == 3
    assert "latched" in said


@pytest.fixture
def closed_terminal_is_heard() -> Iterator[None]:
    """What is started hears SIGHUP, also where the tests run under nohup: it would be inherited."""
    outside = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, outside)


@pytest.mark.slow
@pytest.mark.usefixtures("closed_terminal_is_heard")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_run_safely_and_latches_nothing(
    rig: Rigs, suite: Suites, tmp_path: Path, number: signal.Signals
) -> None:
    played = rig("--watchdog", "5 s")
    out = tmp_path / "out"
    words = ("run", suite(**LONG), "--target", played.target, "--out", out)
    run = played.start_until_torque(*words)
    run.send_signal(number)
    _, said = run.communicate(timeout=60)
    assert run.returncode == 130, said
    assert "interrupted" in said
    assert played.events("torque off")[-1]["reason"] == "control word 0"
    assert not list((played.folder / "state").glob("*.latch"))
    recording = eb.read(out / "recordings" / "trial-0.mcap")
    assert recording.metadata["ending"] == "interrupted"


@pytest.mark.slow
def test_a_stalled_recorder_ends_the_run_by_choice_and_quickly(
    rig: Rigs, suite: Suites, tmp_path: Path
) -> None:
    played = rig("--watchdog", "5 s")
    out = tmp_path / "out"
    run = played.start_until_torque(
        "run", suite(**LONG), "--target", played.target, "--out", out, stays=1.0
    )
    children = Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text().split()
    recorders = [
        int(pid)
        for pid in children
        if "targets.can.recorder" in Path(f"/proc/{pid}/cmdline").read_text()
    ]
    os.kill(recorders[0], signal.SIGSTOP)
    stopped, at = time.monotonic(), played.now()
    _, said = run.communicate(timeout=60)
    assert run.returncode == 3, said
    assert "recorder has stalled" in said
    off = played.events("torque off")[-1]
    assert off["reason"] == "control word 0"
    print(f"torque off {off['t'] - at:.3f} s, left {time.monotonic() - stopped:.3f} s")
    assert not list(tmp_path.rglob("*.part"))


@pytest.mark.slow(20)
def test_two_runs_never_share_a_rig_and_a_time_limit_holds(
    rig: Rigs, suite: Suites, tmp_path: Path
) -> None:
    played = rig("--watchdog", "5 s")
    path = suite(**LONG)
    first = played.start_until_torque(
        "run", path, "--target", played.target, "--out", tmp_path / "a", "--time-limit", "15 s"
    )
    status, said = played.do("run", path, "--target", played.target, "--out", tmp_path / "b")
    assert status == 3
    assert "in use by process" in said
    _, said = first.communicate(timeout=60)
    assert first.returncode == 1, said
    assert "the time limit of 15 s" in said
    assert not played.torque_is_on()


@pytest.mark.slow
def test_a_controller_that_fails_ends_safely(rig: Rigs, suite: Suites, tmp_path: Path) -> None:
    played = rig()
    (tmp_path / "broken.py").write_text(
        "from eha_bench.control.controller import Controller\n"
        "class Broken(Controller):\n"
        "    def __init__(self, gains, context):\n        self.left = 20\n"
        "    def step(self, reference, reading):\n"
        "        self.left -= 1\n        return 1.0 / self.left\n",
        encoding="utf-8",
    )
    (tmp_path / "controller.yaml").write_text(
        "current: {controller: broken:Broken}\n", encoding="utf-8"
    )
    text = played.target.read_text(encoding="utf-8")
    played.target.write_text(f"{text}controller: {tmp_path}/controller.yaml\n", encoding="utf-8")
    status, said = played.do(
        "run", suite(**LONG), "--target", played.target, "--out", tmp_path / "out"
    )
    assert status == 3
    assert "ZeroDivisionError" in said or played.events("state")[-1]["now"] == "fault"
    assert not played.torque_is_on()


@pytest.mark.slow
def test_a_start_up_check_comes_before_any_torque(rig: Rigs, suite: Suites, tmp_path: Path) -> None:
    for fault, more, word in (
        ("emergency-stop", relaxed(BASE), "emergency stop is open"),
        ("silent", relaxed(BASE, first_frames="2 s"), "does not answer"),
    ):
        played = rig("--fault", fault, more=more)
        status, said = played.do(
            "run", suite(), "--target", played.target, "--out", tmp_path / fault
        )
        assert status == 3
        assert word in said
        assert not played.events("torque on")
        assert not list((played.folder / "state").glob("*.latch"))


@pytest.mark.slow
def test_a_loop_that_is_not_healthy_is_not_scored_and_run_again(
    rig: Rigs, suite: Suites, tmp_path: Path
) -> None:
    more = relaxed(BASE).replace("lost: 1", "lost: 0.05")
    accept = "    accept:\n      tracking_max: {channel: current, max: 12 A}\n"
    path = suite(more=accept, duration="0.5 s", rate="1 kHz")
    for _ in range(3):  # a machine that stalls for longer than the watchdog bears stops the run
        played = rig("--fault", "lost=0.3", "--watchdog", "5 s", more=more)
        status, said = played.do(
            "run", path, "--target", played.target, "--out", tmp_path / "out", "--retries", 1
        )
        if status != 3:
            break
    assert status == 1, said
    result = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    trial = result["trials"][0]
    assert result["status"] == "incomplete"
    assert trial["reason"].startswith("not scored: loop")
    assert all(s["status"] == "not_scored" for s in trial["scores"] if s["limit"])
    assert any(note.startswith("run again") for note in trial["notes"])
    assert result["provenance"]["retries"] == "1"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("base", "control"), [("eha_drive.yaml", "host"), ("cia402_drive.yaml", "set-point")]
)
def test_both_drives_run_on_a_pseudo_terminal_in_both_modes(
    rig: Rigs, suite: Suites, tmp_path: Path, base: str, control: str
) -> None:
    more = f"{relaxed(base)}control: {control}\n"
    played = rig("--listen", f"pty:{tmp_path}/adapter", "--watchdog", "5 s", base=base, more=more)
    assert played.channel == f"{tmp_path}/adapter"
    path = suite(
        mode="motor_speed", signal="{kind: step, final: 4 rad/s, at: 50 ms}", rate="100 Hz"
    )
    status, said = played.do("run", path, "--target", played.target, "--out", tmp_path / "out")
    assert status == 0, said
    assert len(eb.read(tmp_path / "out" / "recordings" / "trial-0.mcap")) > 10
    assert not played.torque_is_on()


def test_a_dry_run_shows_frames_and_opens_nothing(
    suite: Suites, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from eha_bench.api import preview
    from eha_bench.core.shipped import shipped_rig

    lines = preview(suite(), shipped_rig("cia402_drive.yaml"))["trial"]
    text = "\n".join(lines)
    assert "205#060000000A until the drive is 'ready'" in text
    assert re.search(r"always at the end: 205#000000000A", text)
    assert "080#" in text
