"""No run destroys another: folders of their own, earlier runs set aside, resuming one's own."""

import fcntl
import json
import os
import shlex
import signal
import time
from pathlib import Path

import pytest

import eha_bench as eb
from eha_bench.bench.store import SuiteFolder, set_aside
from eha_bench.core.errors import InputError
from forked import Forked

from .conftest import SUITE, Cli

SHORT = SUITE.partition("  - id: sine")[0].replace("repeats: 2", "repeats: 1")


@pytest.fixture
def short(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.yaml"
    path.write_text(SHORT, encoding="utf-8")
    return path


def test_every_run_has_a_folder_of_its_own_and_latest_is_the_newest(
    cli: Cli, short: Path, tmp_path: Path
) -> None:
    reports = [Path(cli("run", short, check=0).stdout.strip()) for _ in range(2)]
    assert len(set(reports)) == 2
    assert all(report.is_file() for report in reports)
    latest = tmp_path / "reports" / "tiny" / "latest"
    assert latest.is_symlink()
    assert latest.resolve() == reports[1].resolve().parent
    # the link is not a third result
    assert "2 runs, " in cli("history", "reports/tiny", check=0).stderr


def test_an_occupied_folder_is_set_aside_and_that_is_told(
    cli: Cli, short: Path, tmp_path: Path
) -> None:
    cli("run", short, "--out", "out", check=0)
    first = (tmp_path / "out" / "result.json").read_bytes()
    told = cli("run", short, "--out", "out", check=0).stderr
    (aside,) = tmp_path.glob("out-*")
    assert f"note: out held an earlier run, which is now in {aside.name}" in told
    assert (aside / "result.json").read_bytes() == first
    assert (aside / "recordings" / "hold-0.mcap").is_file()
    cli("run", short, "--out", "out", check=0)
    assert len(list(tmp_path.glob("out-*"))) == 2


def test_bad_input_moves_nothing(cli: Cli, short: Path, tmp_path: Path) -> None:
    cli("run", short, "--out", "out", check=0)
    short.write_text(SHORT.replace("8 A", "8 MPa"), encoding="utf-8")
    cli("run", short, "--out", "out", check=2)
    assert not list(tmp_path.glob("out-*"))
    assert (tmp_path / "out" / "result.json").is_file()
    cli("run", short, check=2)
    assert not (tmp_path / "reports").exists()


def test_a_folder_in_use_is_refused(cli: Cli, short: Path, tmp_path: Path) -> None:
    cli("run", short, "--out", "out", check=0)
    handle = os.open(tmp_path / "out", os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        for more in ((), ("--resume",)):
            refused = cli("run", short, "--out", "out", *more, check=2)
            assert "out: another run is writing there" in refused.stderr
    finally:
        os.close(handle)
    assert not list(tmp_path.glob("out-*"))


def test_the_folder_one_stands_in_and_a_link_are_not_renamed(
    cli: Cli, short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report = cli("run", short, check=0).stdout.strip()
    refused = cli("run", short, "--out", "reports/tiny/latest", check=2)
    assert "is a link to the folder of an earlier run" in refused.stderr
    monkeypatch.chdir(Path(report).parent)
    with pytest.raises(InputError, match="the folder you are in"):
        set_aside(Path())


def test_resume_goes_on_with_the_latest_of_its_suite_only(
    cli: Cli, short: Path, tmp_path: Path
) -> None:
    assert "a new one starts" in cli("run", short, "--resume", check=0).stderr
    latest = SuiteFolder("tiny").latest()
    assert latest is not None
    kept = latest / "recordings" / "hold-0.mcap"
    before = kept.stat().st_mtime_ns
    cli("run", short, "--resume", check=0)
    assert kept.stat().st_mtime_ns == before
    (tmp_path / "other.yaml").write_text("model: eha_knee\nparameters: {leakage: 1e-13}\n")
    refused = cli("run", short, "--target", "other.yaml", "--resume", check=2)
    assert "holds a run of another model" in refused.stderr


def test_ctrl_c_names_the_command_that_goes_on(
    cli: Cli, forked: Forked, suite: Path, tmp_path: Path
) -> None:
    suite.write_text(SUITE.replace("repeats: 2", "repeats: 400"), encoding="utf-8")
    process = forked.start("run", suite.name, folder=tmp_path)
    deadline = time.monotonic() + 300
    while len(list(tmp_path.glob("reports/tiny/2*/recordings/hold-*.mcap"))) < 2:
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=120)
    assert process.returncode == 130
    (line,) = [line for line in told.splitlines() if line.startswith("interrupted; to go on: ")]
    words = shlex.split(line.partition(": ")[2])
    assert words[:2] == ["eha-bench", "run"]
    assert words[-1] == "--resume"
    result = json.loads((tmp_path / words[-2] / "result.json").read_text(encoding="utf-8"))
    made = len([trial for trial in result["trials"] if trial["status"] == "passed"])
    assert len(result["not_run"]) + len(result["trials"]) == 401
    suite.write_text(suite.read_text().replace("repeats: 400", "repeats: 401"))
    # another suite now: what that command named is not continued by it
    again = cli(*words[1:], check=2)
    assert made >= 1
    assert "holds a run of another suite" in again.stderr


def test_ab_sets_an_earlier_run_aside(cli: Cli, short: Path, tmp_path: Path) -> None:
    words = ("ab", short, "--a", "simulator", "--b", "simulator", "--repeats", "1",
             "--warm-up", "0", "--out", "ab")  # fmt: skip
    cli(*words, check=0)
    first = (tmp_path / "ab" / "comparison.json").read_bytes()
    cli(*words, check=0)
    (aside,) = tmp_path.glob("ab-*")
    assert (aside / "comparison.json").read_bytes() == first


def test_python_tells_where_a_run_lies(
    short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = eb.run(short)
    assert result.folder is not None
    assert (result.folder / "report.html").is_file()
    assert result.folder.parent == Path("reports/tiny")
