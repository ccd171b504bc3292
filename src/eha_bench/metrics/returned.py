"""What a metric's `measure` returned, as a measure of numbers: a plug-in may return anything."""

from __future__ import annotations

from typing import Any

from eha_bench.core.budget import Budget
from eha_bench.core.error_text import place_of, shown
from eha_bench.core.score import Measure
from eha_bench.metrics.metric import Metric, NotScored


def as_measure(returned: object, found: Metric) -> Measure:
    """Return what a metric returned, its numbers as Python's own.

    Args:
        returned: what it gave. found: the metric, for the message.

    Raises:
        NotScored: it is no measure, or holds what is no number.
    """
    if not isinstance(returned, Measure):
        raise NotScored(_said(found, f"{shown(returned)}, which is no Measure"))
    reason: Any = returned.reason
    budget: Any = returned.budget
    if not isinstance(reason, str):
        raise NotScored(_said(found, f"{shown(reason)} as its reason, which is no text"))
    if not isinstance(budget, Budget):
        raise NotScored(_said(found, f"{shown(budget)} as its budget, which is no Budget"))
    value, low, high = (
        _number(getattr(returned, name), name, found) for name in ("value", "low", "high")
    )
    return Measure(value, low, high, reason, budget)


def _number(number: Any, name: str, found: Metric) -> float:
    try:
        return float(number)
    except (TypeError, ValueError) as error:
        what = f"{shown(number)} as its {name}, which is no number"
        raise NotScored(_said(found, what)) from error


def _said(found: Metric, what: str) -> str:
    return f"metric '{found.spec.id}' returned {what}{place_of(type(found).measure)}"
