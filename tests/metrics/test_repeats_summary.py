"""Mean, median and worst over the repeats of a trial, in result.json and back."""

import json
import math

import pytest
from scipy.stats import t

from eha_bench.core.formula import Formula
from eha_bench.core.metric import Better
from eha_bench.core.own_metric import OwnMetric
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Measure, Score, ScoreStatus
from eha_bench.core.trial import ControlMode, Setup, Trial
from eha_bench.metrics.repeats_summary import summaries, worst
from eha_bench.suites.signals.constant import Constant

VALUES = (1.0, 2.0, 6.0)
OWN = OwnMetric("lift", Formula.parse("rise_time + settling_time"), "s")
SIGNAL = Constant(kind="constant", value=1.0)
TRIAL = Trial("x", SIGNAL, ControlMode.CURRENT, Setup(), 1.0, own_metrics=(OWN,))


def scores(value: float) -> tuple[Score, ...]:
    measure = Measure(value, value - 0.1, value + 0.1)
    return (
        Score("rise_time", "current", measure, "s", ScoreStatus.PASSED, limit="<= 7 s"),
        Score("rise_time", "current", measure, "s", ScoreStatus.WARNED, limit="<= 5 s"),
    )


def test_a_metric_with_two_limits_is_one_value_a_repeat():
    (found,) = summaries(TRIAL, [scores(value) for value in VALUES])
    assert (found.metric, found.channel, found.unit) == ("rise_time", "current", "s")
    assert (found.repeats, found.not_scored) == (3, 0)
    assert found.median.value == 2.0
    assert found.median.low < min(VALUES)
    assert found.median.high > max(VALUES)
    assert found.mean.value == pytest.approx(3.0)
    # Student's, by hand: the standard deviation of 1, 2, 6 is sqrt(7)
    reach = t.ppf(0.975, 2) * math.sqrt(7.0 / 3.0)
    assert found.mean.high - found.mean.value == pytest.approx(reach)
    assert found.worst == Measure(6.0, 5.9, 6.1)  # the longest rise


def test_a_repeat_without_a_value_is_counted_and_one_alone_is_no_summary():
    runs = [scores(1.0), scores(math.nan), scores(3.0)]
    (found,) = summaries(TRIAL, runs)
    assert (found.repeats, found.not_scored) == (2, 1)
    assert summaries(TRIAL, runs[:2]) == ()


def test_a_metric_of_the_suite_has_a_summary():
    """A formula is no better where it is lower: its worst is the farthest from the median."""
    measured = [Measure(value) for value in VALUES]
    repeats = [(Score("lift", "", one, "s", ScoreStatus.PASSED),) for one in measured]
    (found,) = summaries(TRIAL, repeats)
    assert (found.metric, found.unit, found.worst.value) == ("lift", "s", 6.0)


def test_a_metric_that_is_gone_costs_no_summary():
    """A resumed run has scores of plug-ins that are no longer installed."""
    repeats = [(Score("gone", "", Measure(v), "s", ScoreStatus.PASSED),) for v in VALUES]
    assert [found.metric for found in summaries(TRIAL, repeats)] == ["gone"]


def test_repeats_that_are_the_same_keep_their_own_interval():
    (found,) = summaries(TRIAL, [scores(2.0)] * 3)
    assert found.mean == found.median == found.worst == Measure(2.0, 1.9, 2.1)


@pytest.mark.parametrize(
    ("better", "expected"),
    [
        (Better.LOWER, 5.0),
        (Better.HIGHER, -6.0),
        (Better.NEARER_ZERO, -6.0),
        (Better.NEARER_ONE, -6.0),
        (Better.UNKNOWN, -6.0),
    ],
)
def test_the_worst_by_what_is_better(better, expected):
    measures = [Measure(value) for value in (5.0, 0.9, -6.0)]
    assert worst(measures, better).value == expected


def test_result_json_holds_it(tmp_path):
    found = summaries(TRIAL, [scores(value) for value in VALUES])
    run = TrialResult("x", 0, Status.PASSED, "", "", scores(1.0))
    path = tmp_path / "result.json"
    Result("suite", "target", Status.PASSED, (run,), repeats=found).write(path)
    (entry,) = json.loads(path.read_text())["repeats"]
    assert entry["trial"] == "x"
    assert entry["worst"] == {"value": 6.0, "low": 5.9, "high": 6.1}
    assert Result.read(path).repeats == found


def test_a_result_of_an_earlier_version_has_none(tmp_path):
    path = tmp_path / "result.json"
    Result("suite", "target", Status.PASSED, ()).write(path)
    data = json.loads(path.read_text())
    del data["repeats"]
    path.write_text(json.dumps(data))
    assert Result.read(path).repeats == ()
