"""Settling time: from the edge until the response stays within 2 % of the step."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.budget import Budget, Evaluation
from eha_bench.core.note import Note
from eha_bench.core.score import Measure
from eha_bench.metrics.coverage import NORMAL, reach, type_a
from eha_bench.metrics.crossing import Crossing, between_samples, refined_crossing, straight
from eha_bench.metrics.local import Smooth, smooth
from eha_bench.metrics.metric import NotScored, spec_of
from eha_bench.metrics.one_sided import longest_loss
from eha_bench.metrics.settling_model import settling_time_by_model
from eha_bench.metrics.step_metric import LEVELS, Finding, StepMetric, since_edge, with_state
from eha_bench.metrics.step_response import StepResponse
from eha_bench.metrics.step_times import RESPONDED

BAND = 0.02
"""Half-width of the band around the final level, as a share of the step."""

_REST = 2  # transits after a stop in which a response ...
_AT_REST = 2.0  # ... is no more standard deviations from its end than this, on average
_STEEP = 0.5  # of what changes from sample to sample: less noise hides no crossing between two
_SURELY_OUT = 3.0  # standard deviations beyond the band that are no noise

HOLD_SHARE = 0.1
"""Share of the hold for which the response must have stayed in the band."""


class SettlingTime(StepMetric):
    """Time in s after which the response stays within 2 % of the step around the final level.

    Noise would carry a settled response out of the band again and again. It is smoothed until a
    fifth of the band is left of it; where even that is not possible, two decaying modes are fitted
    to the tail, and where they do not explain it, nothing is scored.
    """

    spec = spec_of("settling_time")

    def find(self, step: StepResponse) -> Finding:
        """Return the last crossing of the band; its interval covers exits that noise may hide."""
        found = _not_before_its_response(step, self._find_settling(step))
        return _as_late_as_unseen(step, found)

    def _find_settling(self, step: StepResponse) -> Finding:
        track = _track(step)
        stopped = self._by_corner(step, track)
        if stopped is not None:
            return stopped
        spread = math.hypot(track.sd, step.final_budget.standard)
        if math.hypot(track.sd, _noise_of(step.final_budget)) > BAND / 5.0:
            return self._by_model(step, spread)
        distance = track.values - 1.0
        distance[: step.origin] = 1.0  # before the edge nothing has settled
        last = _last_exit(distance, 1.5 * track.sd)
        hold = float(step.time[-1])
        if last + 1 >= step.time.size or step.time[last] > (1.0 - HOLD_SHARE) * hold:
            raise NotScored(
                Note(
                    "not settled: outside of 2 % of the step {last:.4g} s after the edge, with the "
                    "hold ending at {hold:.4g} s",
                    last=float(step.time[last]),
                    hold=hold,
                )
            )
        edge = 1.0 + math.copysign(BAND, float(distance[last]))
        if step.exact or not step.noise.known:
            place = step.between_samples(edge, last + 1)
        else:
            place = straight(step.time, track.values, edge, last + 1)
            place = _refine_crossing(step, edge, place, last + 1)
        return Finding(
            max(place.time, 0.0), lambda: self._by_exit(step, track.sd, distance, last, place)
        )

    @classmethod
    def _by_exit(
        cls, step: StepResponse, sd: float, distance: FloatArray, last: int, place: Crossing
    ) -> Measure:
        """Return the measure of the last exit from the band, after sample `last`."""
        noise = type_a("noise", sd**2, step.noise.freedom)
        level = step.final_budget + step.rounding(place)
        # where the response turns, all that it is known to is a step of its sensor
        turning = noise + step.final_budget + step.reading
        beyond = reach(turning)
        low, high = cls._interval(step, distance, last, place, level, beyond)
        convention = f"2 % of the step for good, {LEVELS}"
        budget = place.budget(level, step.noise)
        wide = (high - low) / (2.0 * NORMAL)
        if wide > 1.5 * budget.standard:  # other exits from the band that noise hides or feigns
            rest = math.sqrt(wide**2 - budget.variance)
            budget += type_a("other exits", rest**2, step.noise.freedom)
        return since_edge(
            step, Measure(place.time, low, high, with_state(step, convention), budget)
        )

    @staticmethod
    def _by_corner(step: StepResponse, track: Smooth) -> Finding | None:
        """Return where a response that stops all at once comes to the band; None if it goes on."""
        place = step.stopping(1.0 - BAND)
        if place is None:
            return None
        index = int(np.searchsorted(step.time, place.time)) + track.half + 1
        after = np.abs(track.values[index:] - 1.0)
        if after.size == 0 or float(after.max()) > BAND + _SURELY_OUT * track.sd:
            return None
        # what goes on beyond its end, or comes to it slowly, has not stopped
        rest = step.rise[index : index + _REST * step.transit]
        sd = math.sqrt(step.noise.variance_of_mean(rest.size) + step.final_budget.variance)
        if abs(float(rest.mean()) - 1.0) > _AT_REST * sd:
            return None

        def measure() -> Measure:
            level = step.final_budget + step.rounding(place)
            low, high = place.interval(level, step.noise)
            reason = with_state(step, f"2 % of the step for good, where it stops at once, {LEVELS}")
            budget = place.budget(level, step.noise)
            return since_edge(step, Measure(place.time, low, high, reason, budget))

        return Finding(max(place.time, 0.0), measure)

    @staticmethod
    def _by_model(step: StepResponse, spread: float) -> Finding:
        floor = f"the noise floor of {100 * spread:.2g} % of the step hides the 2 % band"
        if not step.noise.known:
            raise NotScored(floor)
        latest = (1.0 - HOLD_SHARE) * float(step.time[-1])
        try:
            value, interval = settling_time_by_model(step, BAND, latest)
        except NotScored as error:
            raise NotScored(f"{floor}; {error.reason}") from error
        convention = (
            f"2 % of the step for good, {LEVELS}; two modes fitted to the tail, since {floor}"
        )

        def measure() -> Measure:
            low, high = interval()
            parameters = type_a("noise", ((high - low) / (2.0 * NORMAL)) ** 2, step.noise.freedom)
            reason = with_state(step, convention)
            return since_edge(step, Measure(value, low, high, reason, parameters))

        return Finding(max(value, 0.0), measure)

    @staticmethod
    def _interval(
        step: StepResponse,
        distance: FloatArray,
        last: int,
        place: Crossing,
        level: Budget,
        beyond: float,
    ) -> tuple[float, float]:
        if not step.noise.known:
            return math.nan, math.nan
        surely = _last_outside(distance, BAND + beyond)
        perhaps = _last_outside(distance, BAND - beyond)
        low, high = place.interval(level, step.noise)
        own = 0.5 * (high - low)
        if step.exact:
            return low, high
        # an oscillation that just clears the band, or just does not, moves the time by a period:
        # the last excursion may be none, or the one after it may be one
        if surely < _began(distance, last):
            low = min(low, float(step.time[surely]))
        if step.time[perhaps] > high + 3.0 * own:
            high = _back_inside(step.time, distance, perhaps, BAND - beyond)
        return low, high


def _as_late_as_unseen(step: StepResponse, found: Finding) -> Finding:
    """Return a settling time whose interval reaches as far as lost samples may have been outside.

    No sample tells that a response stayed in the band while none was read.
    """
    later = [one for one in step.unseen if one[1] > found.value]
    if not later:
        return found
    last = later[-1]

    def measure() -> Measure:
        own = found.measure()
        why = f"{longest_loss([last])} after the edge"
        low = own.low if math.isnan(own.low) else min(own.low, *(one[0] for one in later))
        return replace(own, low=low, high=max(own.high, last[1]), reason=f"{own.reason}; {why}")

    return replace(found, measure=measure, unseen=True)


def _noise_of(budget: Budget) -> float:
    """Return the standard uncertainty of type A of a budget."""
    own = (part.standard for part in budget.parts if part.evaluation is Evaluation.A)
    return math.hypot(*own)


def _not_before_its_response(step: StepResponse, found: Finding) -> Finding:
    """Return a settling time that is not before the response time; its interval only grows.

    What stays within 2 % of the step has been through 95 % of it. Two modes can miss that where the
    tail is over within a few samples, which tell little of it in noise.
    """
    try:
        reached = step.crossing(RESPONDED)
    except NotScored:
        return found
    least = max(reached.time, 0.0)
    if found.value >= least:
        return found

    def measure() -> Measure:
        _, latest = reached.interval(step.place_budget(reached, RESPONDED), step.noise)
        high = since_edge(step, Measure(reached.time, reached.time, latest)).high
        own = found.measure()
        return replace(
            own,
            value=least,
            high=max(own.high, high, least),
            reason=f"{own.reason}; not before 95 % are reached",
        )

    return Finding(least, measure)


def _track(step: StepResponse) -> Smooth:
    """Return the response smoothed as far as its own speed allows; a jump is not smeared."""
    first = step.first_smooth_sample if not step.resolved else 0
    # of few samples a rise, a parabola through five would smear what rings
    widest = max(2, step.transit) if step.resolved else 0
    after = smooth(step.rise[first:], step.noise, BAND / 15.0, widest)
    return Smooth(np.concatenate([step.rise[:first], after.values]), after.sd, after.half)


def _refine_crossing(step: StepResponse, edge: float, guess: Crossing, index: int) -> Crossing:
    first = step.first_smooth_sample if not step.resolved else 0
    if not step.resolved:
        read = between_samples(
            step.time, step.rise, edge, index, step.noise, step.origin, step.samples_a_rise
        )
        within_the_jump = index <= first
        if within_the_jump or step.noise.sd < _STEEP * abs(read.slope) * read.span:
            return read
    widest = max(round(step.passage), 3)
    found = refined_crossing(step.time[first:], step.rise[first:], edge, guess, step.noise, widest)
    return step.between_samples(edge, index) if found is None else found


def _last_exit(distance: FloatArray, beyond: float) -> int:
    """Return the last sample outside of the band in an excursion that is not only noise."""
    sure = _last_outside(distance, BAND + beyond)
    inside = np.flatnonzero(np.abs(distance[sure:]) <= BAND)
    return sure + int(inside[0]) - 1 if inside.size and inside[0] > 0 else distance.size - 1


def _began(distance: FloatArray, last: int) -> int:
    """Return the first sample of the excursion from the band that ends with sample `last`."""
    inside = np.flatnonzero(np.abs(distance[:last]) <= BAND)
    return int(inside[-1]) + 1 if inside.size else 0


def _back_inside(time: FloatArray, distance: FloatArray, last: int, band: float) -> float:
    """Return when the response is back within a band that it left last at sample `last`."""
    after = min(last + 1, time.size - 1)
    here, there = abs(float(distance[last])), abs(float(distance[after]))
    share = (here - band) / (here - there) if there < band < here else 1.0
    return float(time[last] + share * (time[after] - time[last]))


def _last_outside(distance: FloatArray, band: float) -> int:
    outside = np.flatnonzero(np.abs(distance) > band)
    return int(outside[-1]) if outside.size else 0
