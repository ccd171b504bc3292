"""`eha-bench run` from YAML to report, interrupted, resumed, and with everything wrong."""

import json
import signal
import time
from pathlib import Path
from typing import Any

import pytest

import eha_bench as eb
from eha_bench.core.result import Result
from forked import Forked

from .conftest import SUITE, Cli


def result_of(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    return content


def test_a_run_leaves_recordings_result_and_reports(cli: Cli, suite: Path, tmp_path: Path) -> None:
    done = cli("run", suite, "--out", "out", check=0)
    out = tmp_path / "out"
    assert done.stdout.strip().splitlines()[-1] == "out/report.html"
    result = result_of(out)
    assert result["schema_version"] == 1
    assert result["status"] == "passed"
    assert [(t["id"], t["repeat"]) for t in result["trials"]] == [
        ("hold", 0), ("hold", 1), ("sine", 0),
    ]  # fmt: skip
    for trial in result["trials"]:
        assert (out / trial["recording"]).is_file()
        assert len(trial["sha256"]) == 64
    for name in ("report.html", "junit.xml", "summary.md"):
        assert (out / name).stat().st_size > 100
    for key in ("version", "revision", "host", "started", "model_sha256", "controller_sha256"):
        assert key in result["provenance"]


def test_json_goes_to_standard_output_and_nothing_else_does(cli: Cli, suite: Path) -> None:
    done = cli("run", suite, "--out", "out", "--json", check=0)
    assert json.loads(done.stdout)["suite"] == "tiny"


def test_a_formula_is_summed_up_over_repeats(cli: Cli, suite: Path, tmp_path: Path) -> None:
    text = SUITE.replace("max: 12 A}\n", "max: 12 A}\n      lift: <= 12 A\n")
    text += "metrics:\n  lift: {expression: max(current), unit: A}\n"
    suite.write_text(text, encoding="utf-8")
    cli("run", suite, "--out", "out", check=0)
    scored = cli("score", *(f"out/recordings/hold-{n}.mcap" for n in (0, 1)), "--json", check=0)
    for result in (result_of(tmp_path / "out"), json.loads(scored.stdout)):
        assert ("hold", "lift") in [(one["trial"], one["metric"]) for one in result["repeats"]]


def test_a_missed_limit_is_exit_status_1(cli: Cli, suite: Path) -> None:
    suite.write_text(SUITE.replace("max: 12 A", "max: 1 A"), encoding="utf-8")
    done = cli("run", suite, "--out", "out", check=1)
    assert "tracking_max failed" in done.stderr


def test_a_safety_limit_is_exit_status_3_and_keeps_the_recording(
    cli: Cli, suite: Path, tmp_path: Path
) -> None:
    text = SUITE.replace("    repeats: 2\n", "    repeats: 2\n    safety: {pressure_a: <= 1 MPa}\n")
    suite.write_text(text, encoding="utf-8")
    done = cli("run", suite, "--out", "out", check=3)
    assert "safety" in done.stderr
    result = result_of(tmp_path / "out")
    assert result["status"] == "fault"
    recording = eb.read(tmp_path / "out" / result["trials"][0]["recording"])
    assert 0 < len(recording) < 100
    assert recording.metadata["ending"] == "safety stop"


def test_scoring_a_recording_alone_gives_the_same_scores(
    cli: Cli, ran: Path, suite: Path, tmp_path: Path
) -> None:
    first = result_of(ran)["trials"]
    suite.unlink()
    paths = [ran / trial["recording"] for trial in first]
    cli("score", *paths, "--out", "again", check=0)
    again = result_of(tmp_path / "again")["trials"]
    assert [trial["scores"] for trial in again] == [trial["scores"] for trial in first]


def test_resume_runs_only_what_is_missing(cli: Cli, ran: Path, suite: Path) -> None:
    kept = ran / "recordings" / "hold-0.mcap"
    before = kept.stat().st_mtime_ns
    (ran / "recordings" / "sine-0.mcap").unlink()
    cli("run", suite, "--out", "ran", "--resume", check=0)
    assert kept.stat().st_mtime_ns == before
    assert (ran / "recordings" / "sine-0.mcap").is_file()
    assert result_of(ran)["status"] == "passed"


def test_resume_does_not_trust_another_suite_or_a_changed_recording(
    cli: Cli, ran: Path, suite: Path
) -> None:
    kept = ran / "recordings" / "hold-0.mcap"
    before = kept.stat().st_mtime_ns
    suite.write_text(SUITE.replace("8 A", "9 A"), encoding="utf-8")
    refused = cli("run", suite, "--out", "ran", "--resume", check=2)
    assert "ran: holds a run of another suite, which cannot be resumed" in refused.stderr
    assert kept.stat().st_mtime_ns == before
    suite.write_text(SUITE, encoding="utf-8")
    kept.write_bytes(b"not what it was")
    cli("run", suite, "--out", "ran", "--resume", check=0)
    assert len(eb.read(kept)) == 100


def test_ctrl_c_leaves_readable_recordings_and_an_incomplete_result(
    forked: Forked, suite: Path, tmp_path: Path
) -> None:
    long = SUITE.replace("repeats: 2", "repeats: 2000").replace("0.1 s", "0.5 s")
    suite.write_text(long, encoding="utf-8")
    process = forked.start("run", suite, "--out", "out", folder=tmp_path)
    recordings = tmp_path / "out" / "recordings"
    try:
        # the first run on a machine compiles the plant's kernel
        deadline = time.monotonic() + 300
        while len(list(recordings.glob("hold-*.mcap"))) < 3:
            assert process.poll() is None, process.communicate(10.0)
            assert time.monotonic() < deadline
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=120)
    finally:
        process.kill()
    assert "Traceback" not in errors
    assert process.returncode == 130
    result = result_of(tmp_path / "out")
    assert result["status"] == "incomplete"
    # the third may have been written and not yet scored
    assert len(result["trials"]) >= 2
    for trial in result["trials"]:
        assert len(eb.read(tmp_path / "out" / trial["recording"])) > 0
    assert (tmp_path / "out" / "report.html").is_file()


