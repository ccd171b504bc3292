"""A rig on the bus in a process of its own, and a drive in simulated time."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from eha_bench.control.controller_file import load_controllers
from eha_bench.core.shipped import shipped_file, shipped_rig
from eha_bench.core.trial import ControlMode
from eha_bench.plants.model import load_model
from eha_bench.rig.drive import DriveLimits, RigDrive
from eha_bench.rig.faults import Faults, parse_fault
from eha_bench.rig.log import RigLog
from eha_bench.rig.real_plant import RealPlant
from eha_bench.targets.can.drive import CanDrive, Frame, decode
from eha_bench.targets.can.load import load_drive


def relaxed(base: str, stale: str = "5 s", first_frames: str = "20 s") -> str:
    """Return lines of a target that let pass how long a busy machine stalls."""
    channels = load_drive(shipped_rig(base)).channels
    limits = "".join(f"  {name}: {{stale: {stale}}}\n" for name in channels)
    return (
        f"limits:\n{limits}following: {{}}\nstart: {{timeout: {first_frames}, enable: 10 s}}\n"
        "loop: {overruns: 1, lost: 1, late: 1}\n"
    )


class Bench:
    """The far side of a drive that is played in simulated time: a tick is 1 ms, exactly."""

    def __init__(self, drive: CanDrive, played: RigDrive, log: Path) -> None:
        self.drive = drive
        self.played = played
        self.now = 0.0
        self.readings: dict[str, float] = {}
        self.state = ""
        self._log = log

    def pass_time(self, until: float) -> None:
        """Let time pass without a frame."""
        while self.played.due <= until:
            self.now = max(self.played.due, self.now)
            self.played.pass_time(self.now)
            self.read()
        self.now = until
        self.played.pass_time(until)
        self.read()

    def read(self) -> None:
        """Take what the drive sends."""
        for frame in self.played.take_out():
            status = self.drive.status.get(frame.id)
            if status is None:
                continue
            signals = decode(status.message, frame.data)
            for channel, coding in status.channels.items():
                self.readings[channel] = coding.to_si(float(signals[coding.signal]))
            if status.message is self.drive.state.message:
                self.state = self.drive.states[self.drive.state.of(signals)]
        if {"pressure_a", "pressure_b"} <= self.readings.keys():
            difference = self.readings["pressure_a"] - self.readings["pressure_b"]
            self.readings["pressure_difference"] = difference

    def send(self, frame: Frame | None) -> None:
        """Send a frame now."""
        assert frame is not None
        self.played.receive(frame, self.now)
        self.read()

    def tick(self, number: int, mode: ControlMode, value: float, word: int) -> None:
        """Sync, then command, then 1 ms."""
        self.send(self.drive.sync_frame(number))
        self.send(self.drive.command_frame(mode, value, word))
        self.pass_time(self.now + 1e-3)

    def enable(self, mode: ControlMode = ControlMode.CURRENT, value: float = 0.0) -> None:
        """Take the drive to `enabled`."""
        for step in self.drive.file.control_word.enable:
            self.tick(0, mode, value, step.word)
        self.send(self.drive.sync_frame(0))

    @property
    def events(self) -> list[dict[str, Any]]:
        """The drive's log."""
        return [json.loads(line) for line in self._log.read_text(encoding="utf-8").splitlines()]


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Callable[..., Bench]]:
    """Make a bench with a drive in simulated time, and faults on request."""
    logs: list[RigLog] = []

    def make(*faults: str, target: str = "eha_drive.yaml", watchdog: float = 20e-3) -> Bench:
        drive = load_drive(shipped_rig(target))
        log = tmp_path / "rig.jsonl"
        logs.append(RigLog(log))
        played = RigDrive(
            drive,
            RealPlant(load_model(shipped_file("models/paper.yaml")), 0),
            load_controllers(shipped_file("controllers/paper.yaml")),
            Faults([parse_fault(text) for text in faults]),
            logs[-1],
            DriveLimits(watchdog=watchdog),
        )
        return Bench(drive, played, log)

    yield make
    for item in logs:
        item.close()


