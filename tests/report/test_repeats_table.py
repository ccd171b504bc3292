"""The table of what a trial's repeats say together."""

from eha_bench.core.repeats_summary import RepeatsSummary
from eha_bench.core.result import Status, TrialResult
from eha_bench.core.score import Measure
from eha_bench.report.repeats_table import repeats_rows


def test_figures_are_shown_like_scores_and_only_of_the_trial():
    found = RepeatsSummary(
        trial="step",
        metric="rise_time",
        channel="pressure_difference",
        unit="s",
        repeats=3,
        not_scored=1,
        mean=Measure(0.0255, 0.0254, 0.0256),
        median=Measure(0.0254, 0.0253, 0.0255),
        worst=Measure(0.0260, 0.0258, 0.0262),
    )
    run = TrialResult("step", 0, Status.PASSED, "", "")
    (row,) = repeats_rows(run, (found,))
    assert (row.repeats, row.not_scored) == (3, 1)
    assert (row.worst.value, row.worst.unit, row.worst.interval) == ("26.00", "ms", "± 0.20")
    assert row.median.value.startswith("25.4")
    assert repeats_rows(TrialResult("other", 0, Status.PASSED, "", ""), (found,)) == ()