def test_a_folder_with_other_things_is_left_alone(cli: Cli, suite: Path, tmp_path: Path) -> None:
    precious = tmp_path / "out" / "thesis.tex"
    precious.parent.mkdir()
    precious.write_text("years of work", encoding="utf-8")
    done = cli("run", suite, "--out", "out", check=2)
    assert "not a result folder" in done.stderr
    assert list(precious.parent.iterdir()) == [precious]


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("8 A", "8 MPa", 8, "wrong dimension"),
        ("kind: step", "kind: stp", 8, "step"),
        ("mode: current", "mode: curent", 4, "current"),
        ("tracking_max:", "tracking_mux:", 10, "tracking_max"),
        ("id: hold", "id: ../hold", 3, "id"),
        ("duration: 0.1 s", "duration: -1 s", 6, "duration|greater|negative"),
        ("name: tiny", "name: [", 1, "YAML|name"),
    ],
)
def test_a_mistake_in_a_suite_is_one_sentence_with_its_place(
    cli: Cli, suite: Path, tmp_path: Path, old: str, new: str, line: int, message: str
) -> None:
    suite.write_text(SUITE.replace(old, new, 1), encoding="utf-8")
    done = cli("run", suite, "--out", "out", check=2)
    assert len(done.stderr.strip().splitlines()) == 1
    assert any(word in done.stderr for word in message.split("|"))
    assert f"tiny.yaml:{line}" in done.stderr or "YAML" in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("target", ["warp_drive", "missing.yaml"])
def test_an_unknown_target_is_bad_input(cli: Cli, suite: Path, target: str) -> None:
    assert target in cli("run", suite, "--target", target, check=2).stderr


def test_a_missing_suite_is_bad_input(cli: Cli) -> None:
    assert "nothing.yaml: no such file" in cli("run", "nothing.yaml", check=2).stderr


