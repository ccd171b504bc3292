"""What the repeats of a trial say of a metric together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from eha_bench.core.score import Measure, number_of

_STATISTICS = ("mean", "median", "worst")


@dataclass(frozen=True)
class RepeatsSummary:
    """A metric of a channel over the repeats of a trial that could be scored.

    Attributes:
        trial, metric, channel, unit: as in the scores.
        repeats: how many were scored, at least two.
        not_scored: how many were not; they are in none of the figures.
        mean, median: of the values, with 95 % intervals of what further repeats would settle at.
        worst: the value of the worst repeat, with its own interval.
    """

    trial: str
    metric: str
    channel: str
    unit: str
    repeats: int
    not_scored: int
    mean: Measure
    median: Measure
    worst: Measure

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in result.json; NaN becomes null."""
        found: dict[str, Any] = {
            "trial": self.trial,
            "metric": self.metric,
            "channel": self.channel,
            "unit": self.unit,
            "repeats": self.repeats,
            "not_scored": self.not_scored,
        }
        for name in _STATISTICS:
            measure: Measure = getattr(self, name)
            found[name] = measure.to_dict()
        return found

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> RepeatsSummary:
        """Read what `to_dict` wrote; raises KeyError, TypeError or ValueError for anything else."""
        measures = {}
        for name in _STATISTICS:
            measures[name] = Measure(number_of(data[name]["value"]), *Measure.ends_of(data[name]))
        return RepeatsSummary(
            trial=str(data["trial"]),
            metric=str(data["metric"]),
            channel=str(data["channel"]),
            unit=str(data["unit"]),
            repeats=int(data["repeats"]),
            not_scored=int(data["not_scored"]),
            **measures,
        )
