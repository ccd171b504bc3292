"""A metric of the step response: one definition, applied to every edge, the worst one reported."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace

from eha_bench.core.budget import Budget
from eha_bench.core.note import prefixed
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial
from eha_bench.metrics.coverage import between, reach
from eha_bench.metrics.metric import Metric, NotScored
from eha_bench.metrics.step_response import StepResponse, has_steps, step_responses

LEVELS = "levels by windows"


@dataclass(frozen=True)
class Finding:
    """What a metric finds at one edge: its value, and what leads on to the whole measure.

    Only the worst edge is reported, and an interval takes as long as its value.

    Attributes:
        value: SI.
        measure: gives the value with its interval and its budget.
        open: whether a sensor's end cut it off, so that it may be any larger.
        unseen: whether samples are lost where it may have been larger.
    """

    value: float
    measure: Callable[[], Measure]
    open: bool = False
    unseen: bool = False

    @property
    def magnitude(self) -> tuple[float, float]:
        """What orders findings; what may be any larger counts as the largest."""
        if math.isnan(self.value):
            return math.inf, math.inf
        return math.inf if self.open else abs(self.value), abs(self.value)


class StepMetric(Metric):
    """Scores trials whose signal has edges; with several edges, the largest magnitude counts."""

    def applies(self, trial: Trial) -> bool:
        """Whether the signal has an edge."""
        return has_steps(trial)

    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:
        """Return the worst value over the edges, and say which edge it belongs to."""
        responses = step_responses(recording, trial, channel)
        found = [self._find_at_edge(step, len(responses)) for step in responses]
        place = max(range(len(found)), key=lambda index: found[index].magnitude)
        chosen = found[place].measure()
        if len(found) == 1:
            return chosen
        for step, other in zip(responses, found, strict=True):
            if other.unseen and other is not found[place]:
                chosen = _as_far_as(chosen, other.measure(), step.edge.time)
        which = f"worst of {len(found)} edges, at {responses[place].edge.time:.6g} s"
        return replace(chosen, reason=f"{which}; {chosen.reason}")

    def _find_at_edge(self, step: StepResponse, edges: int) -> Finding:
        try:
            return self.find(step)
        except NotScored as error:
            if edges == 1:
                raise
            raise NotScored(
                prefixed("edge at {edge:.6g} s: ", error.reason, edge=step.edge.time)
            ) from error

    @abstractmethod
    def find(self, step: StepResponse) -> Finding:
        """Return what is found at one edge."""


def _as_far_as(measure: Measure, other: Measure, edge: float) -> Measure:
    """Return the measure of the worst edge, as far as lost samples after another may reach."""
    low = min(measure.low, other.low) if other.low == -math.inf else measure.low
    high = max(measure.high, other.high)
    if (low, high) == (measure.low, measure.high):
        return measure
    reason = f"it may be worse at the edge at {edge:.6g} s ({other.reason}); {measure.reason}"
    return replace(measure, low=low, high=high, reason=reason)


def around(step: StepResponse, value: float, budget: Budget, convention: str) -> Measure:
    """Return a value with the interval that its budget gives it."""
    own = reach(budget)
    return Measure(value, value - own, value + own, with_state(step, convention), budget.merged())


def since_edge(step: StepResponse, measure: Measure) -> Measure:
    """Return a time since the edge, later at most by what the edge may have been earlier.

    Nothing answers before it is asked: where the edge lies between two samples, interpolation
    could say so.
    """
    low, value, high = (
        part if math.isnan(part) else max(part, 0.0)
        for part in (measure.low, measure.value, measure.high)
    )
    late = between("time stamps", 0.5 * step.slack)
    budget = (measure.budget + late).merged()
    return replace(measure, value=value, low=low, high=high + step.slack, budget=budget)


def with_state(step: StepResponse, convention: str) -> str:
    """Return the convention followed by what the reader of the score should know."""
    return "; ".join((convention, *step.notes))
