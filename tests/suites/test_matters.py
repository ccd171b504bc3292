"""The key `matters`: the smallest difference that matters, from the suite to the scores."""

from pathlib import Path

import pytest

from eha_bench.core.errors import InputError
from eha_bench.suites import load_suite, trial_from_source

SUITE = """\
name: tiny
defaults:
  matters: {rise_time: 5 %}
trials:
  - id: step
    mode: pressure
    duration: 0.1 s
    signal: {kind: step, final: 8 MPa, at: 10 ms}
    matters: {overshoot: 2 %, steady_state_error: 0.1 MPa}
"""


def test_margins_are_merged_with_the_defaults_and_carried_by_the_trial(tmp_path: Path) -> None:
    path = tmp_path / "tiny.yaml"
    path.write_text(SUITE, encoding="utf-8")
    trial = load_suite(path).trials[0]
    margins = {name: (m.absolute, m.share) for name, m in trial.margins.items()}
    assert margins == {
        "rise_time": (0.0, 0.05),
        "overshoot": (0.02, 0.0),
        "steady_state_error": (1e5, 0.0),
    }
    assert trial_from_source(trial.source).margins == trial.margins


@pytest.mark.parametrize(
    ("written", "said"),
    [("rise_tim: 5 %", "unknown metric"), ("rise_time: 5 MPa", "dimension"), ("rise_time: x", "x")],
)
def test_a_wrong_margin_is_told_with_its_line(tmp_path: Path, written: str, said: str) -> None:
    path = tmp_path / "tiny.yaml"
    path.write_text(SUITE.replace("overshoot: 2 %", written), encoding="utf-8")
    with pytest.raises(InputError, match=said) as error:
        load_suite(path)
    assert error.value.where.line == 9
