"""Whatever fails in a target or a controller is a fault of the run, and every file says so."""

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from uuid import uuid4
from xml.etree import ElementTree as ET

import pytest

import eha_bench
from eha_bench.cli.console import errors_as_sentences
from eha_bench.cli.main import main
from eha_bench.core.errors import InputError, PluginError, TargetFault
from eha_bench.core.result import Result, Status

Echo = Callable[..., Path]
REPORTS = ("result.json", "junit.xml", "summary.md", "report.html")


def test_a_target_without_model_and_controller_says_so(
    suite: Path, echo: Echo, tmp_path: Path
) -> None:
    said = eha_bench.run(suite, echo(), tmp_path / "out").provenance
    assert (said["model_sha256"], said["controller_sha256"]) == ("", "")


def assert_all_say_fault(out: Path, reason: str) -> None:
    """result.json, junit.xml, summary.md and report.html all say that, and why."""
    result = json.loads((out / "result.json").read_text())
    assert result["status"] == "fault"
    assert result["provenance"]["stopped_by"] in ("fault", "safety stop")
    assert reason in [trial for trial in result["trials"] if trial["reason"]][-1]["reason"]
    errors = ET.parse(out / "junit.xml").getroot().findall(".//error")
    assert [error.get("type") for error in errors] == ["fault"]
    assert reason in (errors[0].get("message") or "")
    assert "⛔" in (out / "summary.md").read_text()
    page = (out / "report.html").read_text()
    assert "<title>Fault" in page


@pytest.mark.parametrize("older", [False, True], ids=["fresh", "older result"])
@pytest.mark.parametrize("where", ["check", "enter", "first", "second", "leave"])
@pytest.mark.parametrize("how", ["fault", "bug"])
def test_a_fault_is_in_every_file(
    suite: Path, echo: Echo, tmp_path: Path, where: str, how: str, older: bool
) -> None:
    out = tmp_path / "out"
    if older:
        assert eha_bench.run(suite, echo(), out).status is Status.PASSED
    result = eha_bench.run(suite, echo(**{where: how}), out)
    assert result.status is Status.FAULT
    assert result.status.exit_status == 3
    assert_all_say_fault(out, "the drive burnt" if how == "fault" else "KeyError: 'foo'")
    finished = {"second": ["first"], "leave": ["first", "second"]}.get(where, [])
    recorded = [trial.id for trial in result.trials if trial.recording]
    assert recorded == finished
    if how == "bug":
        line = 1 + (tmp_path / "site/echo_target.py").read_text().split("\n").index(
            '    "bug": lambda: {}["foo"],'
        )
        assert f"echo_target.py:{line} in" in result.trials[-1].reason


@pytest.mark.parametrize("how", ["exit", "pipe"])
def test_what_would_leave_with_another_status_is_a_fault(
    suite: Path, echo: Echo, tmp_path: Path, how: str
) -> None:
    assert eha_bench.run(suite, echo(first=how), tmp_path / "out").status is Status.FAULT


@pytest.mark.parametrize(
    ("gives", "reason"),
    [
        ("nothing", "returned None, which is no Outcome, at "),
        ("a recording", "returned a Recording, which is no Outcome, at "),
        ("a list", "returned a list as its recording, at "),
        ("a word", "returned 'complete' as how it ended, at "),
        ("a number", "returned 0.0 for 'signal_start', which is no text, at "),
        ("a number named as a channel", "returned 5 for 'current', which is no text, at "),
        ("no sample", "recorded no sample of a run that it calls complete, at "),
        ("backwards", "time does not increase, at "),
        ("too few", "channel 'current' has 18 samples where time has 20, at "),
        ("what is missing", "no channel 'torque' in the recording"),
    ],
)
def test_what_is_no_recording_costs_its_own_trial(
    suite: Path, echo: Echo, tmp_path: Path, gives: str, reason: str
) -> None:
    out = tmp_path / "out"
    result = eha_bench.run(suite, echo(gives=gives), out)
    first, second = result.trials
    assert first.status is Status.PASSED
    assert (second.status, second.recording) == (Status.FAULT, "")
    assert "target 'echo'" in second.reason
    assert reason in second.reason
    assert re.search(r"; [\w ]+", second.reason), "names no way out"
    assert re.search(r"echo_target.py:\d+ in (run|changed|<lambda>)", second.reason)
    assert_all_say_fault(out, reason)
    assert eha_bench.run(suite, echo(), out, resume=True).status is Status.PASSED


