"""`history --diagnose` by the command line: a leak that grows, nights that tell nothing."""

import json
import shutil
from pathlib import Path

import pytest

import eha_bench as eb
from eha_bench.core.result import Result, Status
from eha_bench.report.history_markdown import history_markdown
from eha_bench.trends.history import history_of
from eha_bench.trends.index import update
from eha_bench.trends.wear import causes_from

from .conftest import Cli

ROOT = Path(__file__).resolve().parents[2]
SUITE = """\
name: nightly
trials:
  - id: step
    mode: pressure
    setup: {piston: locked}
    duration: 0.3 s
    signal: {kind: step, final: 15 MPa, at: 50 ms}
    accept: {response_time: <= 60 ms, steady_state_error: +- 0.2 MPa}
"""
NIGHTLY = """\
send: cat
when: always
diagnose:
  model: physical
  suite: suite.yaml
  target: physical
  follow: [command_delay, entrained_air]
"""
WORN_FROM = 9


def night(folder: Path, number: int, parameters: str) -> Path:
    machine = (ROOT / "suites/models/physical.yaml").read_text(encoding="utf-8")
    own = machine.replace("parameters:", f"parameters:\n{parameters}")
    (folder / "machine.yaml").write_text(own, encoding="utf-8")
    controller = ROOT / "suites/controllers/physical.yaml"
    (folder / "target.yaml").write_text(
        f"target: simulator\nmodel: machine.yaml\ncontroller: {controller}\nstep: 50 us\n"
    )
    (folder / "tonight.yaml").write_text(f"{SUITE}    seed: {number}\n")
    out = folder / "nights" / f"{number:02d}"
    eb.run(folder / "tonight.yaml", target=folder / "target.yaml", out=out)
    return out


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sixteen nights: a growing leak, one without its recording, one of another machine."""
    folder = tmp_path_factory.mktemp("lives")
    (folder / "suite.yaml").write_text(SUITE)
    (folder / "nightly.yaml").write_text(NIGHTLY)
    for number in range(17):
        leakage = 2e-15 + 4e-15 * max(0, number - WORN_FROM)
        strange = number == 6
        out = night(
            folder,
            number,
            f"  leakage: {leakage} m^3/(s*Pa)\n"
            + ("  torque_constant: 0.02 N*m/A\n" if strange else ""),
        )
        if number == 4:
            shutil.rmtree(out / "recordings")
    return folder


@pytest.mark.slow
def test_the_leak_is_named_with_its_rate_and_what_is_left(archive: Path, cli: Cli) -> None:
    nights = archive / "nights"
    done = cli("history", nights, "--config", archive / "nightly.yaml")
    assert done.returncode == 1, done.stderr
    assert "leakage: 1.97" in done.stderr or "leakage: 2.0" in done.stderr
    causes = json.loads((nights / "history/history.json").read_text())["causes"]
    [wear] = causes["wear"]
    assert wear["cause"] == "leakage"
    assert wear["alarm"]
    assert abs(wear["rate_per_night"]["value"] / 4e-15 - 1.0) < 0.05
    assert wear["since"]["result"] in ("09/result.json", "10/result.json", "11/result.json")
    left = wear["nights_left"]
    assert left["low"] < left["value"] < left["high"]
    assert wear["limit"]["metric"] == "response_time"
    untold = {item["night"]["result"]: item["reason"] for item in causes["untold"]}
    assert "not there" in untold["04/result.json"]
    assert "does not converge" in untold["06/result.json"]
    shown = {item["result"] for trend in causes["trends"] for item in trend["nights"]}
    assert not shown & {"04/result.json", "06/result.json"}
    page = (nights / "history/index.html").read_text(encoding="utf-8")
    assert ">change</text>" in page
    assert "first limit: step" in page
    kept = sorted((nights / "history/causes").glob("night-*.json"))
    stamps = [path.stat().st_mtime_ns for path in kept]
    again = cli("history", nights, "--diagnose", archive / "nightly.yaml", "--json")
    assert json.loads(again.stdout)["causes"]["wear"] == causes["wear"]
    assert [path.stat().st_mtime_ns for path in kept] == stamps


@pytest.mark.slow
def test_what_was_found_comes_back_for_serving(archive: Path, cli: Cli) -> None:
    nights = archive / "nights"
    cli("history", nights, "--diagnose", archive / "nightly.yaml")
    data = json.loads((nights / "history/history.json").read_text())["causes"]
    history = history_of(update(archive / "again.sqlite", nights), "nights")
    found = causes_from(data, history.nights)
    assert found.to_dict() == data
    assert "leakage" in history_markdown(eb.history(nights, archive / "site",
                                                    diagnose=archive / "nightly.yaml"))  # fmt: skip


@pytest.mark.slow
def test_damaged_estimates_are_made_anew(archive: Path, cli: Cli) -> None:
    nights = archive / "nights"
    cli("history", nights, "--diagnose", archive / "nightly.yaml")
    before = json.loads((nights / "history/history.json").read_text())["causes"]["wear"]
    for path in (nights / "history/causes").glob("night-*.json"):
        path.write_text("{}", encoding="utf-8")
    cli("history", nights, "--diagnose", archive / "nightly.yaml")
    after = json.loads((nights / "history/history.json").read_text())["causes"]["wear"]
    assert after[0]["cause"] == before[0]["cause"]


def test_an_unknown_effect_is_a_sentence_and_writes_nothing(tmp_path: Path, cli: Cli) -> None:
    (tmp_path / "nights" / "00").mkdir(parents=True)
    Result("nightly", "rig", Status.PASSED, ()).write(tmp_path / "nights" / "00" / "result.json")
    file = tmp_path / "nightly.yaml"
    file.write_text("diagnose:\n  model: physical\n  follow: [entrained_airs]\n")
    done = cli("history", tmp_path / "nights", "--diagnose", file)
    assert done.returncode == 2
    assert "nightly.yaml:3" in done.stderr
    assert "diagnose.follow.0" in done.stderr
    assert "entrained_air" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "nights" / "history").exists()


def test_too_few_nights_are_said(tmp_path: Path, cli: Cli) -> None:
    (tmp_path / "suite.yaml").write_text(SUITE)
    (tmp_path / "nightly.yaml").write_text(NIGHTLY.replace("send: cat\nwhen: always\n", ""))
    night(tmp_path, 0, "  leakage: 2e-15 m^3/(s*Pa)")
    done = cli("history", tmp_path / "nights", "--diagnose", tmp_path / "nightly.yaml")
    assert done.returncode == 0, done.stderr
    assert "no cause can be named yet" in done.stderr
