"""The verdict of an acceptance limit: on a measure, and on the measures of all repeats."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

from eha_bench.core.limit import AcceptanceLimit, Bounds, Repeats
from eha_bench.core.score import Measure, Score, ScoreStatus
from eha_bench.metrics.repeats import median

_MORE = {"above": "more", "below": "less", "both": "anything else"}


def judge(measure: Measure, limit: AcceptanceLimit | None) -> ScoreStatus:
    """Return what the limit says of the measure; without a limit, a value has nothing to fail.

    A limit that asks for confidence is kept where the whole 95 % interval keeps it, failed where
    the whole interval lies outside, and undecided in between or where there is no interval. Every
    limit is undecided where an interval reaches across it with its open end: what is at least 40 %
    may be more than 50 %.
    """
    if not math.isfinite(measure.value):
        return ScoreStatus.NOT_SCORED
    if limit is None:
        return ScoreStatus.PASSED
    status = _limit_status(measure.span, limit.bounds)
    if limit.confident:
        status = _confident(measure, limit.bounds)
    if status is not ScoreStatus.PASSED:
        return status
    if limit.warn is not None and _limit_status(measure.span, limit.warn) is not ScoreStatus.PASSED:
        return ScoreStatus.WARNED
    return ScoreStatus.PASSED


def _confident(measure: Measure, bounds: Bounds) -> ScoreStatus:
    if math.isnan(measure.low) or math.isnan(measure.high):
        # no interval: only what is outside of the bounds already is certain
        failed = _limit_status(measure.span, bounds) is ScoreStatus.FAILED
        return ScoreStatus.FAILED if failed else ScoreStatus.UNDECIDED
    return _limit_status((measure.low, measure.high), bounds)


def _limit_status(span: tuple[float, float], bounds: Bounds) -> ScoreStatus:
    """Return whether bounds hold all of a span, none of it, or some."""
    low, high = span
    if bounds.holds(low) and bounds.holds(high):
        return ScoreStatus.PASSED
    outside = high < bounds.low or low > bounds.high
    return ScoreStatus.FAILED if outside else ScoreStatus.UNDECIDED


def accepted(scores: Iterable[Score]) -> bool:
    """Whether a gate may accept these scores: every limit is kept, and none is undecided."""
    return not any(score.limit and score.status.rejects for score in scores)


def judge_repeats(
    repeats: Sequence[tuple[Score, ...]], limits: Sequence[AcceptanceLimit]
) -> list[tuple[Score, ...]]:
    """Return the scores of all repeats of a trial, limits on the worst or the median applied.

    Such a limit has one verdict: every repeat's score carries it, with the value it comes from.
    The values and intervals of the repeats stay their own.
    """
    found = [list(scores) for scores in repeats]
    for limit in limits:
        if limit.repeats is Repeats.ALL:
            continue
        places = [
            (run, index)
            for run, scores in enumerate(found)
            for index, score in enumerate(scores)
            if (score.metric, score.channel) == (limit.metric, limit.channel) and score.limit
        ]
        if len(places) < 2:
            continue
        common = combined_measure([found[run][index].measure for run, index in places], limit)
        status = judge(common, limit)
        for run, index in places:
            score = found[run][index]
            found[run][index] = replace(score, judged_by=common.reason, status=status)
    return [tuple(scores) for scores in found]


def combined_measure(measures: Sequence[Measure], limit: AcceptanceLimit) -> Measure:
    """Return the worst or the median of the repeats; NaN if one of them could not be scored."""
    missing = sum(not math.isfinite(measure.value) for measure in measures)
    if missing:
        return Measure.none(f"all: {missing} of {len(measures)} repeats not scored")
    if limit.repeats is Repeats.WORST:
        worst = min(measures, key=lambda measure: _margin(measure, limit))
        return replace(worst, reason=_combined_reason("worst", worst, len(measures)))
    found = median(measures)
    return replace(found, reason=_combined_reason("median", found, len(measures)))


def _margin(measure: Measure, limit: AcceptanceLimit) -> float:
    """Return how far inside of the bounds the measure is (negative outside)."""
    bounds = limit.bounds
    low, high = measure.span
    if limit.confident:
        low, high = (
            measure.value if math.isnan(end) else end for end in (measure.low, measure.high)
        )
    sides = [low - bounds.low] if math.isfinite(bounds.low) else []
    sides += [bounds.high - high] if math.isfinite(bounds.high) else []
    return min(sides)


def _combined_reason(which: str, measure: Measure, count: int) -> str:
    interval = ""
    if measure.open:
        interval = f" or {_MORE[measure.open]}"
    elif math.isfinite(measure.low) and math.isfinite(measure.high):
        interval = f" [{measure.low:.4g}, {measure.high:.4g}]"
    return f"the {which} of {count} repeats, {measure.value:.4g}{interval}"
