"""The command line as a user calls it: a process of its own."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

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
      peak: {channel: pressure_difference, max: 60 MPa}
  - id: sine
    mode: current
    setup: {piston: locked}
    signal: {kind: sine, amplitude: 5 A, frequency: 20 Hz, cycles: 4}
    accept:
      tracking_rms: {channel: current, max: 2 A}
"""


@pytest.fixture
def cli(tmp_path: Path) -> Cli:
    """Run `eha-bench` in an empty folder."""

    def run(*arguments: object, check: int | None = None) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(
            [sys.executable, "-m", "eha_bench", *(str(item) for item in arguments)],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            env={**os.environ, "CI": "true"},
            timeout=120,
        )
        assert "Traceback" not in done.stderr, done.stderr
        if check is not None:
            assert done.returncode == check, done.stderr + done.stdout
        return done

    return run


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    """A suite of two short trials, three runs."""
    path = tmp_path / "tiny.yaml"
    path.write_text(SUITE, encoding="utf-8")
    return path
