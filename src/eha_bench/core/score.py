"""A score: one metric of one channel, with its interval, limit and verdict."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from eha_bench.core.budget import UNSAID, Budget
from eha_bench.core.finite import finite_or_none


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
        low, high: bounds of the 95 % interval; NaN when unknown, infinite at an end that is open:
            of a clipped peak it is known only how high it was at least.
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

    @property
    def open(self) -> str:
        """The side on which the interval has no end: `above`, `below`, `both`; "" for neither."""
        return _OPEN[self.low == -math.inf, self.high == math.inf]

    @property
    def span(self) -> tuple[float, float]:
        """What the value stands for apart from noise: itself, and all beyond an open end."""
        return (
            self.low if self.low == -math.inf else self.value,
            self.high if self.high == math.inf else self.value,
        )

    def censored_like(self, measures: Iterable[Measure]) -> Measure:
        """Return what several say together, open to every side that one of them is open to."""
        sides = [own.span for own in measures]
        low = -math.inf if any(low == -math.inf for low, _ in sides) else self.low
        high = math.inf if any(high == math.inf for _, high in sides) else self.high
        return replace(self, low=low, high=high)

    def to_dict(self) -> dict[str, Any]:
        """Return value and interval as they stand in result.json; JSON has no infinity."""
        ends = {
            "value": finite_or_none(self.value),
            "low": finite_or_none(self.low),
            "high": finite_or_none(self.high),
        }
        return ends | ({"open": self.open} if self.open else {})

    @staticmethod
    def ends_of(data: Mapping[str, Any]) -> tuple[float, float]:
        """Return the interval that `to_dict` wrote; raises ValueError for what is no number."""
        side = data.get("open") or ""
        if side not in _OPEN.values():
            raise ValueError(f"open: '{side}' is none of above, below and both")
        low = -math.inf if side in ("below", "both") else number_of(data.get("low"))
        return low, math.inf if side in ("above", "both") else number_of(data.get("high"))


_OPEN = {
    (False, False): "", (False, True): "above", (True, False): "below", (True, True): "both",
}  # fmt: skip


def number_of(value: object) -> float:
    """Return a number of JSON, NaN for null; raises ValueError for anything else."""
    try:
        return math.nan if value is None else float(value)  # type: ignore[arg-type]  # else it raises
    except (TypeError, ValueError) as error:
        raise ValueError(f"{value!r} is not a number") from error


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
        own = self.measure.reason
        if not self.judged_by:
            return own
        judged = f"judged by {self.judged_by}"
        return f"{own}; {judged}" if own else judged

    @property
    def value(self) -> float:
        """The measured value, SI, NaN when not scored."""
        return self.measure.value
