"""Trials on FMUs of FMI 2 and 3: known answers, maps that are wrong, FMUs that fail."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import eha_bench
from eha_bench.core.errors import InputError
from eha_bench.suites import load_suite
from eha_bench.targets.resolve import open_target
from eha_bench.targets.target import Ending
from locked import locked

locked("fmpy", "fmu")
from fmus import build_line, rewritten  # noqa: E402  # it imports FMPy

TARGET = """\
target: fmu
fmu: line{version}.fmu
inputs:
  current_command: {{variable: i_cmd}}
outputs:
  pressure_difference: {{variable: p}}
  motor_speed: {{variable: speed, unit: rpm}}
  piston_position: {{variable: x}}
  steps_done: {{variable: steps}}
parameters:
  gain: 2.0
  tau: 30 ms
initial:
  piston_position: {{variable: x_start}}
setup:
  piston: {{variable: locked}}
"""
SUITE = """\
name: line
target: line.yaml
defaults: {sample_rate: 1 kHz}
trials:
  - id: step
    mode: current
    setup: {piston: locked}
    settle: 10 ms
    signal: {kind: step, initial: 0 A, final: 5 A, at: 20 ms}
    duration: 0.1 s
    scores: [tracking_max]
  - id: free
    mode: current
    signal: {kind: constant, value: 3 A}
    duration: 20 ms