def test_a_metric_that_cannot_be_loaded_is_told_before_anything_runs(
    suite: Path, echo: Echo, tmp_path: Path
) -> None:
    out, text = tmp_path / "out", suite.read_text()
    suite.write_text(text.replace("accept: {", "scores: [unfinished]\n    accept: {", 1))
    said = (
        r"suite.yaml: trial 'first' cannot be scored: metric 'unfinished' does not define measure"
    )
    with pytest.raises(PluginError, match=said):
        eha_bench.run(suite, echo(), out)
    assert not out.exists()
    over = tmp_path / "over.yaml"
    over.write_text("vary: {torque_constant: [0.1 N*m/A, 0.2 N*m/A]}\n")
    with pytest.raises(PluginError, match=said):
        eha_bench.score_files([tmp_path / "nowhere.mcap"], suite, out=out)
    with pytest.raises(PluginError, match=said):
        eha_bench.sweep(suite, over, out=out)
    assert not out.exists()
    suite.write_text(text)  # one that does not ask for it is run
    assert eha_bench.run(suite, echo(), out).status is Status.PASSED


@pytest.mark.parametrize(
    ("kind", "other"),
    [
        ("metrics", "rise_time"),
        ("effects", "relief_valve"),
        ("plants", "eha_knee"),
        ("elements", "cylinder"),
        ("targets", "simulator"),
        ("signals", "step"),
    ],
)
def test_a_broken_plug_in_hides_no_other_one_of_a_list(
    echo: Echo,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    kind: str,
    other: str,
) -> None:
    points = f"[eha_bench.{kind}]\nabsent = echo_target_absent:Absent\nwrong = json:__name__\n"
    (tmp_path / "site/echo_target-1.0.dist-info/entry_points.txt").write_text(points)
    monkeypatch.setattr(sys, "argv", ["eha-bench", "list", kind])
    with pytest.raises(SystemExit) as left:
        main()
    listed = capsys.readouterr().out
    assert not left.value.code, listed
    broken = rf"absent +broken +{kind[:-1]} 'absent' cannot be loaded \(ModuleNotFound"
    assert re.search(broken, listed)
    assert re.search(rf"^{other} ", listed, re.MULTILINE)


def test_a_safety_stop_keeps_its_name(suite: Path, echo: Echo, tmp_path: Path) -> None:
    result = eha_bench.run(suite, echo(first="safety"), tmp_path / "out")
    assert result.status is Status.FAULT
    assert result.trials[0].reason == "safety stop: too hot"
    assert result.provenance["stopped_by"] == "safety stop"


def test_interruption_is_none(suite: Path, echo: Echo, tmp_path: Path) -> None:
    result = eha_bench.run(suite, echo(enter="interrupt"), tmp_path / "out")
    assert result.status is Status.INCOMPLETE
    assert result.provenance["stopped_by"] == "interrupted"


@pytest.mark.parametrize("where", ["check", "enter", "first"])
def test_wrong_input_stays_wrong_input_and_leaves_no_old_report(
    suite: Path, echo: Echo, tmp_path: Path, where: str
) -> None:
    out = tmp_path / "out"
    eha_bench.run(suite, echo(), out)
    with pytest.raises(InputError, match="no such drive"):
        eha_bench.run(suite, echo(**{where: "input"}), out)
    left = [name for name in REPORTS if (out / name).exists()]
    # refused before anything began, the older result stands whole
    assert left == (list(REPORTS) if where == "check" else ["result.json"])
    assert Result.read(out / "result.json").status is not Status.FAILED


@pytest.mark.parametrize(
    ("gives", "said"),
    [
        ("a lost log", "log.csv: "),
        ("a log without its channel", "log.csv: no channel 'torque' in the recording"),
    ],
)
def test_a_log_that_a_target_cannot_replay_is_wrong_input(
    suite: Path, echo: Echo, tmp_path: Path, gives: str, said: str
) -> None:
    with pytest.raises(InputError, match=said) as refused:
        eha_bench.run(suite, echo(gives=gives), tmp_path / "out")
    assert refused.value.exit_status == 2


@pytest.mark.parametrize("where", ["check", "enter", "second"])
def test_a_run_goes_on_after_a_fault(suite: Path, echo: Echo, tmp_path: Path, where: str) -> None:
    out = tmp_path / "out"
    eha_bench.run(suite, echo(second="fault"), out)
    kept = (out / "recordings/first-0.mcap").stat().st_mtime_ns
    again = eha_bench.run(suite, echo(**{where: "fault"}), out, resume=True)
    assert again.trials[0].status is Status.PASSED
    done = eha_bench.run(suite, echo(), out, resume=True)
    assert done.status is Status.PASSED
    assert (out / "recordings/first-0.mcap").stat().st_mtime_ns == kept


