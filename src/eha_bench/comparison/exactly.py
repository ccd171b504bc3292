"""Trials whose difference is known without a test: the same values, or repeats without scatter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from eha_bench.comparison.side import SideRun

IDENTICAL: Final = "identical: every value of the trial is the same on both sides"
DETERMINISTIC: Final = "deterministic repeats: no value of the trial scatters on either side"

_Values = tuple[tuple[str, str, float, str], ...]


def exactness_reason(baseline: Sequence[SideRun], candidate: Sequence[SideRun]) -> str:
    """Return why the difference between two sides of a trial is known exactly; "" if it is not.

    Args:
        baseline, candidate: all usable runs of one trial.
    """
    first, second = ([_values(run) for run in side] for side in (baseline, candidate))
    if not any(first) or not any(second):
        return ""
    if sorted(first) == sorted(second):
        return IDENTICAL
    repeated = len(first) > 1 and len(second) > 1
    if repeated and len(set(first)) == 1 and len(set(second)) == 1:
        return DETERMINISTIC
    return ""


def _values(run: SideRun) -> _Values:
    return tuple(sorted(
        (score.metric, score.channel, score.value, score.measure.open)
        for score in run.trial.scores
        if math.isfinite(score.value)
    ))  # fmt: skip