"""


@pytest.fixture(scope="module", params=[2, 3])
def version(request: pytest.FixtureRequest) -> int:
    return int(request.param)


@pytest.fixture(scope="module")
def folder(version: int, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp(f"fmi{version}")
    build_line(version, place)
    (place / "line.yaml").write_text(TARGET.format(version=version))
    (place / "suite.yaml").write_text(SUITE)
    return place


def written(folder: Path, version: int, old: str = "", new: str = "") -> Path:
    """A target.yaml with one thing changed."""
    text = TARGET.format(version=version)
    assert old in text
    path = folder / "changed.yaml"
    path.write_text(text.replace(old, new, 1))
    return path


def test_a_suite_runs_on_it(folder: Path) -> None:
    result = eha_bench.run(folder / "suite.yaml", out=folder / "out")
    assert result.status.value == "passed"
    step = eha_bench.read(folder / "out" / result.trials[0].recording)
    assert step.metadata["signal_start"] == "0.01"
    assert step.unit("steps_done") == ""
    # a command holds from its tick on; p is in bar in the FMU, the speed in rev/min
    elapsed = np.maximum(step.time - 0.03, 0.0)
    p = 1e5 * 2.0 * 5.0 * (1.0 - np.exp(-elapsed / 0.03))
    np.testing.assert_allclose(step["pressure_difference"], p, rtol=1e-9, atol=1e-6)
    np.testing.assert_array_equal(step["motor_speed"], 0.0)
    free = eha_bench.read(folder / "out" / result.trials[1].recording)
    np.testing.assert_allclose(free["motor_speed"][1:], 60.0 * 3.0 * 2 * np.pi / 60.0)
    np.testing.assert_array_equal(free["steps_done"], np.arange(20.0))
    provenance = json.loads((folder / "out" / "result.json").read_text())["provenance"]
    assert len(provenance["fmu_sha256"]) == 64


def test_a_tick_is_divided_where_the_file_says_so(folder: Path, version: int) -> None:
    target = written(folder, version, "setup:", "step: 0.3 ms\nsetup:")
    eha_bench.run(folder / "suite.yaml", target, folder / "fine")
    free = eha_bench.read(folder / "fine/recordings/free-0.mcap")
    np.testing.assert_array_equal(free["steps_done"], 4.0 * np.arange(20.0))


def test_a_first_value_reaches_the_fmu_in_its_unit(folder: Path, version: int) -> None:
    suite = folder / "initial.yaml"
    suite.write_text(
        "name: initial\ntrials:\n  - id: falls\n    mode: current\n"
        "    setup: {initial: {piston_position: 0.4 cm}}\n"
        "    signal: {kind: constant, value: 0 A}\n    duration: 20 ms\n"
    )
    eha_bench.run(suite, folder / "line.yaml", folder / "first")
    falls = eha_bench.read(folder / "first/recordings/falls-0.mcap")
    np.testing.assert_allclose(falls["piston_position"], 4e-3)


@pytest.mark.parametrize(
    ("parameter", "says"),
    [
        ("fails_at: 0.02", "at 0.02 s"),
        ("broken_from: 0.02", "pressure_difference ('p') as nan"),
        ("crashes_at: 0.02", "crashed the process that it ran in at 0.02 s (SIGSEGV)"),
        ("raises_at: 0.02", "RuntimeError('the pump has seized')"),
    ],
)
def test_an_error_of_the_fmu_is_a_fault(
    folder: Path, version: int, parameter: str, says: str
) -> None:
    target = written(folder, version, "gain: 2.0", f"gain: 2.0\n  {parameter}")
    result = eha_bench.run(folder / "suite.yaml", target, folder / "fault")
    assert result.status.value == "fault"
    assert result.status.exit_status == 3
    assert says in result.trials[0].reason
    if "fails" in parameter:
        assert "the line has burst" in result.trials[0].reason
    assert len(eha_bench.read(folder / "fault" / result.trials[0].recording)) >= 20


@pytest.mark.parametrize(
    ("old", "new", "key", "says"),
    [
        ("variable: i_cmd", "variable: i_cmnd", "inputs.current_command.variable", "'i_cmd'?"),
        ("variable: i_cmd", "variable: p", "inputs.current_command.variable", "not an input"),
        ("current_command:", "force:", "inputs.force", "only current_command"),
        ("variable: speed", "variable: sped", "outputs.motor_speed.variable", "'speed'?"),
        ("unit: rpm", "unit: rad/s", "outputs.motor_speed.unit", "rev/min"),
        ("unit: rpm", "unit: bar", "outputs.motor_speed.unit", "wrong dimension"),
        ("variable: x}", "variable: p}", "outputs.piston_position.variable", "wrong dimension"),
        ("tau: 30 ms", "tau: 30 mm", "parameters.tau", "wrong dimension"),
        ("tau: 30 ms", "p: 1.0", "parameters.p", "no start value"),
        ("tau: 30 ms", "taus: 1.0", "parameters.taus", "'tau'?"),
        ("piston: {variable: locked}", "pistons: {variable: locked}", "setup.pistons", "piston"),
        ("line", "lines", "fmu", "no such file"),
        ("fmu: line", "fmu: ../changed", "fmu", "no such file"),
    ],
)
def test_a_wrong_map_is_told_with_its_place(
    folder: Path, version: int, old: str, new: str, key: str, says: str
) -> None:
    path = written(folder, version, old, new)
    with pytest.raises(InputError) as caught:
        open_target(path)
    assert caught.value.where.key == key
    assert caught.value.where.line > 0
    assert says in str(caught.value)


def test_what_is_no_fmu_is_refused(folder: Path, version: int) -> None:
    (folder / "text.fmu").write_text("not a zip")
    path = written(folder, version, f"line{version}.fmu", "text.fmu")
    with pytest.raises(InputError, match="is not an FMU"):
        open_target(path)


@pytest.mark.parametrize(
    ("trial", "says"),
    [
        ("setup: {bypass: open}", "opens the bypass"),
        ("setup: {initial: {joint_angle: 50 deg}}", "starts at a joint_angle"),
        ("safety: {joint_angle: '< 1 rad'}", "joint_angle"),
    ],
)
def test_a_trial_that_the_fmu_cannot_run_is_refused_first(
    folder: Path, trial: str, says: str
) -> None:
    suite = folder / "cannot.yaml"
    suite.write_text(
        f"name: cannot\ntrials:\n  - id: a\n    mode: current\n    {trial}\n"
        "    signal: {kind: constant, value: 0 A}\n    duration: 20 ms\n"
    )
    with pytest.raises(InputError, match=says):
        eha_bench.run(suite, folder / "line.yaml", folder / "none")
    assert not (folder / "none").exists()


@pytest.mark.parametrize(
    ("mode", "value", "says"),
    [
        ("motor_speed", "50 rad/s", "controls motor_speed, which the FMU does not have"),
        ("pressure", "1 MPa", "reads 'motor_speed', which the FMU does not give"),
    ],
)
def test_a_trial_on_what_the_fmu_lacks_is_refused_first(
    folder: Path, version: int, mode: str, value: str, says: str
) -> None:
    target = written(folder, version, "motor_speed:", "shaft_speed:")
    suite = folder / "pressure.yaml"
    suite.write_text(
        f"name: pressure\ntrials:\n  - id: a\n    mode: {mode}\n"
        "    setup: {piston: locked}\n"
        f"    signal: {{kind: constant, value: {value}}}\n    duration: 20 ms\n"
    )
    with pytest.raises(InputError, match=says):
        eha_bench.run(suite, target, folder / "none")


def test_an_fmu_of_a_fixed_step_is_held_to_it(version: int, tmp_path: Path) -> None:
    build_line(version, tmp_path, canHandleVariableCommunicationStepSize=False)
    (tmp_path / "line.yaml").write_text(TARGET.format(version=version))
    (tmp_path / "suite.yaml").write_text(SUITE)
    # without a declared step size any fixed step is allowed: a tick
    assert eha_bench.run(tmp_path / "suite.yaml", out=tmp_path / "out").status.value == "passed"


@pytest.mark.slow  # waits until the bench gives it up
def test_an_fmu_that_does_not_come_back_is_a_fault(folder: Path, version: int) -> None:
    hangs = "answers_within: 2 s\nparameters:\n  hangs_at: 0.01\n"
    target = written(folder, version, "parameters:\n", hangs)
    result = eha_bench.run(folder / "suite.yaml", target, folder / "hangs")
    assert result.status.value == "fault"
    assert "the FMU does not answer at 0.01 s: waited 2 s" in result.trials[0].reason


@pytest.mark.slow
def test_ctrl_c_does_not_wait_for_an_fmu_that_does_not_come_back(
    folder: Path, version: int
) -> None:
    target = open_target(written(folder, version, "gain: 2.0", "gain: 2.0\n  hangs_at: 0.01"))
    trial = load_suite(folder / "suite.yaml").trials[0]
    asked = iter([*([False] * 40), *([True] * 1000)])  # ten ticks, then looks while it hangs
    begun = time.monotonic()
    outcome = target.run(trial, 0, lambda: next(asked))
    assert time.monotonic() - begun < 30.0  # it would sleep for 60 s
    assert outcome.ending is Ending.INTERRUPTED
    assert len(outcome.recording) >= 9


KILLED = """
import os, signal, sys
from eha_bench.suites import load_suite
from eha_bench.targets.resolve import open_target
trial = load_suite(sys.argv[1]).trials[0]
def kill(asked=[]):
    asked.append(None)
    if len(asked) > 10:
        os.kill(os.getpid(), signal.SIGKILL)