def test_a_model_file_is_a_target(cli: Cli, suite: Path, tmp_path: Path) -> None:
    model = tmp_path / "revised.yaml"
    model.write_text("model: eha_knee\nparameters: {leakage: 1e-13}\n", encoding="utf-8")
    cli("run", suite, "--target", model, "--out", "a", check=0)
    cli("run", suite, "--out", "b", check=0)
    digests = [result_of(tmp_path / name)["provenance"]["model_sha256"] for name in "ab"]
    assert digests[0] != digests[1]


@pytest.mark.parametrize("limit", ["0 s", "-5 s"])
def test_a_time_limit_is_more_than_nothing(cli: Cli, suite: Path, limit: str) -> None:
    done = cli("run", suite, "--time-limit", limit, "--out", "out", check=2)
    assert f"--time-limit '{limit}' is not positive" in done.stderr
    assert not Path("out").exists()


def test_a_dry_run_is_json_where_that_is_asked_for(cli: Cli, suite: Path) -> None:
    done = cli("run", suite, "--dry-run", "--json", check=0)
    assert list(json.loads(done.stdout)["trials"]) == ["hold", "sine"]
    assert not done.stderr


def test_a_step_summary_that_cannot_be_written_is_no_verdict(
    cli: Cli, suite: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", "/nowhere/summary.md")
    done = cli("run", suite, "--out", "out", check=0)
    assert "/nowhere/summary.md: cannot append the step summary" in done.stderr
    assert Path("out/report.html").is_file()


def test_a_channel_that_is_not_measured_cannot_be_safe(cli: Cli, suite: Path) -> None:
    text = suite.read_text().replace("    duration", "    safety: {force: <= 3 N}\n    duration")
    suite.write_text(text)
    done = cli("run", suite, "--out", "out", check=3)
    assert "safety limit force <= 3 N: the target does not measure it" in done.stderr


def test_limits_are_si_in_the_result_and_as_written_for_people(
    cli: Cli, suite: Path, tmp_path: Path
) -> None:
    suite.write_text(SUITE.replace("max: 12 A", "max: 1200 mA"), encoding="utf-8")
    done = cli("run", suite, "--out", "out", check=1)
    assert "(≤ 1200 mA, " in done.stderr
    (first, *_) = result_of(tmp_path / "out")["trials"][0]["scores"]
    assert (first["limit"], first["limit_written"]) == ("<= 1.2 A", "<= 1200 mA")
    (read, *_) = Result.read(tmp_path / "out" / "result.json").trials[0].scores
    assert (read.limit, read.limit_in_si) == ("<= 1200 mA", "<= 1.2 A")
    for name in ("junit.xml", "summary.md"):
        assert "1200 mA" in (tmp_path / "out" / name).read_text(encoding="utf-8")


def test_a_result_of_before_has_one_limit(tmp_path: Path) -> None:
    score = {"metric": "peak", "value": 1.0, "status": "passed", "limit": "<= 2 mA"}
    trial = {"id": "a", "status": "passed", "scores": [score]}
    path = tmp_path / "result.json"
    content = {"schema_version": 1, "suite": "s", "target": "t", "status": "passed"}
    path.write_text(json.dumps({**content, "trials": [trial]}), encoding="utf-8")
    found = Result.read(path)
    assert found.trials[0].scores[0].limit == "<= 2 mA"
    found.write(path)
    again = result_of(tmp_path)["trials"][0]["scores"][0]
    assert (again["limit"], again["limit_written"]) == ("<= 2 mA", "<= 2 mA")


def test_a_target_that_brings_its_model_does_not_ask_for_the_suites(
    cli: Cli, suite: Path, tmp_path: Path
) -> None:
    suite.write_text(f"model: gone.yaml\n{suite.read_text()}", encoding="utf-8")
    done = cli("run", suite, "--out", "out", check=2)
    assert f"{suite.name}:1, key 'model'" in done.stderr
    (tmp_path / "own.yaml").write_text("model: eha_knee\n", encoding="utf-8")
    cli("run", suite, "--target", "own.yaml", "--out", "out")
    assert result_of(tmp_path / "out")["trials"]