class RigProcess:
    """`eha-bench rig` as a user starts it, and runs against it."""

    def __init__(self, folder: Path, *options: str, base: str, more: str) -> None:
        self.log = folder / "rig.jsonl"
        self.folder = folder
        listen = () if "--listen" in options else ("--listen", "socket://127.0.0.1:0")
        drive = str(shipped_rig(base))
        self._process = subprocess.Popen(
            [sys.executable, "-m", "eha_bench", "rig", drive, "--log", str(self.log), "--for",
             "300 s", *listen, *options],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        assert self._process.stdout is not None
        self.channel = self._process.stdout.readline().strip()
        self.target = folder / "target.yaml"
        self.target.write_text(
            f"target: can\nbase: {drive}\nname: {folder.name}\n"
            f"bus: {{interface: slcan, channel: '{self.channel}'}}\n{more}",
            encoding="utf-8",
        )
        self._started: list[subprocess.Popen[str]] = []
        self.environment = {**os.environ, "EHA_BENCH_STATE": str(folder / "state"), "CI": "true"}

    def start(self, *words: object) -> subprocess.Popen[str]:
        """Start `eha-bench` with words."""
        process = subprocess.Popen(
            [sys.executable, "-m", "eha_bench", *map(str, words)],
            env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        self._started.append(process)
        return process

    def start_until_torque(self, *words: object, stays: float = 0.3) -> subprocess.Popen[str]:
        """Start a run and wait until its torque has been on for a while, in s.

        A machine that stalls for longer than the drive's watchdog ends a run as it should; then
        the rig is cleared and the run started again, a few times.
        """
        said = ""
        for _ in range(5):
            run = self.start(*words)
            until = time.monotonic() + 30.0
            while run.poll() is None and not self.torque_is_on() and time.monotonic() < until:
                time.sleep(0.02)
            time.sleep(stays)
            if run.poll() is None and self.torque_is_on():
                return run
            run.kill()
            said = "".join(run.communicate())
            self.do("clear", self.target, "--by", "Ada")
        raise AssertionError(f"no torque in five runs: {said}")

    def torque_is_on(self) -> bool:
        """Whether the drive's log says so."""
        return len(self.events("torque on")) > len(self.events("torque off"))

    def do(self, *words: object) -> tuple[int, str]:
        """Run `eha-bench` with words; return its status and what it says."""
        process = self.start(*words)
        out, said = process.communicate(timeout=120)
        assert "Traceback" not in said, said
        return process.returncode, said + out

    def now(self) -> float:
        """Return the time on the drive's clock, s."""
        return time.monotonic() - float(self.events("start")[0]["monotonic"])

    def events(self, kind: str) -> list[dict[str, Any]]:
        """Return the log's events of a kind."""
        lines = self.log.read_text(encoding="utf-8").splitlines()
        found = [json.loads(line) for line in lines if line.endswith("}")]
        return [event for event in found if event["event"] == kind]

    def close(self) -> None:
        """End the process, and benches that a failed test has left."""
        for bench in self._started:
            if bench.poll() is None:
                bench.kill()
                bench.communicate()
        self._process.terminate()
        self._process.wait(30)
        if self._process.stdout is not None:
            self._process.stdout.close()


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Callable[..., RigProcess]]:
    """Start rigs; they end with the test."""
    running: list[RigProcess] = []

    def start(*options: str, base: str = "eha_drive.yaml", more: str = "") -> RigProcess:
        folder = tmp_path / f"rig{len(running)}"
        folder.mkdir()
        running.append(RigProcess(folder, *options, base=base, more=more or relaxed(base)))
        return running[-1]

    yield start
    for item in running:
        item.close()


@pytest.fixture
def suite(tmp_path: Path) -> Callable[..., Path]:
    """Write a suite of one trial."""

    def write(
        duration: str = "0.3 s",
        rate: str = "200 Hz",
        mode: str = "current",
        signal: str = "{kind: step, final: 5 A, at: 50 ms}",
        more: str = "",
    ) -> Path:
        path = tmp_path / "suite.yaml"
        path.write_text(
            f"name: rig\ntrials:\n  - id: trial\n    mode: {mode}\n    duration: {duration}\n"
            f"    sample_rate: {rate}\n"
            "    setup: {piston: locked, initial: {piston_position: 0 mm}}\n"
            f"    signal: {signal}\n{more}",
            encoding="utf-8",
        )
        return path

    return write