open_target(sys.argv[2]).run(trial, 0, kill)
"""


def test_a_killed_bench_leaves_no_unpacked_fmu(folder: Path, version: int, tmp_path: Path) -> None:
    target = written(folder, version)
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(folder / "suite.yaml"), str(target)],
        env={**os.environ, "TMPDIR": str(tmp_path)}, check=False,
    )  # fmt: skip
    assert done.returncode == -signal.SIGKILL
    until = time.monotonic() + 20.0
    while list(tmp_path.glob("eha-bench-fmu-*")) and time.monotonic() < until:
        time.sleep(0.05)
    assert list(tmp_path.glob("eha-bench-fmu-*")) == []


@pytest.mark.parametrize(
    ("step", "says"),
    [("0.0007", "the FMU steps by 0.7 ms only"), ("0", "gives it as '0' s"), ("-1", "'-1' s"),
     ("soon", "'soon' s")],
)  # fmt: skip
def test_a_fixed_step_that_does_not_fit_is_told_first(
    version: int, tmp_path: Path, step: str, says: str
) -> None:
    fmu = build_line(version, tmp_path, canHandleVariableCommunicationStepSize=False)

    def declare(name: str, content: bytes) -> tuple[str, bytes]:
        if name != "modelDescription.xml":
            return name, content
        without = re.sub(r"<DefaultExperiment[^>]*/>", "", content.decode())
        where = "<ModelVariables>"
        return name, without.replace(
            where, f'<DefaultExperiment stepSize="{step}"/>{where}'
        ).encode()

    rewritten(fmu, declare)
    (tmp_path / "line.yaml").write_text(TARGET.format(version=version))
    (tmp_path / "suite.yaml").write_text(SUITE)
    with pytest.raises(InputError) as caught:
        eha_bench.run(tmp_path / "suite.yaml", out=tmp_path / "out")
    assert says in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_an_fmu_for_another_machine_is_refused(version: int, tmp_path: Path) -> None:
    fmu = build_line(version, tmp_path)
    here, there = ("linux64", "win64") if version == 2 else ("x86_64-linux", "x86_64-windows")
    rewritten(fmu, lambda name, content: (name.replace(f"/{here}/", f"/{there}/"), content))
    (tmp_path / "line.yaml").write_text(TARGET.format(version=version))
    with pytest.raises(InputError) as caught:
        open_target(tmp_path / "line.yaml")
    assert f"no binary for this machine ({here}); it has: {there}" in str(caught.value)


def test_an_fmu_that_may_exist_once_is_reset_or_says_so(version: int, tmp_path: Path) -> None:
    build_line(version, tmp_path, canBeInstantiatedOnlyOncePerProcess=True)
    (tmp_path / "line.yaml").write_text(TARGET.format(version=version))
    (tmp_path / "suite.yaml").write_text(SUITE)
    result = eha_bench.run(tmp_path / "suite.yaml", out=tmp_path / "out")
    assert result.status.value in ("passed", "fault")
