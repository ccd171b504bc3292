"""What a comparison of two results found: a versioned JSON file that reports and gates read."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from eha_bench.comparison.side import Side
from eha_bench.comparison.verdict import ComparisonVerdict
from eha_bench.core.atomic_file import write_text
from eha_bench.core.finite import finite_or_none
from eha_bench.core.lazy import later

SCHEMA_VERSION = 1

_html = later("eha_bench.report.notebook", "comparison_html")


@dataclass(frozen=True)
class Values:
    """A metric on one side: values of the scored repeats (SI) and why others have none."""

    values: tuple[float, ...]
    runs: int
    reasons: tuple[str, ...] = ()

    @property
    def mean(self) -> float:
        """Mean of the scored repeats; NaN if there are none."""
        return math.fsum(self.values) / len(self.values) if self.values else math.nan

    @property
    def missing(self) -> int:
        """How many runs were not scored."""
        return self.runs - len(self.values)


@dataclass(frozen=True)
class Compared:
    """One metric of one trial, candidate against baseline; SI.

    Attributes:
        trial, metric, channel, unit: what is compared.
        better: which value is the better one, in words; "" where unknown.
        baseline, candidate: the values of the two sides.
        difference, low, high: candidate minus baseline with its 95 % interval (not corrected),
            infinite where values were cut off by a sensor's end; of the distances from the aim
            where the metric has one.
        margin: smallest difference that matters; `margin_text` says where it comes from.
        p_difference, p_beyond, p_same: p-values of 'no difference', of 'differs by no more than
            the margin' and of 'differs by the margin or more', corrected for all metrics looked
            at (Holm).
        verdict: of the comparison.
        more_repeats: on each side, that would decide with 80 % probability; None if unknown.
        method: how it was tested.
        reason: why it is not compared or not decided, or what else there is to say.
    """

    trial: str
    metric: str
    channel: str
    unit: str
    better: str = ""
    baseline: Values = field(default_factory=lambda: Values((), 0))
    candidate: Values = field(default_factory=lambda: Values((), 0))
    difference: float = math.nan
    low: float = math.nan
    high: float = math.nan
    margin: float = math.nan
    margin_text: str = ""
    p_difference: float = math.nan
    p_beyond: float = math.nan
    p_same: float = math.nan
    verdict: ComparisonVerdict = ComparisonVerdict.NOT_COMPARED
    more_repeats: int | None = None
    method: str = ""
    reason: str = ""

    @property
    def of_one_run(self) -> bool:
        """Whether each side has one value, so that the scatter of runs is not known."""
        return len(self.baseline.values) == len(self.candidate.values) == 1

    @property
    def cut_off(self) -> bool:
        """Whether values were cut off by a sensor's end, so that the interval is open."""
        return math.isinf(self.low) or math.isinf(self.high)

    @property
    def share(self) -> float:
        """The difference as a share of the baseline's magnitude; NaN about 0."""
        mean = abs(self.baseline.mean)
        return self.difference / mean if mean > 0.0 else math.nan


@dataclass(frozen=True)
class Comparison:
    """All metrics of two results, and what must be known before they are believed.

    Attributes:
        baseline, candidate: the two sides.
        items: every metric of every trial of either side.
        caveats: what differs besides what was to be compared, a sentence each.
        alpha: family-wise error rate.
        paired: whether repeats of the same number were run next to each other.
    """

    baseline: Side
    candidate: Side
    items: tuple[Compared, ...]
    caveats: tuple[str, ...] = ()
    alpha: float = 0.05
    paired: bool = False
    stopped: str = ""

    def counts(self) -> dict[ComparisonVerdict, int]:
        """How many items have each verdict."""
        found = Counter(item.verdict for item in self.items)
        return {verdict: found[verdict] for verdict in ComparisonVerdict}

    def of(self, *verdicts: ComparisonVerdict) -> tuple[Compared, ...]:
        """Return the items with these verdicts."""
        return tuple(item for item in self.items if item.verdict in verdicts)

    @property
    def metric_count(self) -> int:
        """How many metrics were looked at."""
        return len(self.items) - len(self.of(ComparisonVerdict.NOT_COMPARED))

    @property
    def status(self) -> str:
        """`regression`, `no_regression`, or `nothing_compared`."""
        if self.of(ComparisonVerdict.WORSE):
            return "regression"
        return "no_regression" if self.metric_count else "nothing_compared"

    @property
    def exit_status(self) -> int:
        """0 no regression, 1 a regression, 2 there is nothing that can be compared."""
        return {"regression": 1, "no_regression": 0, "nothing_compared": 2}[self.status]

    def __repr__(self) -> str:
        """What it is in one line: the sides, the verdict, how many metrics are what."""
        counts = ", ".join(f"{n} {verdict.value}" for verdict, n in self.counts().items() if n)
        status = self.status.replace("_", " ")
        return f"<Comparison: {status}; {counts or 'nothing compared'}>"

    def _repr_html_(self) -> str:
        """What a notebook shows: a line a metric that is not the same."""
        return str(_html(self))

    def to_json(self) -> str:
        """Return the comparison as JSON; NaN becomes null."""
        content = {
            "schema_version": SCHEMA_VERSION,
            "status": self.status,
            "stopped": self.stopped,
            "counts": {verdict.value: count for verdict, count in self.counts().items()},
            "alpha": self.alpha,
            "paired": self.paired,
            "caveats": list(self.caveats),
            "baseline": _side(self.baseline),
            "candidate": _side(self.candidate),
            "metrics": [_item(item) for item in self.items],
        }
        return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"

    def write(self, path: Path) -> None:
        """Write the JSON whole or not at all."""
        write_text(path, self.to_json())


def _side(side: Side) -> dict[str, Any]:
    provenance: dict[str, list[str]] = {}
    for result, _ in side.results:
        for key, value in result.provenance.items():
            if value and value not in provenance.setdefault(key, []):
                provenance[key].append(value)
    return {
        "path": side.name,
        "suite": sorted(side.suites),
        "target": sorted(side.targets),
        "results": len(side.results),
        "provenance": {
            key: values[0] if len(values) == 1 else values for key, values in provenance.items()
        },
    }


def _item(item: Compared) -> dict[str, Any]:
    return {
        "trial": item.trial,
        "metric": item.metric,
        "channel": item.channel,
        "unit": item.unit,
        "better": item.better,
        "verdict": item.verdict.value,
        "baseline": _values(item.baseline),
        "candidate": _values(item.candidate),
        "difference": finite_or_none(item.difference),
        "low": finite_or_none(item.low),
        "high": finite_or_none(item.high),
        "share": finite_or_none(item.share),
        "matters": finite_or_none(item.margin),
        "matters_text": item.margin_text,
        "p_difference": finite_or_none(item.p_difference),
        "p_beyond": finite_or_none(item.p_beyond),
        "p_same": finite_or_none(item.p_same),
        "more_repeats": item.more_repeats,
        "method": item.method,
        "reason": item.reason,
    }


def _values(values: Values) -> Mapping[str, Any]:
    return {
        "value": finite_or_none(values.mean),
        "values": list(values.values),
        "runs": values.runs,
        "not_scored": values.missing,
        "reasons": list(values.reasons),
    }
