"""Verdicts with confidence, and verdicts over repeats."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.core.limit import AcceptanceLimit, Bounds, Repeats
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Measure, Score, ScoreStatus
from eha_bench.metrics import judge, judge_repeats

PASSED, FAILED, WARNED = ScoreStatus.PASSED, ScoreStatus.FAILED, ScoreStatus.WARNED
UNDECIDED, NOT_SCORED = ScoreStatus.UNDECIDED, ScoreStatus.NOT_SCORED


def limit(high=50.0, **options):
    return AcceptanceLimit(
        "rise_time", "x", Bounds(options.pop("low", -math.inf), high), "limit", "s", **options
    )


@pytest.mark.parametrize(
    ("low", "value", "high", "expected"),
    [
        (40, 45, 50, PASSED),
        (40, 45, 51, UNDECIDED),
        (48, 52, 56, UNDECIDED),
        (51, 52, 53, FAILED),
        (math.nan, 45, math.nan, UNDECIDED),
        (math.nan, 52, math.nan, FAILED),
        (math.nan, math.nan, math.nan, NOT_SCORED),
    ],
)
def test_with_confidence_the_interval_has_to_keep_the_limit(low, value, high, expected):
    assert judge(Measure(value, low, high), limit(confident=True)) is expected


def test_without_confidence_the_value_decides():
    assert judge(Measure(45, 40, 51), limit()) is PASSED
    assert judge(Measure(52, 40, 60), limit()) is FAILED


def test_a_confident_value_may_still_warn():
    assert judge(Measure(45, 44, 46), limit(confident=True, warn=Bounds(high=40))) is WARNED


@given(
    st.floats(-100, 100), st.floats(0, 50), st.floats(0, 50), st.floats(-50, 0), st.floats(0, 50)
)
def test_confidence_never_accepts_what_the_value_does_not(value, below, above, low, high):
    measure = Measure(value, value - below, value + above)
    plain = judge(measure, limit(high, low=low))
    sure = judge(measure, limit(high, low=low, confident=True))
    assert sure is not PASSED or plain is PASSED
    assert sure is not FAILED or plain is FAILED
    assert sure.rejects == (sure is not PASSED)


# --- repeats ---------------------------------------------------------------------------------


def repeats(values, kept, spread=1.0):
    return [
        (
            Score(
                "rise_time",
                "x",
                m := Measure(v, v - spread, v + spread, "10-90 %"),
                "s",
                judge(m, kept),
                kept.text,
            ),
            Score("overshoot", "x", Measure(0.1, reason="why"), "", PASSED),
        )
        for v in values
    ]


def statuses(judged):
    return [scores[0].status for scores in judged]


def test_by_default_every_repeat_stands_for_itself():
    kept = limit()
    scores = repeats([40, 60, 45], kept)
    assert judge_repeats(scores, (kept,)) == scores
    assert statuses(scores) == [PASSED, FAILED, PASSED]


def test_the_median_forgives_one_outlier_and_says_so():
    kept = limit(repeats=Repeats.MEDIAN)
    judged = judge_repeats(repeats([40, 60, 45], kept), (kept,))
    assert statuses(judged) == [PASSED] * 3
    assert [scores[0].value for scores in judged] == [40, 60, 45]
    assert "median of 3 repeats, 45" in judged[0][0].reason
    assert judged[0][1] == repeats([40], kept)[0][1]


def test_the_worst_counts_for_all():
    kept = limit(repeats=Repeats.WORST)
    judged = judge_repeats(repeats([40, 60, 45], kept), (kept,))
    assert statuses(judged) == [FAILED] * 3
    assert "worst of 3 repeats, 60" in judged[2][0].reason


def test_the_worst_is_the_one_nearest_to_either_side():
    kept = limit(50.0, low=10.0, repeats=Repeats.WORST)
    judged = judge_repeats(repeats([30, 12, 45], kept), (kept,))
    assert "repeats, 12" in judged[0][0].reason


def test_a_repeat_that_could_not_be_scored_is_not_left_out():
    kept = limit(repeats=Repeats.MEDIAN)
    judged = judge_repeats(repeats([40, math.nan, 45], kept), (kept,))
    assert statuses(judged) == [NOT_SCORED] * 3
    assert "1 of 3" in judged[0][0].reason


def test_repeats_that_scatter_leave_a_confident_median_undecided():
    kept = limit(repeats=Repeats.MEDIAN, confident=True)
    scattered = judge_repeats(repeats([30, 49, 44, 58, 47, 62, 41], kept), (kept,))
    assert statuses(scattered) == [UNDECIDED] * 7
    close = judge_repeats(repeats([44, 45, 46, 45, 44, 46, 45], kept), (kept,))
    assert statuses(close) == [PASSED] * 7


def test_judging_again_changes_nothing():
    kept = limit(repeats=Repeats.MEDIAN)
    once = judge_repeats(repeats([40, 60, 45], kept), (kept,))
    assert judge_repeats(once, (kept,)) == once


def test_a_single_repeat_keeps_its_own_verdict():
    kept = limit(repeats=Repeats.MEDIAN)
    scores = repeats([60], kept)
    assert judge_repeats(scores, (kept,)) == scores


def test_what_a_limit_is_applied_to_survives_a_file_and_a_second_judgement(tmp_path):
    kept = limit(repeats=Repeats.WORST)
    once = judge_repeats(repeats([40, 60, 45], kept), (kept,))
    assert once == judge_repeats(once, (kept,))
    run = TrialResult("step", 0, Status.PASSED, "", "", once[0])
    Result("s", "t", Status.PASSED, (run,), {}).write(tmp_path / "result.json")
    found = Result.read(tmp_path / "result.json").trials[0].scores[0]
    assert (found.judged_by, found.reason) == (once[0][0].judged_by, once[0][0].reason)
    assert found.measure.reason == once[0][0].measure.reason


# --- open ends -------------------------------------------------------------------------------


@given(st.floats(-100, 100), st.floats(-100, 100), st.booleans())
def test_at_least_so_much_never_passes_an_upper_limit(value, kept, confident):
    """What is known from below passes lower limits only; from above, upper ones only."""
    above = Measure(value, value - 1.0, math.inf)
    assert judge(above, limit(kept, confident=confident)) in (UNDECIDED, FAILED)
    assert judge(above, limit(math.inf, low=kept, confident=confident)) in (UNDECIDED, PASSED)
    below = Measure(value, -math.inf, value + 1.0)
    assert judge(below, limit(kept, confident=confident)) in (UNDECIDED, PASSED)
    assert judge(below, limit(math.inf, low=kept, confident=confident)) in (UNDECIDED, FAILED)


@pytest.mark.parametrize("confident", [True, False])
def test_an_open_end_decides_what_it_can(confident):
    above = Measure(45, 44, math.inf)
    options = {"confident": confident}
    assert judge(above, limit(40, **options)) is FAILED
    assert judge(above, limit(50, **options)) is UNDECIDED
    assert judge(above, limit(50, low=46, **options)) is UNDECIDED
    assert judge(above, limit(math.inf, low=40, **options)) is PASSED
    assert judge(above, limit(math.inf, low=50, **options)) is UNDECIDED
    assert judge(above, limit(math.inf, low=40, warn=Bounds(high=60), **options)) is WARNED
    unknown = Measure(45, math.nan, math.inf)
    assert judge(unknown, limit(50, **options)) is UNDECIDED
    assert judge(unknown, limit(40, **options)) is FAILED


def open_repeats(kept, *ends):
    return [
        (Score("rise_time", "x", m, "s", judge(m, kept), kept.text),)
        for m in (Measure(v, v - 1.0, high) for v, high in ends)
    ]


@pytest.mark.parametrize("over", [Repeats.WORST, Repeats.MEDIAN])
def test_one_repeat_that_is_open_leaves_the_others_undecided(over):
    kept = limit(repeats=over)
    judged = judge_repeats(open_repeats(kept, (45, 46), (30, math.inf), (44, 45)), [kept])
    assert statuses(judged) == [UNDECIDED] * 3
    assert "or more" in judged[0][0].judged_by


def test_an_open_end_survives_a_file(tmp_path):
    measures = [
        Measure(45.0, 44.0, math.inf, "cut off"),
        Measure(45.0, -math.inf, 46.0, "cut off"),
        Measure(45.0, math.nan, math.inf, "cut off"),
    ]
    scores = tuple(
        Score("peak", f"x{k}", m, "s", UNDECIDED, "<= 50") for k, m in enumerate(measures)
    )
    trial = TrialResult("t", 0, Status.FAILED, "", "", scores)
    path = tmp_path / "result.json"
    Result("s", "t", Status.FAILED, (trial,)).write(path)
    assert '"open": "above"' in path.read_text(encoding="utf-8")
    again = [score.measure for score in Result.read(path).trials[0].scores]
    assert [(m.low, m.high) for m in again[:2]] == [(44.0, math.inf), (-math.inf, 46.0)]
    assert math.isnan(again[2].low)
    assert again[2].high == math.inf
