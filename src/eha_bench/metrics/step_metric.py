"""A metric of the step response: one definition, applied to every edge, the worst one reported."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import replace

from eha_bench.core.budget import Budget
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial
from eha_bench.metrics.coverage import between, reach
from eha_bench.metrics.metric import Metric, NotScored
from eha_bench.metrics.step_response import StepResponse, has_steps, step_responses

LEVELS = "levels by windows"


class StepMetric(Metric):
    """Scores trials whose signal has edges; with several edges, the largest magnitude counts."""

    def applies(self, trial: Trial) -> bool:
        """Whether the signal has an edge."""
        return has_steps(trial)

    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:
        """Return the worst value over the edges."""
        responses = step_responses(recording, trial, channel)
        return worst([(step, self._placed(step, len(responses))) for step in responses])

    def _placed(self, step: StepResponse, edges: int) -> Measure:
        try:
            return self.of(step)
        except NotScored as error:
            if edges == 1:
                raise
            raise NotScored(f"edge at {step.edge.time:.6g} s: {error.reason}") from error

    @abstractmethod
    def of(self, step: StepResponse) -> Measure:
        """Return the value for one edge."""


def worst(found: list[tuple[StepResponse, Measure]]) -> Measure:
    """Return the measure of the largest magnitude, and say which edge it belongs to."""
    step, chosen = max(found, key=lambda pair: _magnitude(pair[1]))
    if len(found) == 1:
        return chosen
    return replace(
        chosen, reason=f"worst of {len(found)} edges, at {step.edge.time:.6g} s; {chosen.reason}"
    )


def _magnitude(measure: Measure) -> tuple[float, float]:
    """Return what orders measures by magnitude; what may be any larger counts as the largest."""
    if math.isnan(measure.value):
        return math.inf, math.inf
    return max(map(abs, measure.span)), abs(measure.value)


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
