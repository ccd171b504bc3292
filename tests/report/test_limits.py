"""Tables of limits: worst first, margins in display units, repeats folded."""

from dataclasses import replace

from sample_run import SampleRun

from eha_bench.core.limit import Repeats
from eha_bench.core.repeats_summary import RepeatsSummary
from eha_bench.core.score import Measure, ScoreStatus
from eha_bench.metrics.coverage import between, type_a, type_b
from eha_bench.report.limits import limit_rows, score_rows, worst_first


def row_of(sample: SampleRun, trial: str, metric: str):
    rows = limit_rows(sample.result, sample.trials)
    return next(row for row in rows if row.trial == trial and row.metric_id == metric)


def test_margin_says_by_how_much_and_which_way(sample: SampleRun) -> None:
    # 48.16 ms where 43 ms * 1.06 = 45.58 ms is allowed: 2.58 ms, 5.7 % of 45.58 ms
    row = row_of(sample, "pressure_step-20MPa", "response_time")
    assert row.margin.replace("\u00a0", " ") == "2.58 ms (5.7 %) over"
    assert (row.value, row.unit, row.interval) == ("48.16", "ms", "± 0.23")
    assert row.status is ScoreStatus.FAILED


def test_margin_left_where_kept(sample: SampleRun) -> None:
    row = row_of(sample, "pressure_step-15MPa", "overshoot")
    assert row.margin.replace("\u00a0", " ") == "3.70 points left"


def test_repeats_are_one_row_the_worst(sample: SampleRun) -> None:
    rows = limit_rows(sample.result, sample.trials)
    row = row_of(sample, "pressure_step-20MPa", "response_time")
    assert row.stands_for == "worst of 3 repeats"
    assert sum(r.trial == "pressure_step-20MPa" for r in rows) == 3


def test_the_worst_repeat_is_shown(sample: SampleRun) -> None:
    runs = list(sample.result.trials)
    place = next(i for i, r in enumerate(runs) if r.id == "pressure_step-20MPa" and r.repeat == 2)
    worse = runs[place].scores[0]
    worse = replace(worse, measure=replace(worse.measure, value=0.06))
    runs[place] = replace(runs[place], scores=(worse, *runs[place].scores[1:]))
    result = replace(sample.result, trials=tuple(runs))
    row = next(
        r
        for r in limit_rows(result, sample.trials)
        if r.trial == "pressure_step-20MPa" and r.metric_id == "response_time"
    )
    assert (row.repeat, row.value) == (2, "60.00")


def test_a_limit_on_the_median_shows_the_median(sample: SampleRun) -> None:
    trial = sample.trials["pressure_step-20MPa"]
    limits = tuple(replace(limit, repeats=Repeats.MEDIAN) for limit in trial.limits)
    trials = dict(sample.trials) | {trial.id: replace(trial, limits=limits)}
    median, worst = Measure(0.0412, 0.0410, 0.0414), Measure(0.0482, 0.048, 0.0484)
    summary = RepeatsSummary(
        trial.id, "response_time", "pressure_difference", "s", 3, 0, worst, median, worst
    )
    result = replace(sample.result, repeats=(summary,))
    row = next(
        r
        for r in limit_rows(result, trials)
        if (r.trial, r.metric_id) == (trial.id, "response_time")
    )
    assert (row.stands_for, row.value, row.interval) == ("median of 3 repeats", "41.20", "± 0.20")


def test_worst_first_orders_by_verdict_then_excess(sample: SampleRun) -> None:
    missed = worst_first(limit_rows(sample.result, sample.trials))
    assert [row.status for row in missed] == [
        ScoreStatus.FAILED,
        ScoreStatus.FAILED,
        ScoreStatus.UNDECIDED,
        ScoreStatus.NOT_SCORED,
        ScoreStatus.NOT_SCORED,
    ]
    assert missed[0].severity > missed[1].severity > 0
    assert not [row for row in missed if row.status is ScoreStatus.PASSED]


def test_gauge_shows_the_needle_outside_where_missed(sample: SampleRun) -> None:
    gauge = row_of(sample, "pressure_step-20MPa", "response_time").gauge
    assert gauge is not None
    assert 0 <= gauge.low < gauge.high < gauge.value <= 100
    inside = row_of(sample, "pressure_step-15MPa", "response_time").gauge
    assert inside is not None
    assert inside.low < inside.value < inside.high


def test_without_the_trial_there_is_no_margin_but_a_row(sample: SampleRun) -> None:
    rows = score_rows(sample.result.trials[0], None)
    assert rows[0].value == "39.39"
    assert rows[0].margin == ""
    assert rows[0].gauge is None


def test_what_an_interval_is_made_of(sample: SampleRun) -> None:
    run = next(run for run in sample.result.trials if run.id == "pressure_step-15MPa")
    budget = type_a("noise", 3.1e-4**2, 20.0) + between("resolution", 1e-4) + type_b("sensor", 1e-9)
    scores = tuple(
        replace(score, measure=replace(score.measure, budget=budget)) for score in run.scores
    )
    rows = score_rows(replace(run, scores=scores), sample.trials[run.id])
    row = next(row for row in rows if row.metric_id == "response_time")
    assert row.budget.replace("\u00a0", " ") == "noise 0.31 ms (A), resolution 0.058 ms (B)"
