"""Overshoot, undershoot, peak and its time: the extremes of a step response.

The largest of many noisy samples lies above the response by several standard deviations; extremes
are therefore taken from a local polynomial, and count as such only when they rise above what the
largest of as much noise would reach.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.special import ndtri

from eha_bench.core.arrays import FloatArray
from eha_bench.core.budget import Budget
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial
from eha_bench.metrics.coverage import NORMAL, between, reach, type_a, type_b
from eha_bench.metrics.local import Smooth, smooth
from eha_bench.metrics.local_peak import Peak, interpolated_peak, peak, vertex
from eha_bench.metrics.metric import NotScored, spec_of
from eha_bench.metrics.noise import white_noise
from eha_bench.metrics.one_sided import CLIPPED, longest_loss, open_ended
from eha_bench.metrics.samples import samples
from eha_bench.metrics.step_metric import (
    LEVELS,
    Finding,
    StepMetric,
    around,
    since_edge,
    with_state,
)
from eha_bench.metrics.step_response import (
    NotSettled,
    StepResponse,
    initial_window,
    require_finite,
)
from eha_bench.metrics.window import edges_of, timeline

_PARABOLA = 9
_FEWEST_PLACES = 8.0  # that a maximum is chosen from, where it is one of noise
_SMOOTHED = 0.004  # noise, as a share of the step, that is left for finding places

_AS_HIGH = 2.0 * math.sqrt(2.0)  # standard deviations by which two places are alike
_FLAT = 0.5  # share of as long as the peak's window, beside it, that is as high: a plateau
_JUST_LANDED = 4  # samples after a jump: a polynomial through the samples since misses its peak
_FEW = (
    3.0  # samples a rise, below which polynomials through samples are off by more than they differ
)
_LEAST = 5e-4  # of the step: below this a final level that is still creeping looks like a peak


@dataclass(frozen=True)
class Extreme:
    """The peak of a normalised response.

    Attributes:
        peak: its place and height.
        threshold: height that noise alone may reach.
        rivals: independent places that may be as high, 1 at least: their highest is too high.
    """

    peak: Peak
    threshold: float
    rivals: float = 1.0

    @property
    def selection_bias(self) -> float:
        """How much too high the highest of the places that may be as high is, at most."""
        return (_largest(self.rivals, 0.975) - NORMAL) * math.sqrt(self.peak.variance)


# three metrics ask for it; forgotten together with the response
_highest: WeakKeyDictionary[StepResponse, Extreme] = WeakKeyDictionary()


def highest(step: StepResponse) -> Extreme:
    """Return the highest place of the response."""
    if step not in _highest:
        _highest[step] = _extreme(step, 1.0, 1.0)
    return _highest[step]


def lowest(step: StepResponse) -> Extreme:
    """Return the lowest place of the response, turned upside down."""
    return _extreme(step, -1.0, 0.0)


def _extreme(step: StepResponse, side: float, level: float) -> Extreme:
    """Return the highest place of `side` times the response, which rises above `level`."""
    values, track = side * step.rise, smoothed_response(step)
    first = step.first_smooth_sample
    index = first + int(np.argmax(side * track.values[first:]))
    if step.exact or not step.noise.known:
        # between the kink at the edge and its neighbours there is nothing to interpolate
        index = step.origin + int(np.argmax(values[step.origin :]))
        return Extreme(_wider(step, vertex(step.time, values, index, step.origin)), 0.0)
    # no polynomial follows the kink at the edge, nor a jump that is not resolved
    after = slice(first, None)
    if not step.resolved and index - first < _JUST_LANDED:
        return Extreme(*_between_few(step, values, index))
    height = side * float(track.values[index]) - level
    found = peak(step.time[after], values[after], index - first, step.noise, step.passage, height)
    independent = max((values.size - first) / (2 * track.half + 1), _FEWEST_PLACES)
    sd = max(track.sd, math.sqrt(found.variance))
    threshold = sd * _largest(independent, 0.95) + found.between
    heights = side * track.values[first:]
    high = np.count_nonzero(heights >= heights.max() - _AS_HIGH * track.sd)
    return Extreme(found, threshold, max(high / (2 * (2 * track.half + 1)), 1.0))


def _between_few(step: StepResponse, values: FloatArray, index: int) -> tuple[Peak, float]:
    """Return the peak of a response of few samples, and what noise may reach there."""
    near = slice(max(index - 1, step.origin), index + 2)
    highest = near.start + int(np.argmax(values[near]))
    found = _wider(step, interpolated_peak(step.time, values, highest, step.origin, step.noise))
    return found, _largest(_FEWEST_PLACES, 0.95) * math.sqrt(found.variance) + found.between


def _wider(step: StepResponse, found: Peak) -> Peak:
    """Return a peak between samples, off by more the fewer there are in a rise."""
    few = max(_FEW / step.samples_a_rise, 1.0)
    return replace(found, between=few * found.between, between_times=few * found.between_times)


def _largest(count: float, share: float) -> float:
    """Return what the largest of so many normal numbers does not exceed in a share of all cases."""
    return float(ndtri(share ** (1.0 / count)))


def smoothed_response(step: StepResponse) -> Smooth:
    """Return the smoothed response, (n,); a jump within a few samples is not smeared."""
    if step.resolved:
        return step.smooth
    first = step.first_smooth_sample
    after = smooth(step.rise[first:], step.noise, _SMOOTHED, max((step.rise.size - first) // 50, 2))
    values = np.concatenate([step.rise[:first], after.values])
    return Smooth(values, after.sd, after.half)


class Overshoot(StepMetric):
    """How far the response goes beyond its final level, as a fraction of the step."""

    spec = spec_of("overshoot")

    def find(self, step: StepResponse) -> Finding:
        """Return the overshoot, never below 0."""
        found = highest(step)
        value = max(_extreme_as_read(step, found.peak.value, 1.0) - 1.0, 0.0)

        def measure() -> Measure:
            # r - 1 with r = (y - initial) / (final - initial)
            levels = step.final_budget.scaled(1.0 + value) + step.initial_budget.scaled(value)
            convention = f"beyond the final level as a fraction of the step, {LEVELS}"
            return _fraction(step, value, found, levels, convention, step.cut_above)

        return Finding(value, measure, step.cut_above, bool(step.unseen_in_motion))


class Undershoot(StepMetric):
    """How far the response goes against the step, below its initial level, as a fraction of it."""

    spec = spec_of("undershoot")

    def find(self, step: StepResponse) -> Finding:
        """Return the undershoot, never below 0."""
        found = lowest(step)
        value = max(_extreme_as_read(step, found.peak.value, -1.0), 0.0)

        def measure() -> Measure:
            levels = step.initial_budget.scaled(1.0 + value) + step.final_budget.scaled(value)
            convention = f"before the initial level as a fraction of the step, {LEVELS}"
            return _fraction(step, value, found, levels, convention, step.cut_below)

        return Finding(value, measure, step.cut_below, bool(step.unseen_in_motion))


def _own_budget(step: StepResponse, found: Peak) -> Budget:
    """Return what moves the height of an extreme (normalised), without the levels."""
    return (
        type_a("noise", found.variance, step.noise.freedom)
        + between("interpolation", found.between)
        + step.reading
    )


def _fraction(
    step: StepResponse,
    value: float,
    found: Extreme,
    levels: Budget,
    convention: str,
    clipped: bool,
) -> Measure:
    measure = around(step, value, _own_budget(step, found.peak) + levels, convention)
    low = 0.0 if value <= found.threshold else max(measure.low - found.selection_bias, 0.0)
    if math.isnan(measure.low):
        low = math.nan
    measure = replace(measure, low=low)
    return _opened(step, measure, 1.0, clipped)


def _extreme_as_read(step: StepResponse, height: float, side: float) -> float:
    """Return an extreme of `side` times the response, no farther than readings that were cut off.

    What follows readings up to a sensor's end would go beyond it.
    """
    cut = step.cut_above if side > 0.0 else step.cut_below
    return min(height, float(np.max(side * step.rise[step.origin :]))) if cut else height


def _opened(step: StepResponse, measure: Measure, side: float, clipped: bool) -> Measure:
    """Return a measure that holds what was not read: beyond a sensor's end, or in lost samples.

    Between two samples of a settled response a step has no extreme.
    """
    if clipped:
        return open_ended(measure, side, CLIPPED)
    if not step.unseen_in_motion:
        return measure
    return open_ended(measure, side, f"{longest_loss(step.unseen_in_motion)} after the edge")


class PeakValue(StepMetric):
    """The extreme value after the edge, in the direction of the step, in the channel's unit."""

    spec = spec_of("peak")

    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:
        """Return the worst peak over the edges; of a response that does not settle, of the hold."""
        try:
            return super().measure(recording, trial, channel)
        except NotSettled as error:
            return _unsettled_peak(recording, trial, channel, error.reason)

    def find(self, step: StepResponse) -> Finding:
        """Return the value of the local polynomial's extreme."""
        found = highest(step)
        value = step.initial + step.step * _extreme_as_read(step, found.peak.value, 1.0)
        unseen = bool(step.unseen_in_motion)
        return Finding(value, lambda: self._measure(step, found, value), step.cut_above, unseen)

    @staticmethod
    def _measure(step: StepResponse, found: Extreme, value: float) -> Measure:
        budget = _own_budget(step, found.peak).scaled(step.step)
        absolute, relative = step.calibration
        sensor = type_b("sensor", math.hypot(absolute, relative * value))
        own = reach(budget + sensor)
        bias = found.selection_bias * step.step
        low, high = value - own - max(bias, 0.0), value + own - min(bias, 0.0)
        if found.peak.value - 1.0 <= found.threshold:
            # no more than the level that it settles at
            settled = reach(step.final_budget.scaled(step.step) + sensor)
            if step.step > 0.0:
                low = min(low, step.final - settled)
            else:
                high = max(high, step.final + settled)
        reason = with_state(step, "extreme after the edge")
        measure = Measure(value, low, high, reason, (budget + sensor).merged())
        return _opened(step, measure, step.step, step.cut_above)


