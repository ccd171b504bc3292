"""A recording carries its trial as JSON: enough to score it again, and nothing that runs."""

import json
from pathlib import Path

import numpy as np
import pytest
from writing import only

from eha_bench.core.errors import EhaBenchError
from eha_bench.core.trial import Trial
from eha_bench.suites import load_suite, trial_from_source

FULL = """
trials:
  - id: one
    description: what it is
    mode: pressure
    duration: 0.5 s
    settle: 0.1 s
    sample_rate: 2 kHz
    repeats: 3
    seed: 9
    setup: {piston: locked, bypass: open, initial: {piston_position: 3 mm}}
    signal: {kind: chirp, amplitude: 1 MPa, f_start: 1, f_stop: 9, duration: 2 s}
    accept:
      tracking_max: [{max: 2 MPa, warn: <= 1.5 MPa}, {channel: pressure_a, min: -1}]
      tracking_nrmse: +- 5 %
    scores: [rise_time]
    safety: {motor_speed: <= 3000 rpm}
"""


@pytest.fixture
def trial(tmp_path: Path) -> Trial:
    return only(tmp_path, FULL)


def test_trial_comes_back_whole(trial: Trial) -> None:
    again = trial_from_source(trial.source)
    assert again == trial
    assert again.source == trial.source
    np.testing.assert_array_equal(again.reference(trial.clock()), trial.reference(trial.clock()))


def test_every_shipped_trial_comes_back_whole(repository: Path) -> None:
    for path in (repository / "suites").glob("*.yaml"):
        for trial in load_suite(path).trials:
            assert trial_from_source(trial.source) == trial


@pytest.mark.parametrize(
    ("path", "value", "what"),
    [
        (["version"], 2, "a trial of version 2, not 1"),
        (["signal", "kind"], "os:system", "unknown signal 'os:system'"),
        (["signal", "f_stop"], None, "signal.f_stop"),
        (["signal", "extra"], 1, "unknown key 'extra'"),
        (["mode"], "a thought", "mode"),
        (["duration"], -1, "duration"),
        (["id"], "../../x", "cannot be a file name"),
        (["limits", 0, "bounds", "high"], "x", "limits.0.bounds.high"),
    ],
)
def test_changed_source_is_refused(
    trial: Trial, path: list[str | int], value: object, what: str
) -> None:
    content = json.loads(trial.source)
    inner = content
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    with pytest.raises(EhaBenchError) as caught:
        trial_from_source(json.dumps(content), "log.mcap")
    assert what in str(caught.value)
    assert caught.value.where.file == "log.mcap"
    assert caught.value.exit_status == 2


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "null", "NaN", '{"version": 1}', "[" * 9999])
def test_what_is_no_trial_is_refused(text: str) -> None:
    with pytest.raises(EhaBenchError):
        trial_from_source(text, "log.mcap")


def test_trajectory_without_samples_reads_no_file(trial: Trial, tmp_path: Path) -> None:
    (tmp_path / "walk.csv").write_text("t,p\n0,1\n1,2\n")
    content = json.loads(trial.source)
    content["signal"] = {
        "kind": "trajectory",
        "file": str(tmp_path / "walk.csv"),
        "time": {"column": "t", "unit": "s"},
        "value": {"column": "p", "unit": "Pa"},
    }
    with pytest.raises(EhaBenchError, match="cannot be read here"):
        trial_from_source(json.dumps(content))
