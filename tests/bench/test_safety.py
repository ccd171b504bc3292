"""A recording beyond a safety limit does not pass, whoever made it, stopped or not."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import eha_bench
from eha_bench.bench.safety import breach, unchecked
from eha_bench.comparison.side import load_side
from eha_bench.core.limit import Bounds, SafetyLimit
from eha_bench.core.recording import Recording
from eha_bench.core.result import Result, Status
from eha_bench.core.trial import Trial
from eha_bench.suites import load_suite

Echo = Callable[..., Path]
TIME = np.arange(5) / 100.0


def trial(**safety: str) -> Trial:
    signal = {"kind": "step", "final": "5 MPa"}
    only = {"id": "a", "mode": "pressure", "duration": "1 s", "signal": signal, "safety": safety}
    return load_suite({"name": "s", "trials": [only]}).trials[0]


def test_the_first_reading_outside_is_said_with_value_and_time() -> None:
    asked = trial(pressure_a="<= 2 MPa", current="-1 A .. 1 A")
    pressure = np.array([0.0, 1.0, 2.0, 2.5, 3.0]) * 1e6
    inside = Recording(TIME, {"pressure_a": np.minimum(pressure, 2e6), "current": 0 * TIME + 1.0})
    assert breach(inside, asked) == ""
    assert list(unchecked(inside, asked)) == []
    over = Recording(TIME + 7.0, {"pressure_a": pressure, "current": 0 * TIME})
    assert breach(over, asked) == "safety limit pressure_a <= 2 MPa: 2.5 MPa at 7.03 s"
    sooner = Recording(TIME, {"pressure_a": pressure, "current": np.array([0, 0, -3, 0, 9])})
    assert breach(sooner, asked) == "safety limit current -1 A .. 1 A: -3 A at 0.02 s"


def test_a_difference_that_follows_from_what_was_recorded_is_held_to_its_limit() -> None:
    made = Recording(TIME, {"pressure_a": 1e8 * TIME, "pressure_b": 0 * TIME})
    found = breach(made, trial(pressure_difference="<= 2.5 MPa"))
    assert found == "safety limit pressure_difference <= 2.5 MPa: 3 MPa at 0.03 s"


@pytest.mark.parametrize(
    ("values", "units", "why"),
    [
        ({}, {}, "no current was recorded"),
        ({"current": np.full(5, np.nan)}, {}, "no current was recorded"),
        ({"current": 0 * TIME + 900.0}, {"current": "mA"}, "it was recorded in mA"),
    ],
)
def test_what_cannot_be_held_to_a_limit_is_said(
    values: dict[str, np.ndarray], units: dict[str, str], why: str
) -> None:
    made, asked = Recording(TIME, {"pressure_a": TIME, **values}, units), trial(current="<= 5 A")
    assert breach(made, asked) == ""
    assert list(unchecked(made, asked)) == [f"safety limit current <= 5 A not checked: {why}"]


@pytest.mark.parametrize(
    ("quantity", "spelling"), [("torque", "Nm"), ("torque", "m*N"), ("acceleration", "m/s2")]
)
def test_another_spelling_of_a_unit_is_held_to_its_limit(quantity: str, spelling: str) -> None:
    unit = {"torque": "N*m", "acceleration": "m/s^2"}[quantity]
    limit = SafetyLimit(quantity, Bounds(high=5.0), f"<= 5 {unit}", unit)
    asked = replace(trial(), safety=(limit,))
    made = Recording(TIME, {quantity: 0 * TIME + 9.0}, {quantity: spelling})
    assert breach(made, asked).startswith(f"safety limit {quantity} <= 5 {unit}: 9 ")
    assert list(unchecked(made, asked)) == []
    other = Recording(TIME, {quantity: 0 * TIME + 9.0}, {quantity: "kPa"})
    assert breach(other, asked) == ""
    assert len(list(unchecked(other, asked))) == 1


def test_a_gap_is_no_breach_and_hides_none() -> None:
    made = Recording(TIME, {"current": np.array([0.0, np.nan, 0.0, 9.0, np.nan])})
    assert breach(made, trial(current="<= 5 A")) == "safety limit current <= 5 A: 9 A at 0.03 s"


def test_a_target_that_runs_on_beyond_a_limit_is_stopped(
    suite: Path, echo: Echo, tmp_path: Path
) -> None:
    safety = "safety: {current: <= 1 A}\n    accept: {"
    suite.write_text(suite.read_text().replace("accept: {", safety, 1))
    out = tmp_path / "out"
    result = eha_bench.run(suite, echo(), out)
    assert (result.status, result.status.exit_status) == (Status.FAULT, 3)
    assert result.provenance["stopped_by"] == "safety stop"
    assert result.not_run == (("second", 0),)
    said = "safety stop: safety limit current <= 1 A: 2 A at 0.005 s, and the target ran on; let"
    assert result.trials[0].reason.startswith(said)
    made = out / result.trials[0].recording
    again = eha_bench.score_files([made], out=tmp_path / "scored")
    assert again.status is Status.FAULT
    assert result.trials[0].reason == f"safety stop: {again.trials[0].reason}"


def test_a_run_is_held_against_its_limits_once(
    suite: Path, echo: Echo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[str] = []

    def counted(recording: Recording, of: Trial) -> str:
        looked.append(of.id)
        return breach(recording, of)

    for room in ("run", "judging"):
        monkeypatch.setattr(f"eha_bench.bench.{room}.breach", counted)
    result = eha_bench.run(suite, echo(), tmp_path / "out")
    assert looked == [item.id for item in result.trials]
    made = tmp_path / "out" / result.trials[0].recording
    eha_bench.score_files([made], out=tmp_path / "scored")
    assert looked[len(result.trials) :] == [result.trials[0].id]


def test_a_log_beyond_a_limit_is_scored_and_does_not_pass(
    suite: Path, echo: Echo, tmp_path: Path
) -> None:
    done = eha_bench.run(suite, echo(), tmp_path / "out")
    assert done.status is Status.PASSED
    suite.write_text(
        suite.read_text().replace("accept: {", "safety: {current: <= 2.5 A}\n    accept: {")
    )
    made = [tmp_path / "out" / item.recording for item in done.trials]
    eha_bench.score_files(made, suite, out=tmp_path / "scored")
    first, second = Result.read(tmp_path / "scored/result.json").trials
    assert first.status is Status.PASSED
    assert (second.status, second.reason) == (
        Status.FAILED, "safety limit current <= 2.5 A: 3 A at 0.005 s",
    )  # fmt: skip
    assert [item.limit for item in second.scores if item.limit] == ["<= 3 A"]
    assert json.loads((tmp_path / "scored/result.json").read_text())["status"] == "failed"
    for name in ("junit.xml", "summary.md", "report.html"):
        assert "3 A at 0.005 s" in (tmp_path / "scored" / name).read_text(), name
    failures = ElementTree.parse(tmp_path / "scored/junit.xml").getroot().findall(".//failure")
    assert [failure.get("message") for failure in failures] == [second.reason]
    assert "1 run beyond a safety limit" in (tmp_path / "scored/report.html").read_text().lower()


def test_a_log_beyond_a_limit_still_counts_in_repeats_and_comparisons(
    suite: Path, echo: Echo, tmp_path: Path
) -> None:
    limit = "accept: {tracking_max: {channel: current, max: 3 A, repeats: worst}}"
    text = suite.read_text().split("  - id: second")[0]
    text = text.split("    accept:")[0] + f"    repeats: 2\n    {limit}\n"
    suite.write_text(text)
    done = eha_bench.run(suite, echo(), tmp_path / "out")
    made = [tmp_path / "out" / item.recording for item in done.trials]
    suite.write_text(text + "    safety: {current: <= 1.5 A}\n")
    found = eha_bench.score_files(made, suite, out=tmp_path / "scored")
    assert [item.status for item in found.trials] == [Status.FAILED, Status.FAILED]
    assert [(item.metric, item.status) for item in found.failed] == [("", "failed")] * 2
    assert found.repeats
    assert all(run.usable for run in load_side(tmp_path / "scored").runs["first"])


def test_an_interrupted_run_beyond_a_limit_is_a_fault(
    suite: Path, echo: Echo, tmp_path: Path
) -> None:
    done = eha_bench.run(suite, echo(), tmp_path / "out")
    made = eha_bench.read(tmp_path / "out" / done.trials[0].recording)
    said = {"ending": "interrupted", "ending_reason": "by hand"}
    eha_bench.write(tmp_path / "first.mcap", replace(made, metadata={**made.metadata, **said}))
    suite.write_text(
        suite.read_text().replace("accept: {", "safety: {current: <= 1.5 A}\n    accept: {", 1)
    )
    found = eha_bench.score_files([tmp_path / "first.mcap"], suite, out=tmp_path / "scored")
    assert found.status is Status.FAULT
    assert found.trials[0].reason.startswith("safety limit current <= 1.5 A: 2 A")
