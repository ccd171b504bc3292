"""Markdown for pull requests and step summaries."""

from dataclasses import replace
from pathlib import Path

import pytest
from sample_run import NASTY, SampleRun

from eha_bench.core.errors import InputError
from eha_bench.core.result import Status
from eha_bench.report import append_step_summary, markdown_summary
from eha_bench.report.markdown import STEP_SUMMARY_BYTES, as_text


def test_summary_tells_the_verdict_and_the_worst_first(sample: SampleRun) -> None:
    text = markdown_summary(sample.result, sample.trials)
    lines = text.splitlines()
    assert lines[0] == "## ⛔ paper on simulator: fault"
    assert "4 of 21 limits missed, 1 undecided, 2 not scored" in text
    first = next(line for line in lines if "over" in line)
    assert "pressure\\_step-20MPa" in first
    assert "2.58\u00a0ms (5.7\u00a0%) over" in first
    assert "| 6 of 9 |" in text


def test_a_run_without_limits_passes_nothing(sample: SampleRun) -> None:
    passed = next(run for run in sample.result.trials if run.status is Status.PASSED)
    unlimited = tuple(replace(score, limit="") for score in passed.scores)
    run = replace(passed, scores=unlimited)
    text = markdown_summary(replace(sample.result, status=Status.PASSED, trials=(run,)))
    assert "not judged" in text.splitlines()[0]
    assert "passed" not in text


def test_summary_needs_no_trials(sample: SampleRun) -> None:
    assert "48.16 ms" in markdown_summary(sample.result)


def test_names_are_text(sample: SampleRun) -> None:
    run = replace(sample.result.trials[0], id="a|b\n`c`", reason=NASTY)
    text = markdown_summary(replace(sample.result, suite=NASTY, trials=(run,)))
    assert "<script" not in text.replace("\\<script", "")
    assert "a\\|b \\`c\\`" in text


def test_sentences_read_as_they_are_where_markdown_reads_nothing_in_them() -> None:
    for plain in ("2 runs: too few (8 are needed).", "step-10MPa, 3 -> 4 ms!", "16:05 UTC +0.3 %"):
        assert as_text(plain) == plain
    assert as_text("- see https://a.b/c :bug: *x* <b>") == (
        "\\- see https\\://a.b/c \\:bug: \\*x\\* \\<b>"
    )


def test_every_table_row_has_as_many_cells_as_its_heading(sample: SampleRun) -> None:
    for block in markdown_summary(sample.result, sample.trials).split("\n\n"):
        lines = [line for line in block.splitlines() if line.startswith("|")]
        cells = {line.replace("\\|", "").count("|") for line in lines}
        assert len(cells) <= 1, block


def test_appends_only_where_asked(sample: SampleRun, tmp_path: Path) -> None:
    assert not append_step_summary("text", {})
    path = tmp_path / "summary.md"
    path.write_text("before\n", encoding="utf-8")
    assert append_step_summary("text\n", {"GITHUB_STEP_SUMMARY": str(path)})
    assert path.read_text(encoding="utf-8") == "before\ntext\n"


def test_a_summary_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="GITHUB_STEP_SUMMARY"):
        append_step_summary("text", {"GITHUB_STEP_SUMMARY": str(tmp_path)})


def test_stays_below_the_limit(tmp_path: Path) -> None:
    path = tmp_path / "summary.md"
    environment = {"GITHUB_STEP_SUMMARY": str(path)}
    for _ in range(3):
        append_step_summary("| ärger | 1 |\n" * 60_000, environment)
    assert path.stat().st_size < STEP_SUMMARY_BYTES
    text = path.read_text(encoding="utf-8")
    assert text.count("shortened") >= 1
    assert path.stat().st_size > STEP_SUMMARY_BYTES * 0.95
