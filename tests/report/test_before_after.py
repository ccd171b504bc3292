"""The limits of a machine's own result beside what the tuning said of each."""

from pathlib import Path

from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Measure, Score, ScoreStatus
from eha_bench.report.before_after_page import BeforeAfter, _limit_rows

LIMIT = "<= 1 deg"


def score(metric: str, value: float) -> Score:
    return Score(metric, "joint_angle", Measure(value), "rad", ScoreStatus.PASSED, limit=LIMIT)


def stated(key: str, chance: float) -> dict[str, object]:
    return {"key": key, "limit": LIMIT, "p_pass": {"value": chance, "low": 0.0, "high": 1.0}}


def test_each_limit_has_the_probability_of_its_own_metric() -> None:
    """Also where one metric's name begins with another's, and both have the same limit."""
    run = TrialResult(
        "knee", 0, Status.PASSED, "", "",
        (score("tracking_rms", 0.01), score("tracking_rms_moving", 0.02)),
    )  # fmt: skip
    content = BeforeAfter(
        {},
        {
            "limits": [
                stated("knee.tracking_rms_moving", 0.3),
                stated("knee.tracking_rms.joint_angle", 0.9),
                stated("knee.tracking_rms", 0.9),
            ]
        },
        None,
        Result("tiny", "rig", Status.PASSED, (run,), {}),
        (),
        Path(),
        Path(),
        (),
    )
    assert [row.stated[:5] for row in _limit_rows(content)] == ["0.900", "0.300"]
