"""Which way a metric gets better: by the metric, or by the limit that it has."""

from __future__ import annotations

import math
from dataclasses import dataclass

from eha_bench.core.errors import EhaBenchError
from eha_bench.core.metric import Better, metric_spec
from eha_bench.suites.acceptance.grammar import parse_bounds, split_stated


@dataclass(frozen=True)
class Direction:
    """Which way is better, and where the best value lies if it lies in between.

    Attributes:
        better: as for a metric; UNKNOWN where not declared.
        aim: the value that distances are taken from; NaN where the value itself counts.
    """

    better: Better
    aim: float = math.nan

    @property
    def words(self) -> str:
        """For people, e.g. `lower` or `nearer to 0.011`; "" where unknown."""
        return f"nearer to {self.aim:g}" if math.isfinite(self.aim) else self.better.value


_AIMS = {Better.NEARER_ZERO: 0.0, Better.NEARER_ONE: 1.0}


def direction_of(metric: str, unit: str, limit: str) -> Direction:
    """Return which way a metric gets better; metrics that are not installed are judged by limit."""
    try:
        better = metric_spec(metric).better
    except EhaBenchError:
        better = Better.UNKNOWN
    if better is not Better.UNKNOWN:
        return Direction(better, _AIMS.get(better, math.nan))
    return _by_limit(limit, unit)


def _by_limit(limit: str, unit: str) -> Direction:
    try:
        words = split_stated(limit)
        aimed = not words.relative  # at a value of the baseline's, which is not known here
        bounds = parse_bounds(words.bounds, unit if aimed else "")
    except EhaBenchError:
        return Direction(Better.UNKNOWN)
    if math.isinf(bounds.low):
        return Direction(Better.LOWER)
    if math.isinf(bounds.high):
        return Direction(Better.HIGHER)
    middle = (bounds.low + bounds.high) / 2.0
    return Direction(Better.UNKNOWN, middle if aimed else math.nan)
