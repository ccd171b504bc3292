"""`python -m benchmarks.rig_safety`: what happens to the torque when something goes wrong.

Bench and rig run as two processes. For every fault, for signals, for `kill -9` of the bench at
random moments and for a full disk the time from the cause to torque off is read from the rig's own
log, and exit status, reason and recording are looked at. The last part runs for minutes at 1 kHz.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.table import Row, write_rows

import eha_bench as eb
from eha_bench.core.errors import EhaBenchError
from eha_bench.core.shipped import shipped_rig
from eha_bench.targets.can.load import load_drive

SUITE = """\
name: safety
trials:
  - id: {name}
    mode: {mode}
    setup: {setup}
    duration: {duration} s
    signal: {signal}
"""
PRESSURE = {
    "mode": "pressure",
    "setup": "{piston: locked, initial: {piston_position: 0 mm}}",
    "signal": "{kind: sine, amplitude: 8 MPa, offset: 10 MPa, frequency: 3 Hz}",
}
KNEE = {
    "mode": "joint_angle",
    "setup": "{piston: free, initial: {joint_angle: 90 deg}}",
    "signal": "{kind: sine, amplitude: 20 deg, offset: 90 deg, frequency: 0.8 Hz}",
}
ROWS: list[Row] = []
"""What is found, for the table of all benchmarks."""
LONGEST = 20e-3
"""s until the torque has to be off."""


@dataclass(frozen=True)
class Case:
    """A fault, and the trial in which it happens."""

    fault: str
    trial: dict[str, str]
    stops: bool = True


FAULTS = (
    Case("silent@0.5", PRESSURE),
    Case("frozen=pressure_a@0.5", PRESSURE),
    Case("frozen=motor_speed@0.5", PRESSURE),
    Case("frozen=piston_position@0.5", KNEE),
    Case("frozen=joint_angle@0.5", KNEE),
    Case("late=30ms@0.5", PRESSURE),
    Case("late=3ms@0.5", PRESSURE, stops=False),
    Case("lost=0.9@0.5", PRESSURE),
    Case("lost=0.1@0.5", PRESSURE, stops=False),
    Case("scale=pressure_a:3@0.5", PRESSURE),
    Case("scale=joint_angle:1.1@0.5", KNEE),
    Case("scale=current:-1@0.5", PRESSURE),
    Case("scale=motor_speed:3@0.5", PRESSURE),
    Case("scale=piston_velocity:0@0.5", KNEE),
    Case("over-pressure@0.5", PRESSURE),
    Case("bus-off@0.5", PRESSURE),
    Case("emergency-stop@0.5", PRESSURE),
)


class Rig:
    """A rig in a process of its own, on a free port of 127.0.0.1."""

    def __init__(self, folder: Path, *faults: str, watchdog: str = "20 ms") -> None:
        self._folder = folder
        self.log = folder / "rig.jsonl"
        options = [word for fault in faults for word in ("--fault", fault)]
        command = [sys.executable, "-m", "eha_bench", "rig", "--listen", "socket://127.0.0.1:0"]
        self._process = subprocess.Popen(
            [*command, "--log", str(self.log), "--watchdog", watchdog, *options],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        assert self._process.stdout is not None
        channel = self._process.stdout.readline().strip()
        self.target = folder / "target.yaml"
        self.target.write_text(
            f"target: can\nbase: {shipped_rig('eha_drive.yaml')}\nname: {folder.name}\n"
            f"bus: {{interface: slcan, channel: '{channel}'}}\n",
            encoding="utf-8",
        )
        self.environment = {**os.environ, "EHA_BENCH_STATE": str(folder / "state")}

    @property
    def pid(self) -> int:
        """The process."""
        return self._process.pid

    def events(self) -> list[dict[str, object]]:
        """Return the log's events so far."""
        lines = self.log.read_text(encoding="utf-8").splitlines() if self.log.exists() else []
        return [json.loads(line) for line in lines if line.endswith("}")]

    def start(
        self, suite: Path, out: Path, *options: str, before: str = ""
    ) -> subprocess.Popen[str]:
        """Start a run against this rig; `before` is a shell command for its process."""
        words = [
            sys.executable,
            "-m",
            "eha_bench",
            "run",
            suite,
            "--target",
            self.target,
            "--out",
            out,
            *options,
        ]
        command = [str(word) for word in words]
        if before:
            command = ["/bin/sh", "-c", f'{before}; exec "$@"', "sh", *command]
        return subprocess.Popen(
            command,
            env=self.environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

    def clear(self) -> None:
        """Clear latch and fault as a person would."""
        subprocess.run(
            [sys.executable, "-m", "eha_bench", "clear", str(self.target), "--by", "benchmark"],
            env=self.environment, check=True, capture_output=True,
        )  # fmt: skip

    def close(self) -> None:
        """End the process."""
        self._process.terminate()
        self._process.wait(20)


def suite_of(folder: Path, name: str, trial: dict[str, str], duration: float) -> Path:
    """Write a suite of one trial."""
    path = folder / f"{name}.yaml"
    path.write_text(SUITE.format(name=name, duration=duration, **trial), encoding="utf-8")
    return path


def last(events: list[dict[str, object]], kind: str) -> dict[str, object]:
    """Return the last event of a kind, or an empty one."""
    return next((event for event in reversed(events) if event["event"] == kind), {})


def number(event: dict[str, object], key: str) -> float:
    """Return a time of an event, NaN where it is not there."""
    value = event.get(key)
    return float(value) if isinstance(value, (int, float)) else float("nan")


def read_back(path: Path) -> str:
    """Return how many ticks of a recording can be read, and how it says that it ended."""
    try:
        recording = eb.read(path)
    except EhaBenchError as error:
        return f"not readable: {error}"
    return f"{len(recording)} ticks, {recording.metadata.get('ending', 'no ending')}"


def recorded(path: Path) -> tuple[float, str]:
    """Return the time of a recording's last tick, s, and how it says that it ended.

    One that was stopped before its first tick was written holds none: all of them are missing.
    """
    try:
        recording = eb.read(path)
    except EhaBenchError as error:
        if "it has no samples" not in str(error):
            raise
        return 0.0, "before the first tick"
    return float(recording.time[-1]), recording.metadata.get("ending", "")


def faults(folder: Path) -> bool:
    """Run every fault; return whether every one that has to stop the torque did so in time."""
    print("| fault | torque off after | exit | reason | recording |\n|---|---|---|---|---|")
    kept, worst, good = True, 0.0, 0
    for index, case in enumerate(FAULTS):
        here = folder / f"fault{index}"
        here.mkdir()
        rig = Rig(here, case.fault)
        suite = suite_of(here, "trial", case.trial, 1.5)
        run = rig.start(suite, here / "out")
        run.communicate()
        time.sleep(0.1)
        rig.close()
        events = rig.events()
        off, injected = last(events, "torque off"), last(events, "injected")
        passed = number(off, "t") - number(injected, "t")
        result = json.loads((here / "out" / "result.json").read_text(encoding="utf-8"))
        reason = result["trials"][0]["reason"] if result["trials"] else ""
        right = passed <= LONGEST and run.returncode == 3 if case.stops else run.returncode == 1
        worst, good = max(worst, passed) if case.stops else worst, good + right
        kept &= right
        shown = f"{passed * 1e3:.1f} ms" if case.stops else "at the end"
        recording = read_back(here / "out" / "recordings" / "trial-0.mcap")
        print(
            f"| `{case.fault}` | {shown} | {run.returncode} | {reason} | {recording} |", flush=True
        )
    ROWS.append(
        Row("rig: torque off after the slowest fault", worst * 1e3, "ms", "<", LONGEST * 1e3)
    )
    ROWS.append(Row("rig: faults that end as they have to", good, "", ">", len(FAULTS)))
    return kept


def interrupted(folder: Path, rounds: int, how: signal.Signals, seed: int) -> bool:
    """Send a signal to the bench at random moments; return whether the torque was off in time."""
    here = folder / f"signal{int(how)}"
    here.mkdir()
    rig, draw = Rig(here), random.Random(seed)
    suite = suite_of(here, "trial", PRESSURE, 30.0)
    after_cause, after_command, ticks, statuses, endings = [], [], [], set(), set()
    for index in range(rounds):
        before = len([e for e in rig.events() if e["event"] == "torque on"])
        run = rig.start(suite, here / f"out{index}")
        wait_for(lambda n=before: len([e for e in rig.events() if e["event"] == "torque on"]) > n)
        time.sleep(draw.uniform(0.05, 1.5))
        started = number(last(rig.events(), "start"), "monotonic")
        sent = time.monotonic() - started
        run.send_signal(how)
        run.communicate()
        time.sleep(0.15)
        off = last(rig.events(), "torque off")
        after_cause.append(number(off, "t") - sent)
        after_command.append(number(off, "t") - number(off, "last_command"))
        statuses.add(run.returncode)
        path = here / f"out{index}" / "recordings" / "trial-0.mcap"
        wait_for(lambda p=path: "ticks, " in read_back(p) and "no ending" not in read_back(p))
        on = number(last(rig.events(), "torque on"), "t")
        until, ending = recorded(path)
        ticks.append((number(off, "last_command") - on) - until)
        endings.add(ending)
        if how is signal.SIGKILL:
            again = rig.start(suite, here / "again")
            statuses.add(f"next run {again.wait(30)}")
            rig.clear()
    rig.close()
    print(
        f"| {how.name} x {rounds} | {max(after_cause) * 1e3:.1f} ms after the signal "
        f"(median {statistics.median(after_cause) * 1e3:.1f}), "
        f"{max(after_command) * 1e3:.2f} ms after the last command | "
        f"{', '.join(map(str, sorted(statuses, key=str)))} | {', '.join(sorted(endings))} | "
        f"at most {max(ticks) * 1e3:.0f} ms of ticks missing |", flush=True
    )  # fmt: skip
    found = max(after_command) * 1e3
    ROWS.append(
        Row(f"rig: torque off after {how.name} x {rounds}", found, "ms", "<", LONGEST * 1e3)
    )
    return max(after_command) <= LONGEST + 1e-6


def wait_for(holds: Callable[[], bool], timeout: float = 30.0) -> None:
    """Wait until something holds."""
    until = time.monotonic() + timeout
    while not holds() and time.monotonic() < until:
        time.sleep(0.02)


def full_disk(folder: Path) -> bool:
    """Let the recording's files grow to 60 kB at most; return whether the run ended safely."""
    here = folder / "disk"
    here.mkdir()
    rig = Rig(here)
    suite = suite_of(here, "trial", PRESSURE, 5.0)
    run = rig.start(suite, here / "out", before="ulimit -f 120")
    _, said = run.communicate()
    time.sleep(0.1)
    rig.close()
    off = last(rig.events(), "torque off")
    path = here / "out" / "recordings" / "trial-0.mcap"
    print(
        f"| full disk | {(number(off, 't') - number(off, 'last_command')) * 1e3:.2f} ms after the "
        f"last command | {run.returncode} | {' '.join(said.split())[:160]} | {read_back(path)} |"
    )
    ROWS.append(Row("rig: exit status of a full disk", run.returncode, met=run.returncode == 3))
    return run.returncode == 3


def memory(pid: int) -> int:
    """Return a process's resident memory, kB."""
    for line in Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1])
    return 0


