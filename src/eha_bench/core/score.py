"""A score: one metric of one channel, with its interval, limit and verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from eha_bench.core.budget import UNSAID, Budget


class ScoreStatus(StrEnum):
    """What the acceptance limit says of a score."""

    PASSED = "passed"
    FAILED = "failed"
    WARNED = "warned"
    UNDECIDED = "undecided"
    NOT_SCORED = "not_scored"

    @property
    def rejects(self) -> bool:
        """Whether a gate must not accept a limit with this status."""
        return self in (ScoreStatus.FAILED, ScoreStatus.UNDECIDED, ScoreStatus.NOT_SCORED)


@dataclass(frozen=True)
class Measure:
    """What a metric found: a value in SI with an interval, or NaN with the reason.

    Attributes:
        value: SI; NaN when it cannot be computed.
        low, high: bounds of the 95 % interval; NaN when unknown.
        reason: why there is no value, or the convention used.
        budget: what the interval is made of; empty where unknown.
    """

    value: float
    low: float = math.nan
    high: float = math.nan
    reason: str = ""
    budget: Budget = UNSAID

    @staticmethod
    def none(reason: str) -> Measure:
        """Return 'not scored' with its reason."""
        return Measure(math.nan, reason=reason)


@dataclass(frozen=True)
class Score:
    """A measure with its name and verdict, as it stands in result.json.

    Attributes:
        limit: as the suite wrote it (`<= 41 ms`), which people are shown; "" where there is none.
        limit_in_si: the same in SI (`<= 0.041 s`), which programs read.
        matters: the smallest difference that matters between two results, as the suite wrote it.
        judged_by: which value of all repeats the limit is applied to; "" for this one's own.
    """

    metric: str
    channel: str
    measure: Measure
    unit: str
    status: ScoreStatus
    limit: str = ""
    matters: str = ""
    limit_in_si: str = ""
    judged_by: str = ""

    @property
    def reason(self) -> str:
        """Why there is no value, or the convention used, and what the limit is applied to."""
        judged = f"judged by {self.judged_by}" if self.judged_by else ""
        return "; ".join(part for part in (self.measure.reason, judged) if part)

    @property
    def value(self) -> float:
        """The measured value, SI, NaN when not scored."""
        return self.measure.value
