"""JUnit XML: failures are missed limits, errors are faults and unfinished runs."""

import math
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sample_run import NASTY, SampleRun, score

from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import ScoreStatus
from eha_bench.report import write_junit
from eha_bench.report.junit import junit


def one(status: Status, *statuses: ScoreStatus, reason: str = "") -> Result:
    scores = tuple(
        score("peak", "pressure_a", math.nan if s is ScoreStatus.NOT_SCORED else 4e7, "Pa", s,
              f"<= {n} MPa", reason="no pressure_a")
        for n, s in enumerate(statuses)
    )  # fmt: skip
    run = TrialResult("a", 0, status, "", "", scores, reason)
    return Result("s", "t", status, (run,))


def counts(result: Result) -> dict[str, int]:
    root = ET.fromstring(junit(result))
    return {key: int(root.get(key, "-1")) for key in ("tests", "failures", "errors")}


def test_one_case_for_every_limit_of_every_run(sample: SampleRun, tmp_path: Path) -> None:
    path = tmp_path / "junit.xml"
    write_junit(path, sample.result)
    root = ET.parse(path).getroot()
    limits = sum(bool(s.limit) for run in sample.result.trials for s in run.scores)
    assert len(root.findall(".//testcase")) == limits == 21
    # 3 repeats too slow, one current, one undecided, one without its channel
    assert len(root.findall(".//failure")) == 6
    errors = root.findall(".//error")
    assert [error.get("type") for error in errors] == ["fault"]
    assert "safety limit" in (errors[0].get("message") or "")
    assert root.attrib["tests"] == "21"


@pytest.mark.parametrize(
    ("status", "score_status", "failures", "errors"),
    [
        (Status.PASSED, ScoreStatus.PASSED, 0, 0),
        (Status.PASSED, ScoreStatus.WARNED, 0, 0),
        (Status.FAILED, ScoreStatus.FAILED, 1, 0),
        (Status.FAILED, ScoreStatus.UNDECIDED, 1, 0),
        (Status.FAILED, ScoreStatus.NOT_SCORED, 1, 0),
        (Status.FAULT, ScoreStatus.NOT_SCORED, 0, 1),
        (Status.INCOMPLETE, ScoreStatus.NOT_SCORED, 0, 1),
        # a fault after the limit was kept is still a fault
        (Status.FAULT, ScoreStatus.PASSED, 0, 1),
    ],
)
def test_failure_or_error(
    status: Status, score_status: ScoreStatus, failures: int, errors: int
) -> None:
    found = counts(one(status, score_status, reason="it stopped"))
    assert (found["failures"], found["errors"]) == (failures, errors)


@pytest.mark.parametrize("status", list(Status))
def test_a_run_without_limits_is_one_case(status: Status) -> None:
    found = counts(one(status))
    assert found["tests"] == 1
    assert found["errors"] == (status in (Status.FAULT, Status.INCOMPLETE))
    assert found["failures"] == (status is Status.FAILED)


def test_an_interrupted_result_is_an_error_even_if_all_that_ran_passed() -> None:
    result = replace(one(Status.PASSED, ScoreStatus.PASSED), status=Status.INCOMPLETE)
    assert counts(result)["errors"] == 1


@pytest.mark.slow
@given(st.text(max_size=30), st.text(max_size=30))
def test_any_text_is_well_formed_xml(name: str, reason: str) -> None:
    result = replace(one(Status.FAULT, ScoreStatus.NOT_SCORED, reason=reason), suite=name)
    ET.fromstring(junit(result))


def test_markup_in_names_is_text() -> None:
    result = replace(one(Status.FAILED, ScoreStatus.FAILED), suite=NASTY)
    assert ET.fromstring(junit(result)).get("name") == NASTY