def _also_as_high(step: StepResponse, found: Peak) -> tuple[float, float]:
    """Return the interval of a peak's time, other places that may be as high taken in."""
    track = smoothed_response(step)
    half = track.half
    values = track.values[step.first_smooth_sample :]
    times = step.time[step.first_smooth_sample :]
    first, last = _plateau(times, values, track, found)
    earliest, latest = found.interval(step.noise)
    if half == 0:  # next to no noise: the polynomial knows
        return min(earliest, first), max(latest, last)
    reach = _AS_HIGH * track.sd
    rivals = (values >= maximum_filter1d(values, 2 * half + 1)) & (values >= values.max() - reach)
    places = times[rivals]
    return min(earliest, first, *places), max(latest, last, *places)


def _plateau(
    times: FloatArray, values: FloatArray, track: Smooth, found: Peak
) -> tuple[float, float]:
    """Return first and last time of a plateau that goes on beyond a peak's window, else its time.

    On a plateau the highest place is one of noise: any of it may be the peak.
    """
    start, stop = found.window
    ends = [found.time, found.time]
    if not stop > start:
        return ends[0], ends[1]
    count = values.size / (2 * track.half + 1)
    reach = (_AS_HIGH + _largest(max(count, 1.0), 0.5)) * track.sd
    near = values >= values.max() - reach
    length = stop - start
    for side, beside in enumerate(
        ((times >= start - length) & (times < start), (times > stop) & (times <= stop + length))
    ):
        if beside.any() and float(np.mean(near[beside])) >= _FLAT:
            ends[side] = float(times[near][0 if side == 0 else -1])
    return ends[0], ends[1]


