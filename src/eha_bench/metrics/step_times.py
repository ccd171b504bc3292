"""Rise, response and delay time: interpolated crossings of levels between initial and final.

Definitions: IEEE Std 181-2011 (reference level instants); the
response time of the paper runs from the command's edge to 95 % of the final level.
"""

from __future__ import annotations

import math
from dataclasses import replace

from eha_bench.core.budget import Budget
from eha_bench.core.metric import Better, MetricSpec, Needs
from eha_bench.core.score import Measure
from eha_bench.metrics.crossing import Crossing
from eha_bench.metrics.metric import spec_of
from eha_bench.metrics.step_metric import (
    LEVELS,
    Finding,
    StepMetric,
    around,
    since_edge,
    with_state,
)
from eha_bench.metrics.step_response import StepResponse

RESPONDED = 0.95
"""Share of the step at which a response counts as there."""

MOVED = 0.05
"""Share of the step at which a response counts as started."""


class RiseTime(StepMetric):
    """Time in s from 10 to 90 % of the step."""

    spec = spec_of("rise_time")

    def find(self, step: StepResponse) -> Finding:
        """Return the time between the two crossings; they share the errors of both levels."""
        low, high = step.crossing(0.1), step.crossing(0.9)
        return Finding(high.time - low.time, lambda: self._measure(step, low, high))

    @staticmethod
    def _measure(step: StepResponse, low: Crossing, high: Crossing) -> Measure:
        initial = 0.9 / low.slope - 0.1 / high.slope
        final = 0.1 / low.slope - 0.9 / high.slope
        budget = (
            step.initial_budget.scaled(initial)
            + step.final_budget.scaled(final)
            + low.budget(step.rounding(low), step.noise)
            + high.budget(step.rounding(high), step.noise)
        )
        budget = _together(budget, low, high, step)
        found = around(step, high.time - low.time, budget, f"10-90 % of the step, {LEVELS}")
        return replace(found, low=max(found.low, 0.0)) if found.low < 0.0 else found


def _together(budget: Budget, low: Crossing, high: Crossing, step: StepResponse) -> Budget:
    """Return the budget less what both crossings have of the same slow noise, which cancels."""
    period = float(step.time[-1] - step.time[0]) / (step.time.size - 1)
    common = step.noise.correlation(round((high.time - low.time) / period))
    shared = 2.0 * common * math.sqrt(low.variance * high.variance) / (low.slope * high.slope)
    noise = math.fsum(part.standard**2 for part in budget.parts if part.source == "noise")
    if not 0.0 < shared < noise:
        return budget
    share = math.sqrt(1.0 - shared / noise)
    return Budget(
        tuple(
            replace(part, standard=share * part.standard) if part.source == "noise" else part
            for part in budget.parts
        )
    )


class ResponseTime(StepMetric):
    """Time in s from the command's edge to 95 % of the step."""

    spec = spec_of("response_time")

    def find(self, step: StepResponse) -> Finding:
        """Return the time of the crossing of 95 %."""
        return _until(step, RESPONDED, f"edge to 95 % of the measured final level, {LEVELS}")


class DelayTime(StepMetric):
    """Time in s from the command's edge to 50 % of the step."""

    spec = spec_of("delay_time")

    def find(self, step: StepResponse) -> Finding:
        """Return the time of the crossing of 50 %."""
        return _until(step, 0.5, f"edge to 50 % of the step, {LEVELS}")


class DeadTime(StepMetric):
    """Time in s from the command's edge until the response is seen to move."""

    spec = MetricSpec(
        "dead_time",
        "from the command's edge to 5 % of the step",
        "s",
        better=Better.LOWER,
        needs=Needs.STEP,
    )
    by_default = False

    def find(self, step: StepResponse) -> Finding:
        """Return the time of the crossing of 5 %."""
        return _until(step, MOVED, f"edge to 5 % of the step, {LEVELS}")


def _until(step: StepResponse, share: float, convention: str) -> Finding:
    crossing = step.crossing(share)

    def measure() -> Measure:
        level = step.place_budget(crossing, share)
        low, high = crossing.interval(level, step.noise)
        budget = crossing.budget(level, step.noise)
        reason = with_state(step, convention)
        return since_edge(step, Measure(crossing.time, low, high, reason, budget))

    return Finding(max(crossing.time, 0.0), measure)
