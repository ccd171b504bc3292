"""Targets and controllers of somebody else, as if installed."""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from eha_bench.core import plugins
from eha_bench.metrics import scoring

SUITE = """\
name: small
trials:
  - id: first
    mode: current
    duration: 20 ms
    signal: {kind: step, final: 2 A, at: 5 ms}
    accept: {tracking_max: {channel: current, max: 3 A}}
  - id: second
    mode: current
    duration: 20 ms
    signal: {kind: step, final: 3 A, at: 5 ms}
    accept: {tracking_max: {channel: current, max: 3 A}}
"""

TARGET = """\
import sys
from dataclasses import replace

from eha_bench.core.errors import InputError, SafetyStop, TargetFault
from eha_bench.core.metric import MetricSpec
from eha_bench.core.recording import Recording
from eha_bench.metrics import Metric
from eha_bench.recordings import read
from eha_bench.targets.target import Identity, Outcome, Target

WAYS = {
    "fault": lambda: (_ for _ in ()).throw(TargetFault("the drive burnt")),
    "safety": lambda: (_ for _ in ()).throw(SafetyStop("too hot")),
    "input": lambda: (_ for _ in ()).throw(InputError("no such drive")),
    "bug": lambda: {}["foo"],
    "exit": lambda: sys.exit(0),
    "pipe": lambda: (_ for _ in ()).throw(BrokenPipeError("the wire")),
    "interrupt": lambda: (_ for _ in ()).throw(KeyboardInterrupt()),
}

GIVES = {
    "itself": lambda made: made,
    "nothing": lambda made: None,
    "a recording": lambda made: made.recording,
    "a list": lambda made: Outcome([1.0]),
    "a word": lambda made: replace(made, ending="complete"),
    "a number": lambda made: changed(made, metadata={"signal_start": 0.0}),
    "a number named as a channel": lambda made: changed(made, metadata={"current": 5}),
    "no sample": lambda made: Outcome(made.recording.between(9.0, 9.5)),
    "backwards": lambda made: changed(made, time=made.recording.time[::-1]),
    "too few": lambda made: changed(made, values={"current": made.recording.time[:-2]}),
    "a lost log": lambda made: read("nowhere/log.csv"),
    "a log without its channel": lambda made: replace(made.recording, source="log.csv")["torque"],
    "what is missing": lambda made: made.recording["torque"],
}


def changed(made, **what):
    return Outcome(replace(made.recording, **what))


class Echo(Target):
    \"\"\"Gives back what is asked for; goes wrong where it is told to.\"\"\"

    def __init__(self, content):
        self.gives = GIVES[content.pop("gives", "itself")]
        self.wrong = {key: WAYS[content[key]] for key in content if key != "target"}
        self.run_before = 0
        self.meet("init")

    def meet(self, where):
        if where in self.wrong:
            self.wrong[where]()

    @property
    def identity(self):
        return Identity("echo")

    def check(self, trial):
        self.meet("check")

    def __enter__(self):
        self.meet("enter")
        return self

    def make_safe(self):
        self.meet("leave")

    def run(self, trial, repeat, stopping=None):
        self.meet("first" if not self.run_before else "second")
        self.run_before += 1
        time = trial.clock()
        reference = trial.reference(time)
        made = Outcome(Recording(time, {"reference": reference, trial.channel: reference}))
        return self.gives(made) if self.run_before > 1 else made


def from_file(path, content):
    return Echo(content)


class Unfinished(Metric):
    spec = MetricSpec("unfinished", "a metric without a measure")

    def applies(self, trial):
        return True
"""

POINTS = """\
[eha_bench.targets]
echo = echo_target:from_file

[eha_bench.metrics]
absent = echo_target_absent:Absent
unfinished = echo_target:Unfinished
"""


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    """A suite of two short trials."""
    path = tmp_path / "suite.yaml"
    path.write_text(SUITE)
    return path


@pytest.fixture
def echo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Path]]:
    """Return target files of a foreign target that goes wrong in the ways given."""
    site = tmp_path / "site"
    info = site / "echo_target-1.0.dist-info"
    info.mkdir(parents=True)
    (site / "echo_target.py").write_text(TARGET)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: echo-target\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(POINTS)
    monkeypatch.syspath_prepend(str(site))

    def forget() -> None:
        plugins._entry_points.cache_clear()
        plugins._group.cache_clear()
        scoring.metric.cache_clear()
        scoring.all_metrics.cache_clear()

    def target(**wrong: str) -> Path:
        path = tmp_path / "target.yaml"
        path.write_text("\n".join(("target: echo", *(f"{k}: {v}" for k, v in wrong.items()))))
        return path

    forget()
    yield target
    sys.modules.pop("echo_target", None)
    forget()
