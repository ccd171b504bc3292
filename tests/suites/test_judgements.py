"""Limits with confidence, over repeats, and relative to a baseline, from YAML to trial and back."""

import math
from pathlib import Path

import pytest

from eha_bench.core.errors import InputError
from eha_bench.core.limit import AcceptanceLimit, Repeats
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Measure, Score, ScoreStatus
from eha_bench.suites import load_suite, trial_from_source

CHANNEL = "pressure_difference"

SUITE = """\
name: judged
{top}
trials:
  - id: step
    mode: pressure
    duration: 0.5 s
    signal: {{kind: step, final: 15 MPa}}
    accept:
      response_time: {limit}
"""


def load(folder: Path, limit: str, top: str = "") -> AcceptanceLimit:
    path = folder / "suite.yaml"
    path.write_text(SUITE.format(limit=limit, top=top), encoding="utf-8")
    trial = load_suite(path).trials[0]
    assert trial_from_source(trial.source).limits == trial.limits
    return trial.limits[0]


def baseline(folder: Path, *values: float) -> None:
    trials = tuple(
        TrialResult(
            "step",
            repeat,
            Status.PASSED,
            "",
            "",
            (
                Score(
                    "response_time", "pressure_difference", Measure(value), "s", ScoreStatus.PASSED
                ),
            ),
        )
        for repeat, value in enumerate(values)
    )
    Result("judged", "simulator", Status.PASSED, trials).write(folder / "result.json")


@pytest.mark.parametrize(
    "text",
    [
        "<= 50 ms with 95 % confidence",
        "{limit: <= 50 ms, confidence: 95 %}",
        "{max: 50 ms, confidence: 95%}",
    ],
)
def test_confidence_is_words_or_a_key(tmp_path: Path, text: str) -> None:
    limit = load(tmp_path, text)
    assert limit.confident
    assert limit.bounds.high == 0.05
    assert limit.text == ("<= 50 ms with 95 % confidence")


def test_other_confidences_have_no_intervals(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"suite.yaml:\d+.*99.*95 %"):
        load(tmp_path, "<= 50 ms with 99 % confidence")


@pytest.mark.parametrize("which", ["worst", "median", "all"])
def test_repeats_are_a_key(tmp_path: Path, which: str) -> None:
    limit = load(tmp_path, f"{{limit: <= 50 ms, repeats: {which}}}")
    assert limit.repeats is Repeats(which)
    assert (which in limit.text) == (which != "all")


def test_a_judgement_needs_a_limit(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="needs a limit"):
        load(tmp_path, "{repeats: median}")


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [
        ("<= 110 % of baseline", -math.inf, 0.044),
        ("'>= 90 % of the baseline'", 0.036, math.inf),
        ("95 % .. 105 % of baseline with 95 % confidence", 0.038, 0.042),
        ("100 % +- 5 % of baseline", 0.038, 0.042),
    ],
)
def test_shares_of_the_baseline_become_figures(
    tmp_path: Path, text: str, low: float, high: float
) -> None:
    baseline(tmp_path, 0.039, 0.040, 0.047)
    limit = load(tmp_path, text, "baseline: result.json")
    assert limit.bounds.low == pytest.approx(low)
    assert limit.bounds.high == pytest.approx(high)
    assert "0.04 s" in limit.text
    assert limit.confident == ("confidence" in text)


def test_a_baseline_may_be_a_folder(tmp_path: Path) -> None:
    (tmp_path / "golden").mkdir()
    baseline(tmp_path / "golden", 0.04)
    assert load(tmp_path, "<= 110 % of baseline", "baseline: golden").bounds.high == pytest.approx(
        0.044
    )


def test_what_the_baseline_lacks_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the suite has none"):
        load(tmp_path, "<= 110 % of baseline")
    with pytest.raises(InputError, match="no such result"):
        load(tmp_path, "<= 110 % of baseline", "baseline: gone.json")
    baseline(tmp_path, math.nan)
    with pytest.raises(InputError, match=r"suite.yaml:\d+.*no response_time of trial 'step'"):
        load(tmp_path, "<= 110 % of baseline", "baseline: result.json")


def test_a_baseline_nobody_asks_for_is_not_read(tmp_path: Path) -> None:
    assert load(tmp_path, "<= 50 ms", "baseline: gone.json").bounds.high == 0.05
