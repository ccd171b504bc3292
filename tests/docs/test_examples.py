"""The examples run, and print what they promise; that of EMPS in tests/diagnosis/test_emps.py."""

import json
import subprocess
import sys
from pathlib import Path
from statistics import median

import pytest
from pages import ROOT

EXAMPLES = ROOT / "examples"
SKIPPED = 77

pytestmark = pytest.mark.slow


def run(script: str, folder: Path) -> str:
    """Run an example into a folder and return what it printed."""
    command = [sys.executable, str(EXAMPLES / script), str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=500)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_paper_is_reproduced(tmp_path: Path) -> None:
    printed = run("paper_reproduced.py", tmp_path)
    rows = [line for line in printed.splitlines() if " % " in line or line.endswith("%")]
    assert len(rows) == 8
    assert printed.count("passed") == 2
    assert (tmp_path / "physical" / "report.html").is_file()


def test_controllers_are_compared(tmp_path: Path) -> None:
    printed = run("compare_controllers/compare_controllers.py", tmp_path)
    assert "steady_state_error: worse" in printed
    assert (tmp_path / "comparison" / "comparison.html").is_file()


@pytest.mark.slow(51)
def test_a_leak_grows_on_the_played_rig(tmp_path: Path) -> None:
    script = EXAMPLES / "week_of_nights" / "week_of_nights.py"
    command = [sys.executable, str(script), str(tmp_path), "--nights", "3", "--leak", "1e-14"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=900)
    # it runs in real time: a night in which a machine stalls is not scored, and names nothing
    assert done.returncode in (0, 1), done.stdout + done.stderr
    history = tmp_path / "nights" / "history"
    causes = json.loads((history / "history.json").read_text(encoding="utf-8"))["causes"]
    assert {wear["cause"] for wear in causes["wear"]} <= {"leakage"}
    [leak] = [trend for trend in causes["trends"] if trend["cause"] == "leakage"]
    values = {item["result"]: v for item, v in zip(leak["nights"], leak["values"], strict=True)}
    healthy = [value for name, value in values.items() if name < "08"]
    worn = [value for name, value in values.items() if name >= "08"]
    assert len(healthy) >= 6
    assert median(worn) > 2.0 * max(healthy)
    assert "page:" in done.stdout
    assert (history / "index.html").is_file()


def test_without_the_measurements_it_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("EHA_BENCH_SHARED", str(tmp_path))
    command = [sys.executable, str(EXAMPLES / "close_the_loop_on_emps.py"), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == SKIPPED
    assert "skipped: no measurements at" in done.stderr
