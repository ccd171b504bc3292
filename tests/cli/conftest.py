"""The command line as a user calls it."""

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import eha_bench as eb
from eha_bench.cli.main import main

Cli = Callable[..., subprocess.CompletedProcess[str]]

SUITE = """\
name: tiny
trials:
  - id: hold
    mode: current
    setup: {piston: locked}
    duration: 0.1 s
    repeats: 2
    signal: {kind: step, final: 8 A, at: 10 ms}
    accept:
      tracking_max: {channel: current, max: 12 A}
  - id: sine
    mode: current
    setup: {piston: locked}
    signal: {kind: sine, amplitude: 5 A, frequency: 20 Hz, cycles: 4}
    accept:
      tracking_rms: {channel: current, max: 2 A}
"""


@pytest.fixture
def cli(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Cli:
    """Run `eha-bench` in an empty folder, as the entry point does."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CI", "true")
    monkeypatch.delenv("GITHUB_STEP_SUMMARY", raising=False)

    def run(*arguments: object, check: int | None = None) -> subprocess.CompletedProcess[str]:
        words = [str(item) for item in arguments]
        monkeypatch.setattr(sys, "argv", ["eha-bench", *words])
        capsys.readouterr()
        status = 0
        try:
            main()
        except SystemExit as left:
            status = left.code if isinstance(left.code, int) else int(bool(left.code))
        said = capsys.readouterr()
        assert "Traceback" not in said.err, said.err
        if check is not None:
            assert status == check, said.err + said.out
        return subprocess.CompletedProcess(words, status, said.out, said.err)

    return run


@pytest.fixture(scope="session")
def first_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the tiny suite and what it left on the simulator, made once for all tests."""
    folder = tmp_path_factory.mktemp("first")
    (folder / "tiny.yaml").write_text(SUITE, encoding="utf-8")
    eb.run(folder / "tiny.yaml", out=folder / "out")
    return folder


@pytest.fixture
def ran(first_run: Path, suite: Path, tmp_path: Path) -> Path:
    """What the tiny suite left, in a folder of the test's own."""
    return Path(shutil.copytree(first_run / "out", tmp_path / "ran"))


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    """A suite of two short trials, three runs."""
    path = tmp_path / "tiny.yaml"
    path.write_text(SUITE, encoding="utf-8")
    return path