def _unsettled_peak(recording: Recording, trial: Trial, channel: str, reason: str) -> Measure:
    """Return the farthest excursion from the level before the first edge, over the whole signal.

    A peak needs no final level. Noise is averaged by a local parabola over nine samples (variance
    59/231 of a sample's at its centre: Savitzky, Golay, Anal. Chem. 36 (1964) 1627); the interval
    is that of the parabola.
    """
    line = timeline(recording, trial)
    edges = edges_of(recording, trial)
    span = line.between(edges[0].time, edges[-1].until)
    data = samples(recording, trial, channel)
    values = data.values
    require_finite(line, values, span)
    before = values[initial_window(line, edges[0], float(line.time[0]))]
    inside = values[span]
    if inside.size < _PARABOLA:
        raise NotScored(reason)
    from scipy.signal import savgol_filter  # slow to import

    smoothed = savgol_filter(inside, _PARABOLA, 2)
    away = smoothed - float(np.mean(before))
    value = float(smoothed[int(np.argmax(np.abs(away)))])
    noise = type_a("noise", 59.0 / 231.0 * white_noise(inside) ** 2)
    rounding = between("resolution", 0.5 * data.resolution)
    budget = noise + rounding + type_b("sensor", data.calibration(value))
    own = reach(budget)
    notes = "; ".join((f"extreme after the first edge; {reason}", *data.notes(line, span)))
    side = value - float(np.mean(before))
    cut = {item.above for item in data.cut_off(span)}
    measure = Measure(value, value - own, value + own, notes, budget.merged())
    if (side > 0.0) in cut:
        return open_ended(measure, side, CLIPPED)
    if lost := line.lost(span):
        return open_ended(measure, side, longest_loss(lost))
    return measure


class PeakTime(StepMetric):
    """Time in s from the edge to the peak of a response that overshoots."""

    spec = spec_of("peak_time")

    def find(self, step: StepResponse) -> Finding:
        """Return the time of the local polynomial's extreme."""
        found = highest(step)
        if found.peak.value - 1.0 <= max(found.threshold, _LEAST):
            raise NotScored("no peak: the response does not overshoot beyond its noise")
        if step.cut_above:
            raise NotScored(f"the peak is clipped: {CLIPPED}")
        unseen = bool(step.unseen_in_motion)
        value = max(found.peak.time, 0.0)
        return Finding(value, lambda: self._measure(step, found), unseen=unseen)

    @staticmethod
    def _measure(step: StepResponse, found: Extreme) -> Measure:
        low, high = _also_as_high(step, found.peak)
        budget = between("interpolation", found.peak.between_times)
        own = reach(budget)
        low, high = low - own, high + own
        flat = (high - low) / 2.0 - own
        if step.noise.known:
            budget += type_a("noise", (flat / NORMAL) ** 2, step.noise.freedom)
        else:
            low = high = math.nan
        reason = with_state(step, "edge to the peak")
        if lost := step.unseen_in_motion:
            low, high = min(low, lost[0][0]), max(high, lost[-1][1])
            reason = f"the peak may be where samples are lost; {reason}"
        return since_edge(step, Measure(found.peak.time, low, high, reason, budget))