def endurance(folder: Path, minutes: float, *, relaxed: bool) -> bool:
    """Run one long trial at 1 kHz; print loop health and memory.

    On a machine that stalls for longer than a drive may wait, `relaxed` lets stalls pass, so that
    they are counted and not stopped at.
    """
    here = folder / "long"
    here.mkdir()
    rig = Rig(here, watchdog="500 ms" if relaxed else "20 ms")
    if relaxed:
        channels = load_drive(shipped_rig("eha_drive.yaml")).channels
        limits = ", ".join(f"{name}: {{stale: 0.4 s}}" for name in channels)
        with rig.target.open("a", encoding="utf-8") as stream:
            stream.write(f"limits: {{{limits}}}\nloop: {{priority: 60}}\n")
    suite = suite_of(here, "trial", PRESSURE, minutes * 60.0)
    run = rig.start(suite, here / "out")
    wait_for(lambda: bool(last(rig.events(), "torque on")))
    time.sleep(5.0)
    seen = [(memory(run.pid), memory(rig.pid))]
    until = time.monotonic() + minutes * 60.0 - 10.0
    while run.poll() is None and time.monotonic() < until:
        time.sleep(min(10.0, minutes * 6.0))
        if run.poll() is None:
            seen.append((memory(run.pid), memory(rig.pid)))
    _, said = run.communicate()
    rig.close()
    print(f"{minutes:g} min at 1 kHz: exit {run.returncode}; load {os.getloadavg()}")
    print(" ".join(said.split()))
    recording = eb.read(here / "out" / "recordings" / "trial-0.mcap")
    for key, value in recording.metadata.items():
        if key.startswith("loop_"):
            print(f"  {key}: {value}")
    for place, name in enumerate(("bench", "rig")):
        sizes = [pair[place] for pair in seen]
        print(f"  memory of the {name}: {sizes[0]} kB at 5 s, {sizes[-1]} kB at the end, "
              f"at most {max(sizes)} kB")  # fmt: skip
        growth = (sizes[-1] - sizes[0]) / sizes[0] * 100
        ROWS.append(Row(f"rig: memory of the {name}, growth", growth, "%", "<", 1.0))
    for key, unit, scale in (
        ("loop_overruns", "", 1.0),
        ("loop_lost_frames", "", 1.0),
        ("loop_period_p99_9", "ms", 1e3),
        ("loop_period_max", "ms", 1e3),
    ):
        figure = float(recording.metadata[key]) * scale
        ROWS.append(Row(f"rig: {key} in {minutes:g} min at 1 kHz", figure, unit))
    print(f"  rig overslept at most {number(last(rig.events(), 'end'), 'overslept_most') * 1e3} ms")
    return run.returncode == 0