def test_a_target_is_left_alone_where_nothing_is_left_to_run(
    suite: Path, echo: Echo, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    eha_bench.run(suite, echo(), out)
    assert eha_bench.run(suite, echo(enter="bug"), out, resume=True).status is Status.PASSED


def test_a_target_that_cannot_be_made_is_bad_input(suite: Path, echo: Echo, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"target.yaml:1, key 'target'.*KeyError.*echo_target.py:"):
        eha_bench.run(suite, echo(init="bug"), tmp_path / "out")


def test_a_fault_while_warming_up_says_why(suite: Path, echo: Echo, tmp_path: Path) -> None:
    target = echo(enter="fault")
    with pytest.raises(TargetFault, match="warm-up, A, first: fault: the drive burnt"):
        eha_bench.ab(suite, target, target, tmp_path / "ab", repeats=2)


def test_a_faulted_ab_leaves_no_older_verdict(suite: Path, echo: Echo, tmp_path: Path) -> None:
    out = tmp_path / "ab"
    eha_bench.ab(suite, echo(), echo(), out, repeats=2, warm_up=0)
    assert (out / "comparison.html").is_file()
    target = echo(enter="bug")
    done = eha_bench.ab(suite, target, target, out, repeats=2, warm_up=0)
    assert done.run.status is Status.FAULT
    assert not list(out.glob("comparison.*"))
    (side,) = done.run.results
    assert_all_say_fault(out / side, "KeyError")


CONTROLLER = """\
import numpy as np

from eha_bench.control.controller import Controller


class Law(Controller):
    def __init__(self, gains, context):
        self.ticks = 0
        {init}

    def step(self, reference, reading):
        self.ticks += 1
        if self.ticks > 10:
            {step}
        return reference
"""


def controlled(folder: Path, *, init: str = "pass", step: str = "pass") -> Path:
    """Return a target.yaml of the simulator under a law with these lines in it."""
    # a module of its own name each: Python keeps those it has imported
    name = f"law_{uuid4().hex}"
    (folder / f"{name}.py").write_text(CONTROLLER.format(init=init, step=step))
    (folder / "controller.yaml").write_text(f"current: {{controller: '{name}:Law'}}\n")
    (folder / "model.yaml").write_text("model: eha_knee\n")
    path = folder / "simulator.yaml"
    path.write_text("target: simulator\nmodel: model.yaml\ncontroller: controller.yaml\n")
    return path


@pytest.mark.parametrize(
    ("step", "reason"),
    [
        ("1 / 0", r"ZeroDivisionError: division by zero, at .*/law_\w+.py:14 in step"),
        ("reading['foo']", r"KeyError: 'foo', at .*/law_\w+.py:14 in step"),
        ("np.linalg.inv(np.zeros((2, 2)))", r"LinAlgError: Singular.*/law_\w+.py:14 in step"),
        ("exit(0)", r"SystemExit: 0, at .*/law_\w+.py:14 in step"),
        ("return None", "the controller's step returned None, not a number"),
        ("return 'high'", "the controller's step returned 'high', not a number"),
    ],
)
def test_a_crash_of_a_controller_keeps_what_was_recorded(
    suite: Path, tmp_path: Path, step: str, reason: str
) -> None:
    result = eha_bench.run(suite, controlled(tmp_path, step=step), tmp_path / "out")
    assert result.status is Status.FAULT
    assert re.search(reason, result.trials[0].reason)
    recording = eha_bench.read(tmp_path / "out" / result.trials[0].recording)
    assert len(recording) == 10
    assert recording.metadata["ending"] == "fault"


def test_a_controller_that_cannot_begin_is_a_fault(suite: Path, tmp_path: Path) -> None:
    eha_bench.run(suite, controlled(tmp_path, init="1 / 0"), tmp_path / "out")
    assert_all_say_fault(tmp_path / "out", "cannot run 'first': ZeroDivisionError")


@pytest.mark.slow  # starts processes
def test_a_crash_in_another_process_is_the_same_fault(suite: Path, tmp_path: Path) -> None:
    target = controlled(tmp_path, step="1 / 0")
    here, there = (
        eha_bench.run(suite, target, tmp_path / str(workers), workers=workers)
        for workers in (None, 2)
    )
    assert there.trials[0].reason == here.trials[0].reason


def test_the_command_says_so_and_leaves_with_3(
    suite: Path, echo: Echo, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    target = controlled(tmp_path, step="1 / 0")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["eha-bench", "run", str(suite), "--target", str(target)])
    with pytest.raises(SystemExit) as left:
        main()
    said = capsys.readouterr().err
    assert left.value.code == 3, said
    assert "Traceback" not in said
    assert "first: fault: ZeroDivisionError: division by zero" in said
    assert "small: fault" in said


def test_a_bug_of_ours_has_a_status_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left, errors_as_sentences():
        raise RuntimeError("what nobody thought of")
    assert left.value.code == 70
    said = capsys.readouterr().err
    assert "Traceback" in said
    assert "eha-bench: this is a bug" in said
