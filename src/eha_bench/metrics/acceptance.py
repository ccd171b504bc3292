"""The verdict of an acceptance limit on a measure."""

from __future__ import annotations

import math
from collections.abc import Iterable

from eha_bench.core.limit import AcceptanceLimit
from eha_bench.core.score import Measure, Score, ScoreStatus


def judge(measure: Measure, limit: AcceptanceLimit | None) -> ScoreStatus:
    """Return what the limit says of the measure; without a limit, a value has nothing to fail."""
    if not math.isfinite(measure.value):
        return ScoreStatus.NOT_SCORED
    if limit is None:
        return ScoreStatus.PASSED
    if not limit.bounds.holds(measure.value):
        return ScoreStatus.FAILED
    if limit.warn is not None and not limit.warn.holds(measure.value):
        return ScoreStatus.WARNED
    return ScoreStatus.PASSED


def accepted(scores: Iterable[Score]) -> bool:
    """Whether a gate may accept these scores: every limit is kept, and none is undecided."""
    return not any(score.limit and score.status.rejects for score in scores)