def main() -> int:
    """Run the parts that are asked for; return 1 where a promise was not kept."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.rig_safety", description=__doc__)
    parser.add_argument("--faults", action="store_true")
    parser.add_argument("--kills", type=int, default=0, help="kill -9 at this many moments")
    parser.add_argument("--signals", type=int, default=0, help="SIGINT and SIGTERM, so often each")
    parser.add_argument("--disk", action="store_true", help="a full disk")
    parser.add_argument("--minutes", type=float, default=0.0, help="length of the long run")
    parser.add_argument("--relaxed", action="store_true", help="count stalls in the long run")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write the figures as rows of JSON")
    chosen = parser.parse_args()
    kept = True
    with tempfile.TemporaryDirectory(prefix="eha-rig-") as name:
        folder = Path(name)
        if chosen.faults:
            kept &= faults(folder)
        if chosen.kills:
            kept &= interrupted(folder, chosen.kills, signal.SIGKILL, chosen.seed)
        if chosen.signals:
            kept &= interrupted(folder, chosen.signals, signal.SIGINT, chosen.seed)
            kept &= interrupted(folder, chosen.signals, signal.SIGTERM, chosen.seed)
        if chosen.disk:
            kept &= full_disk(folder)
        if chosen.minutes:
            kept &= endurance(folder, chosen.minutes, relaxed=chosen.relaxed)
    write_rows(chosen.json, ROWS)
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
