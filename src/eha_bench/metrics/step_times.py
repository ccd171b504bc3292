"""Rise, response and delay time: interpolated crossings of levels between initial and final.

Definitions: IEEE Std 181-2011 (reference level instants); the
response time of the paper runs from the command's edge to 95 % of the final level.
"""

from __future__ import annotations

from eha_bench.core.score import Measure
from eha_bench.metrics.metric import spec_of
from eha_bench.metrics.step_metric import LEVELS, StepMetric, around, said, since_edge
from eha_bench.metrics.step_response import StepResponse

RESPONDED = 0.95
"""Share of the step at which a response counts as there."""


class RiseTime(StepMetric):
    """Time in s from 10 to 90 % of the step."""

    spec = spec_of("rise_time")

    def of(self, step: StepResponse) -> Measure:
        """Return the time between the two crossings; they share the errors of both levels."""
        low, high = step.crossing(0.1), step.crossing(0.9)
        initial = 0.9 / low.slope - 0.1 / high.slope
        final = 0.1 / low.slope - 0.9 / high.slope
        variance = (
            initial**2 * step.initial_variance
            + final**2 * step.final_variance
            + low.variance / low.slope**2
            + high.variance / high.slope**2
        )
        return around(step, high.time - low.time, variance, f"10-90 % of the step, {LEVELS}")


class ResponseTime(StepMetric):
    """Time in s from the command's edge to 95 % of the step."""

    spec = spec_of("response_time")

    def of(self, step: StepResponse) -> Measure:
        """Return the time of the crossing of 95 %."""
        return _until(step, RESPONDED, f"edge to 95 % of the measured final level, {LEVELS}")


class DelayTime(StepMetric):
    """Time in s from the command's edge to 50 % of the step."""

    spec = spec_of("delay_time")

    def of(self, step: StepResponse) -> Measure:
        """Return the time of the crossing of 50 %."""
        return _until(step, 0.5, f"edge to 50 % of the step, {LEVELS}")


def _until(step: StepResponse, share: float, convention: str) -> Measure:
    crossing = step.crossing(share)
    low, high = crossing.interval(step.level_variance(share), step.noise)
    return since_edge(step, Measure(crossing.time, low, high, said(step, convention)))
