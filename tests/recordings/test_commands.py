"""`eha-bench info` and `eha-bench recover`, as a user sees them."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eha_bench import recordings
from eha_bench.cli.main import main
from eha_bench.core.recording import Recording

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """A function that runs a command and returns (exit status, output, messages)."""

    def call(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["eha-bench", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        captured = capsys.readouterr()
        return int(ended.value.code or 0), captured.out, captured.err

    return call


def test_info_tells_what_is_odd(run: Run, float_log: Any) -> None:
    ms = 1_000_000
    path = float_log({"/a\x1b[31m": [(0, 1.0), (ms, 2.0), (ms, 2.5), (2 * ms, 3.0)]})
    status, output, _ = run("info", path)
    assert status == 0
    assert "repeated" in output
    assert "begins 2025-10-09 08:53:20.000" in output
    assert "/a?[31m" in output
    status, output, _ = run("info", path, "--json")
    assert json.loads(output)["topics"][0]["duplicates"] == 1


def test_info_of_a_table_has_no_rates(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,p\n0,1\n1,x\n")
    status, output, _ = run("info", tmp_path / "a.csv")
    assert status == 0
    assert "rate" not in output
    assert "'x' in column 'p' is not a number" in output


def test_recover_says_what_it_saved(run: Run, tmp_path: Path) -> None:
    clock = np.arange(20_000) / 1000
    whole = recordings.write(tmp_path / "whole.mcap", Recording(clock, {"current": clock}))
    torn = tmp_path / "torn.mcap"
    content = whole.read_bytes()
    torn.write_bytes(content[: len(content) // 2])
    status, output, messages = run("recover", torn)
    assert status == 0
    assert output.strip() == str(tmp_path / "torn-recovered.mcap")
    assert "torn at byte" in messages
    back = recordings.read(output.strip())
    assert f"{len(back)} messages over" in messages
    assert 0 < len(back) < 20_000
    status, _, messages = run("recover", tmp_path / "none.mcap")
    assert status == 2
    assert "no such file" in messages
    assert "Traceback" not in messages
