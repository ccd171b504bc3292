"""The budget of a score in result.json: written, read again, and absent from older files."""

import json
import math

from eha_bench.core.budget import Budget, Contribution, Evaluation
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Measure, Score, ScoreStatus

BUDGET = Budget(
    (
        Contribution("resolution", Evaluation.B, 2e-4, rectangular=True),
        Contribution("noise", Evaluation.A, 1e-4, 21.5),
        Contribution("noise", Evaluation.A, math.nan, 0.0),
    )
)


def result(budget):
    score = Score("rise_time", "force", Measure(1.0, 0.9, 1.1, "", budget), "s", ScoreStatus.PASSED)
    trial = TrialResult("a", 0, Status.PASSED, "a.mcap", "", (score,))
    return Result("suite", "target", Status.PASSED, (trial,))


def budget_of(path):
    return Result.read(path).trials[0].scores[0].measure.budget


def test_a_budget_is_read_as_it_was_written(tmp_path):
    result(BUDGET).write(tmp_path / "result.json")
    parts = budget_of(tmp_path / "result.json").parts
    assert parts[:2] == BUDGET.parts[:2]
    assert math.isnan(parts[2].standard)
    content = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert content["trials"][0]["scores"][0]["budget"][0] == {
        "source": "resolution",
        "type": "B",
        "standard": 2e-4,
        "freedom": None,
        "distribution": "rectangular",
    }


def test_a_result_from_before_has_none(tmp_path):
    content = json.loads(result(BUDGET).to_json())
    del content["trials"][0]["scores"][0]["budget"]
    (tmp_path / "result.json").write_text(json.dumps(content), encoding="utf-8")
    assert budget_of(tmp_path / "result.json") == Budget()
