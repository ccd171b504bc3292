"""What the repeats of a trial say together, as a table shows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from eha_bench.core.repeats_summary import RepeatsSummary
from eha_bench.core.result import TrialResult
from eha_bench.core.score import Score, ScoreStatus
from eha_bench.report.limits import ScoreRow, score_rows


@dataclass(frozen=True)
class RepeatsRow:
    """A metric over repeats: how many, and three figures like those of a single score."""

    repeats: int
    not_scored: int
    median: ScoreRow
    mean: ScoreRow
    worst: ScoreRow


def repeats_rows(run: TrialResult, summaries: Sequence[RepeatsSummary]) -> tuple[RepeatsRow, ...]:
    """Return the rows of the trial that a run belongs to, in the order of the result."""
    return tuple(_row(run, summary) for summary in summaries if summary.trial == run.id)


def _row(run: TrialResult, summary: RepeatsSummary) -> RepeatsRow:
    scores = tuple(
        Score(summary.metric, summary.channel, measure, summary.unit, ScoreStatus.PASSED)
        for measure in (summary.median, summary.mean, summary.worst)
    )
    shown = score_rows(replace(run, scores=scores), None)
    return RepeatsRow(summary.repeats, summary.not_scored, *shown)
