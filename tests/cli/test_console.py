"""What the console says is what the page shows: units, margins, reasons, what was not run."""

import re
from pathlib import Path

import pytest

from eha_bench.cli import console
from eha_bench.cli.run_summary import summary_lines
from eha_bench.core.note import Note
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Measure, Score, ScoreStatus

from .conftest import SUITE, Cli

DEGREES = """\
name: knee
trials:
  - id: step
    mode: joint_angle
    setup: {initial: {joint_angle: 60 deg}}
    duration: 0.5 s
    repeats: 3
    signal: {kind: step, initial: 60 deg, final: 80 deg, at: 1 ms}
    accept: {tracking_max: <= 2 deg, tracking_nrmse: <= 10 %}
  - id: still
    mode: current
    duration: 0.05 s
    signal: {kind: constant, value: 0 A}
"""


def test_values_are_in_the_units_of_the_suite_and_those_of_the_page(
    cli: Cli, tmp_path: Path
) -> None:
    (tmp_path / "knee.yaml").write_text(DEGREES)
    told = cli("run", "knee.yaml", "--out", "out", check=1).stderr
    (angle,) = [line for line in told.splitlines() if "tracking_max failed" in line]
    (share,) = [line for line in told.splitlines() if "tracking_nrmse failed" in line]
    assert " deg  (≤ 2 deg, " in angle
    assert " points over, worst of 3 repeats)" in share
    assert "rad" not in told
    assert not re.search(r"e[+-]\d\d", told)
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")
    for line in (angle, share):
        margin = re.search(r", ([^,]+ over)", line)
        assert margin is not None
        assert margin[1] in page
    assert "still  not judged  none" in told
    assert told.splitlines()[-1] == "knee: failed, 0 of 6 limits kept"


def test_five_of_a_kind_then_the_rest_is_counted(cli: Cli, tmp_path: Path) -> None:
    trials = "".join(
        f"  - {{id: t{i}, mode: current, setup: {{piston: locked}}, duration: 0.05 s, "
        "signal: {kind: step, final: 8 A, at: 1 ms}, accept: {tracking_max: <= 1 A}}\n"
        for i in range(7)
    )
    (tmp_path / "many.yaml").write_text(f"name: many\ntrials:\n{trials}")
    told = cli("run", "many.yaml", "--out", "a", check=1).stderr
    assert told.count("tracking_max failed") == 5
    assert "  ... and 2 more: --verbose shows all" in told
    assert cli("run", "many.yaml", "--out", "b", "-v", check=1).stderr.count("max failed") == 7


def test_after_a_stop_what_was_not_run_is_shown(cli: Cli, tmp_path: Path) -> None:
    text = SUITE.replace("    repeats: 2\n", "    repeats: 2\n    safety: {pressure_a: <= 1 MPa}\n")
    (tmp_path / "tiny.yaml").write_text(text)
    told = cli("run", "tiny.yaml", "--out", "out", check=3).stderr
    assert re.search(r"^hold +fault +none +1 not run$", told, re.MULTILINE)
    assert re.search(r"^sine +not run +none$", told, re.MULTILINE)
    assert told.splitlines()[-1].endswith(", 2 runs not made")
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "2 runs not made" in page
    assert "<h3>Not run</h3>" in page


def test_no_limits_are_no_success(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    (tmp_path / "none.yaml").write_text(
        SUITE.replace("accept:", "matters:")
        .replace("{channel: current, max: 12 A}", "1 A")
        .replace("{channel: current, max: 2 A}", "1 A")
    )
    told = cli("run", "none.yaml", "--out", "out", check=0).stderr
    assert "\x1b[33mnot judged\x1b[0m, no limits to keep" in told
    assert "\x1b[32m" not in told
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert 'class="verdict unjudged"' in page
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b" not in cli("run", "none.yaml", "--out", "b", check=0).stderr


def test_the_reason_of_a_score_is_why_it_has_none(cli: Cli, tmp_path: Path) -> None:
    text = SUITE.replace("tracking_max: {channel: current, max: 12 A}",
                         "settling_time: {channel: pressure_difference, max: 20 ms}")  # fmt: skip
    (tmp_path / "tiny.yaml").write_text(text)
    told = cli("run", "tiny.yaml", "--out", "out", check=1).stderr
    (line,) = [line for line in told.splitlines() if "settling_time" in line]
    assert "settling_time not scored" in line
    assert "settled" in line or "drift" in line
    assert "tracking_rms" not in told


def test_one_reason_stands_once_whatever_its_numbers() -> None:
    def unscored(metric: str, drift: float) -> Score:
        reason = Note(
            "not settled: it drifts by {drift:g} % of the step, of 2nd order", drift=drift
        )
        found = Measure.none(reason)
        return Score(metric, "current", found, "s", ScoreStatus.NOT_SCORED, limit="<= 1 s")

    scores = (unscored("rise_time", 13.6), unscored("settling_time", 9.5))
    run = TrialResult("step", 0, Status.FAILED, "", "", scores)
    lines = summary_lines(Result("tiny", "simulator", Status.FAILED, (run,), {}))
    assert lines == [
        "step  rise_time, settling_time not scored: not settled: it drifts by 9.5 to 13.6 % of "
        "the step, of 2nd order",
        "tiny: failed, 0 of 2 limits kept",
    ]


def test_reasons_that_are_mere_text_are_one_where_they_are_the_same() -> None:
    def unscored(metric: str, reason: str) -> Score:
        found = Measure.none(reason)
        return Score(metric, "current", found, "s", ScoreStatus.NOT_SCORED, limit="<= 1 s")

    scores = (
        unscored("rise_time", "no current"),
        unscored("settling_time", "no current"),
        unscored("overshoot", "it took 3 steps"),
        unscored("undershoot", "it took 4 steps"),
    )
    run = TrialResult("step", 0, Status.FAILED, "", "", scores)
    lines = summary_lines(Result("tiny", "simulator", Status.FAILED, (run,), {}))
    assert lines[:3] == [
        "step  rise_time, settling_time not scored: no current",
        "step  overshoot not scored: it took 3 steps (≤ 1 s)",
        "step  undershoot not scored: it took 4 steps (≤ 1 s)",
    ]


def test_a_list_fits_the_terminal_and_is_a_line_each_in_a_pipe(
    cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = cli("list", "signals", check=0).stdout
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "80")
    shown = re.sub(r"\x1b\[\d+m", "", cli("list", "signals", check=0).stdout)
    assert max(map(len, plain.splitlines())) > 80
    assert max(map(len, shown.splitlines())) <= 80
    assert sorted(shown.split()) == sorted(plain.split())


def test_without_a_terminal_progress_is_a_line_every_half_minute(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A diagnosis in CI takes minutes: its log says where it is."""
    now = [100.0]
    monkeypatch.setattr(console, "monotonic", lambda: now[0])
    with console.TerminalProgress() as progress:
        for seconds in (0.0, 29.0, 31.0, 45.0, 62.0):
            now[0] = 100.0 + seconds
            progress(int(seconds), 100, "search")
    assert capsys.readouterr().err.splitlines() == [
        "search: 31 of 100 after 31 s",
        "search: 62 of 100 after 62 s",
    ]
