"""A step response, normalised: 0 is the level before the edge, 1 the level that it settles at."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from eha_bench.core.arrays import ComplexArray, FloatArray
from eha_bench.core.budget import Budget
from eha_bench.core.finite import LARGEST
from eha_bench.core.note import Note
from eha_bench.core.recording import Recording
from eha_bench.core.signal import Edge
from eha_bench.core.trial import Trial
from eha_bench.metrics.coverage import between
from eha_bench.metrics.crossing import SOON, Crossing, between_samples, refined_crossing, straight
from eha_bench.metrics.levels import Level, histogram_levels, level
from eha_bench.metrics.local import Smooth, smooth
from eha_bench.metrics.memo import remembered
from eha_bench.metrics.metric import NotScored
from eha_bench.metrics.noise import Noise, detrended, estimate, means_over, white_noise, with_means
from eha_bench.metrics.onset import ComesToRest, Corner, SetsOff, corner
from eha_bench.metrics.resolution import dithering, rounding_sd
from eha_bench.metrics.samples import Samples, samples
from eha_bench.metrics.tail import asymptote
from eha_bench.metrics.window import Timeline, edges_of, timeline

FINAL_SHARE = 0.2
"""Share of the hold, at its end, whose mean is the final level."""

DRIFT = 0.02
"""Change along the final window, as a share of the step, above which nothing has settled."""

MOST_EDGES = 64
"""Edges up to which a signal is a sequence of steps."""

_EXACT = 1e-6  # noise below this share of the step: crossings are interpolated between samples
_SMALLEST = 1e-100
_RESOLVED = 4  # samples from 25 to 75 % below which a polynomial cannot follow the response
_PASSED = 3.5  # the same, a fraction of a sample counted
_SMOOTHED = 0.004  # noise, as a share of the step, that is left for finding places
_PREDICTED = 0.1  # of what a tail has still to go: how well prediction knows it
_FEW_SLOW = 15.0  # degrees of freedom of slow noise below which more of the hold is looked at ...
_PARTS = 8  # of the shortest window, over which what is slow is compared
_ALIKE = 4.0  # ... and believed where its variance is no more than so many times as large
_AWAY = 0.05  # of the step: a response that stays closer to its end has settled

_MISSED = 0.004  # of the step: what a cubic misses over as long as 25 to 75 % take, either way
_NARROWEST = 2.0  # samples on either side of a place that a cubic is put through
_STOPPED = 6  # samples after a corner, at least
_NOISY = 0.1  # samples that noise may move a crossing by that is read between two
_OF_A_RISE = 0.75  # of the samples from 10 to 90 %, on either side: where a polynomial averages ...
_WIDEST_IN_FEW = 6  # ... and samples at most
_QUARTIC = 3.0 / 35.0 / 24.0  # of a fourth derivative: what a cubic misses in its middle
_LAGS_A_RISE = math.log(9.0)  # time constants that a lag takes from 10 to 90 %
_BEGUN = 0.05  # of the step: a response has hardly set off
_CORNERS = 10.0  # samples from 10 to 90 % below which a corner may go unseen
_RESTING = 1e-9  # of the step: readings that move less at rest are free of noise
_FEW_A_RISE = 5.0  # below which a note is given


@dataclass(frozen=True, eq=False)
class StepResponse:
    """What one channel does between an edge of the command and the next.

    Compared and hashed by identity, so that what is found in it can be cached with it.

    Attributes:
        edge: as commanded; time in s of the signal, levels in SI.
        time: (n,) s since the edge, from the start of the initial window.
        rise: (n,) normalised response: 0 initial, 1 final level.
        origin: index of the last sample not after the edge.
        initial: level before the edge, SI.
        step: final minus initial level, SI, signed.
        initial_budget, final_budget: what moves the normalised levels.
        noise: of `rise`.
        resolution: of the sensor, normalised.
        dither: standard deviation of the noise that carries it over the steps of its sensor.
        calibration: standard uncertainties of the sensor: of a level's offset, SI, and relative.
        smooth: `rise` smoothed, for finding places.
        transit: samples from about 25 to 75 %.
        samples_a_rise: sample periods from 10 to 90 %, by straight lines.
        cut_above, cut_below: whether a sensor's end cut readings off in the direction of the step,
            and against it.
        unseen: s since the edge, from to, where samples are lost for at least as long as the
            response takes from 25 to 75 %: it may have gone anywhere and come back.
        slack: s by which the edge may really have been earlier (0 when its time is known).
        noted: gives what a reader of the score should know.
    """

    edge: Edge
    time: FloatArray
    rise: FloatArray
    origin: int
    initial: float
    step: float
    initial_budget: Budget
    final_budget: Budget
    noise: Noise
    resolution: float
    dither: float
    calibration: tuple[float, float]
    smooth: Smooth
    transit: int
    samples_a_rise: float
    cut_above: bool
    cut_below: bool
    unseen: tuple[tuple[float, float], ...]
    slack: float
    noted: Callable[[], tuple[str, ...]]
    _crossings: dict[float, Crossing] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the score should know, one clause each."""
        return self.noted()

    @property
    def final(self) -> float:
        """Level at the end of the hold, SI."""
        return self.initial + self.step

    @cached_property
    def unseen_in_motion(self) -> tuple[tuple[float, float], ...]:
        """Where samples are lost and the response had not settled before, or not after, s."""
        return tuple(one for one in self.unseen if any(self._is_away(time) for time in one))

    def _is_away(self, time: float) -> bool:
        """Whether the response is off its final level at a sample's time."""
        index = min(int(np.searchsorted(self.time, time - 1e-9)), self.time.size - 1)
        return bool(abs(float(self.smooth.values[index]) - 1.0) > _AWAY)

    @property
    def exact(self) -> bool:
        """Whether the recording is free of noise, so that samples can be taken at their word."""
        return self.noise.sd <= _EXACT

    @property
    def resolved(self) -> bool:
        """Whether there are enough samples between 25 and 75 % for a polynomial to follow them."""
        return self.transit >= _RESOLVED and self.passage >= _PASSED

    @property
    def first_smooth_sample(self) -> int:
        """Index of the first sample, after the edge, from which on curves are smooth.

        Of a response that is there within a few samples, the first that has come to 90 %.
        """
        if self.resolved:
            return self.origin
        beyond = np.flatnonzero(self.rise[self.origin :] >= 0.9)
        return self.origin + (int(beyond[0]) if beyond.size else 0)

    def level_budget(self, share: float) -> Budget:
        """Return what moves the level at `share` of the step (normalised).

        Steps of the command are often whole steps of the sensor: both levels are then rounded
        alike, and between them nothing averages out.
        """
        both = self.initial_budget.scaled(1.0 - share) + self.final_budget.scaled(share)
        own = Budget(tuple(part for part in both.parts if part.source != "resolution"))
        return own + self.reading

    @property
    def reading(self) -> Budget:
        """What the sensor's resolution leaves of a value that is read where nothing moves."""
        return between("resolution", math.sqrt(3.0) * rounding_sd(self.resolution, self.dither))

    def rounding(self, crossing: Crossing) -> Budget:
        """Return what the sensor's resolution leaves of a place found in many of its steps."""
        steps = abs(crossing.slope) * crossing.span / max(self.resolution, 1e-300)
        return self.reading.scaled(1.0 / max(steps, 1.0))

    def place_budget(self, crossing: Crossing, share: float) -> Budget:
        """Return what moves the level of a crossing, as read there."""
        return self.level_budget(share) + self.rounding(crossing)

    def crossing(self, share: float) -> Crossing:
        """Return where the response first gets to `share` of the step, in s since the edge.

        A crossing counts once the smoothed response has gone beyond it by two of its standard
        deviations, so that noise around a level that it stays at does not.
        """
        if share not in self._crossings:  # several metrics ask for the same
            self._crossings[share] = self._crossing(share)
        return self._crossings[share]

    def _crossing(self, share: float) -> Crossing:
        key = f"{100 * share:g} %"
        values = self.smooth.values[self.origin :]
        beyond = np.flatnonzero(values >= share + 2.0 * self.smooth.sd)
        if beyond.size == 0:
            beyond = np.flatnonzero(values >= share)
        if beyond.size == 0:
            raise NotScored(f"the response does not reach {key} of the step")
        below = np.flatnonzero(values[: int(beyond[0])] < share)
        if below.size == 0:
            return self._from_the_edge(share, key)
        index = self.origin + int(below[-1]) + 1
        guess = straight(self.time, self.smooth.values, share, index)
        if self.exact or not self.noise.known:
            return self.between_samples(share, index)
        if not self.resolved:
            return self._in_few(share, index)
        sudden = self._sudden(share)
        if sudden is not None:
            return sudden
        if share <= _BEGUN and self.samples_a_rise < _CORNERS:
            return self._as_read(share, index)  # there may be a corner that is not seen
        after = slice(self.origin, None)  # the edge may leave a kink, no polynomial follows one
        found = refined_crossing(
            self.time[after],
            self.rise[after],
            share,
            guess,
            self.noise,
            self._window,
        )
        if found is None:
            return self._as_read(share, index)
        period = float(self.time[-1] - self.time[0]) / (self.time.size - 1)
        missed = _MISSED * (0.5 * found.span / period / self.passage) ** 4
        missed = missed / max(abs(found.slope), 1e-300)
        return replace(found, between=math.hypot(found.between, missed))

    def _from_the_edge(self, share: float, key: str) -> Crossing:
        """Return the crossing of a share that is beyond it at the edge, as smoothing has it."""
        at_once = int(np.argmax(self.rise[self.origin :] >= share))
        if at_once == 0:
            raise NotScored(f"the response is beyond {key} of the step at the edge already")
        index = self.origin + at_once
        sudden = self._sudden(share) if self.noise.known and not self.exact else None
        return self.between_samples(share, index, self.rise) if sudden is None else sudden

    def _sudden(self, share: float) -> Crossing | None:
        """Return the crossing of a share of the step that lies close to a corner, or None."""
        if share <= SOON:
            return None if self._start is None else self._start.crossing(share)
        return self.stopping(share) if share >= 1.0 - SOON else None

    def stopping(self, share: float) -> Crossing | None:
        """Return where a response that stops all at once comes to a share of the step, or None."""
        if self.exact or not self.noise.known or not self.resolved or self._stop is None:
            return None
        found = self._stop.crossing(1.0 - share)
        return None if found is None else replace(found, time=-found.time)

    @cached_property
    def _start(self) -> Corner | None:
        """The corner that the response sets off with."""
        after = self.smooth.values[self.origin :]
        stop = self.origin + int(np.argmax(after >= 0.5)) + 1
        first = self.origin + int(np.argmax(after >= SOON))
        here = slice(self.origin, stop)
        latest = float(self.time[min(first + self.smooth.half + 1, stop - 1)])
        return corner(self.time[here], self.rise[here], self.noise, latest, SetsOff())

    @cached_property
    def _stop(self) -> Corner | None:
        """The corner that it stops with, in time that runs backwards."""
        after = self.smooth.values[self.origin :]
        index = self.origin + int(np.argmax(after >= 1.0 - 0.5 * SOON))
        half = np.flatnonzero(self.smooth.values[self.origin : index] < 0.5)
        if half.size == 0:
            return None
        start = self.origin + int(half[-1])
        here = slice(start, min(index + max(index - start, _STOPPED), self.time.size))
        time, missing = -self.time[here][::-1], 1.0 - self.rise[here][::-1]
        earliest = -float(self.time[max(index - self.smooth.half - 2, start)])
        return corner(time, missing, self.noise, earliest, ComesToRest())

    def _in_few(self, share: float, index: int) -> Crossing:
        """Return the crossing of a response of few samples: between two, where noise lets it be.

        Where noise alone moves it by much of a sample, as in a slow tail, a polynomial averages.
        What a lag of time constant T has still to go, g e^(-t / T), bends by g / T^4 in its fourth
        derivative, and a cubic over h on either side misses 3 / 35 of g (h / T)^4 / 24 of it in the
        middle (the part of x^4 that Legendre's P4 has): over as many samples as a rise takes, more
        than noise leaves, and always to the same side. The window is one in which that is a third
        of the noise, 1.1 sd / sqrt(h), and what it misses counts as interpolation.
        """
        read = self._as_read(share, index)
        period = float(self.time[-1] - self.time[0]) / (self.time.size - 1)
        if self.noise.sd < _NOISY * abs(read.slope) * period:
            return read
        after = slice(self.origin, None)
        bend = _QUARTIC * (1.0 - share) * (_LAGS_A_RISE / max(self.samples_a_rise, 1.0)) ** 4
        half = (1.1 / 3.0 * self.noise.sd / bend) ** (1.0 / 4.5)
        widest = min(round(_OF_A_RISE * self.samples_a_rise), round(half) - 1, _WIDEST_IN_FEW)
        found = refined_crossing(
            self.time[after], self.rise[after], share, read, self.noise, max(widest, 2)
        )
        if found is None:
            return read
        missed = bend * (0.5 * found.span / period) ** 4 / max(abs(found.slope), 1e-300)
        return replace(found, between=math.hypot(found.between, missed))

    def _as_read(self, share: float, index: int) -> Crossing:
        """Return the crossing between the samples themselves, near the one before `index`."""
        near = np.arange(max(index - 2, self.origin + 1), min(index + 3, self.time.size))
        crossed = near[(self.rise[near - 1] < share) & (self.rise[near] >= share)]
        nearest = int(crossed[np.argmin(np.abs(crossed - index))]) if crossed.size else index
        return self.between_samples(share, nearest, self.rise)

    def between_samples(self, share: float, index: int, read: FloatArray | None = None) -> Crossing:
        """Return the crossing of a share of the step between samples index - 1 and index.

        Of (n,) values that were read, else of the response, smoothed where samples are many.
        """
        values = self.smooth.values if self.resolved else self.rise
        values = values if read is None else read
        return between_samples(
            self.time,
            values,
            share,
            index,
            self.noise,
            self.origin,
            self.samples_a_rise,
        )

    @property
    def passage(self) -> float:
        """Samples from 25 to 75 %, a fraction of one counted: half of those from 10 to 90 %."""
        return max(min(float(self.transit), 0.5 * self.samples_a_rise), 1.0)

    @property
    def _window(self) -> int:
        """Samples on either side of a place in which a cubic misses less than its noise.

        By the noise's size and the response's speed alone, so that the choice does not depend on
        the noise that it is to be judged by: a cubic over h samples, where there are T from 25 to
        75 %, misses about 0.004 (h / T)^4 of the step (second order, T = 0.9 / omega_n), and its
        noise is 1.1 sd / sqrt(h); the former may be a thirtieth of the latter. Where samples are
        few it cannot be less, and counts as interpolation.
        """
        half = (8.0 * self.noise.sd * self.passage**4) ** (1.0 / 4.5)
        return int(min(max(half, _NARROWEST), max(0.75 * self.passage, _NARROWEST)))


class NotSettled(NotScored):
    """The response still moves at the end of the hold: it has no final level."""


def has_steps(trial: Trial) -> bool:
    """Whether the edges of the signal are steps to score, and not the bits of a binary noise."""
    return 0 < len(trial.signal.edges) <= MOST_EDGES and not trial.signal.lines


def step_responses(recording: Recording, trial: Trial, channel: str) -> tuple[StepResponse, ...]:
    """Return the response of a channel to every edge of the trial's signal, in order of time.

    Raises:
        NotScored: no edge, samples without a value, no step seen, or not settled.
        MissingChannelError: no such channel.
    """
    return remembered(
        recording, trial, ("steps", channel), lambda: _step_responses(recording, trial, channel)
    )


def _step_responses(recording: Recording, trial: Trial, channel: str) -> tuple[StepResponse, ...]:
    if not trial.signal.edges:
        raise NotScored("the signal has no edge")
    data = samples(recording, trial, channel)
    line = timeline(recording, trial)
    edges = edges_of(recording, trial)
    responses = []
    for number, edge in enumerate(edges):
        start = edges[number - 1].time if number else float(line.time[0])
        asked = trial.signal.edges[number]
        require_hold(line, edge, asked, trial.duration)
        response = _respond(line, data, edge, start, asked.time)
        if channel == trial.channel and (response.step > 0) != (edge.after > edge.before):
            raise NotScored(
                f"{channel} moves against the command (from {response.initial:.4g} "
                f"to {response.final:.4g} where {edge.before:.4g} to {edge.after:.4g} was asked)"
            )
        responses.append(response)
    return tuple(responses)


def require_hold(line: Timeline, edge: Edge, asked: Edge, trial_end: float) -> None:
    """Refuse to score a step of which the first half of the hold is not recorded whole.

    Args:
        line: of the recording. edge: as recorded. asked: the same edge as the trial has it.
        trial_end: s.

    Raises:
        NotScored: the recording ends before.
    """
    end = float(line.time[-1]) + line.period
    hold = min(asked.until, trial_end) - asked.time
    if edge.until >= end - 0.5 * line.period and end - edge.time < 0.5 * hold:
        raise NotScored(
            f"the recording ends {end - edge.time:.4g} s after the edge, "
            f"in the first half of its hold of {hold:.4g} s"
        )


def final_window(line: Timeline, edge: Edge) -> slice:
    """Return the samples of the end of an edge's hold."""
    return line.between(edge.until - FINAL_SHARE * (edge.until - edge.time), edge.until)


def initial_window(line: Timeline, edge: Edge, start: float) -> slice:
    """Return the samples before an edge, its own included: at an instant it cannot act yet."""
    length = min(0.5 * (edge.time - start), 0.25 * (edge.until - edge.time))
    last = line.between(edge.time - length, edge.time + 2e-3 * line.period)
    return last if last.stop > last.start else slice(max(last.stop - 1, 0), max(last.stop, 1))


def require_finite(line: Timeline, values: FloatArray, window: slice) -> None:
    """Raise NotScored, with the time of the recording, if a sample in the window has no value.

    Values whose squares are beyond the floating-point range count as none.
    """
    good = np.abs(values[window]) < LARGEST  # not so for NaN
    if not np.all(good):
        first = int(np.argmin(good))
        at = float(line.time[window][first]) + line.offset
        missing = int(np.count_nonzero(~good))
        value = float(values[window][first])
        what = f"as large as {value:.0e}" if math.isfinite(value) else "without a value"
        raise NotScored(f"{missing} sample(s) {what}, the first at {at:.6g} s")


def magnitude(values: FloatArray | ComplexArray) -> float:
    """Return the largest magnitude, or 0 where its square would be lost in underflow."""
    largest = float(np.max(np.abs(values), initial=0.0))
    return largest if largest > _SMALLEST else 0.0


def _respond(
    line: Timeline, channel: Samples, edge: Edge, start: float, asked: float
) -> StepResponse:
    before = initial_window(line, edge, start)
    end = final_window(line, edge)
    whole = slice(before.start, end.stop)
    if end.stop - before.stop < 3 or end.stop - end.start < 1:
        raise NotScored(f"{max(end.stop - before.stop, 0)} sample(s) in the hold after the edge")
    values = channel.values
    require_finite(line, values, whole)
    scale = magnitude(values[whole])
    if scale == 0.0:
        raise NotScored("no step: the response is zero throughout")
    data = values[whole] / scale  # so that differences of the largest numbers are finite
    origin = before.stop - 1 - before.start
    first, last = data[: origin + 1], data[end.start - before.start :]
    resolution = channel.resolution / scale
    tail = asymptote(last, math.hypot(white_noise(last), resolution / math.sqrt(12.0)))
    noise = _noise(data[origin:], first, last, resolution, tail is not None)
    low, high = level(first, noise), level(last, noise)
    final = high.value if tail is None else tail
    step = final - low.value
    floor = max(4.0 * math.sqrt(low.variance + high.variance), 2.0 * noise.sd, 1e-12)
    if not abs(step) > floor:
        raise NotScored(
            Note(
                "no step: the level changes by {step:.3g}, noise has a standard deviation of "
                "{noise:.3g}",
                step=step * scale,
                noise=noise.sd * scale,
            )
        )
    if abs(high.drift) > DRIFT * abs(step) + 3.0 * math.sqrt(high.drift_variance):
        raise NotSettled(
            Note(
                "not settled: the response still drifts by {drift:.1f} % of the step in the last "
                "{share:.0f} % of the hold",
                drift=100 * abs(high.drift / step),
                share=100 * FINAL_SHARE,
            )
        )
    rise = (data - low.value) / step
    _require_measured(line, channel, whole, rise, origin)
    unit = Noise(noise.autocovariance / step**2, noise.freedom, noise.slow)
    transit = _transit(rise[origin:], unit)
    sd = dithering((first, last), resolution)
    ahead = 0.0 if tail is None else abs(tail - high.value)
    budgets = [low.budget(resolution, sd), high.budget(resolution, sd)]
    if tail is not None:  # what still moves is predicted, not a drift
        budgets[1] = replace(high, drift=0.0).budget(resolution, sd)
        budgets[1] += between("settling drift", _PREDICTED * ahead)
    few = _samples_a_rise(rise[origin:])
    # what rests without noise stays exactly where it is, at no sensor's end
    noisy = float(np.ptp(first)) > _RESTING * abs(step)
    cut = {item.above for item in channel.clippings(whole) if item.left or noisy}
    return StepResponse(
        edge=edge,
        time=line.time[whole] - edge.time,
        rise=rise,
        origin=origin,
        initial=low.value * scale,
        step=step * scale,
        initial_budget=budgets[0].scaled(1.0 / step),
        final_budget=budgets[1].scaled(1.0 / step),
        noise=unit,
        resolution=abs(resolution / step),
        dither=abs(sd / step),
        calibration=(channel.uncertainty, channel.relative),
        smooth=smooth(rise, unit, _SMOOTHED, transit // 2),
        transit=transit,
        samples_a_rise=few,
        cut_above=(step > 0.0) in cut,
        cut_below=(step < 0.0) in cut,
        unseen=_unseen(line, edge, slice(before.start + origin, whole.stop), transit),
        slack=_slack(line, edge, asked),
        noted=lambda: (*_notes(line, rise, low, unit, ahead, few), *channel.notes(line, whole)),
    )


def _unseen(
    line: Timeline, edge: Edge, window: slice, transit: int
) -> tuple[tuple[float, float], ...]:
    """Return where samples are lost for as long as `transit` of them take, s since the edge."""
    return tuple(
        (start - edge.time, stop - edge.time)
        for start, stop in line.lost(window)
        if stop - start >= transit * line.period
    )


def _slack(line: Timeline, edge: Edge, asked: float) -> float:
    """Return how much earlier the edge may have been.

    In a foreign log, up to the sample before. The bench's own are on a clock that knows when the
    edge was asked for; where samples come at uneven times, the first that shows it may be later.
    """
    if not line.how and not line.irregular:
        return 0.0
    index = int(np.searchsorted(line.time, edge.time - 1e-3 * line.period))
    before = float(line.time[index - 1]) if index > 0 else edge.time - line.period
    return edge.time - (before if line.how else min(max(before, asked), edge.time))


def _require_measured(
    line: Timeline, channel: Samples, whole: slice, rise: FloatArray, origin: int
) -> None:
    """Raise NotScored if a sample without a value was filled while the response still moved."""
    missing = np.flatnonzero(channel.missing[whole])
    if missing.size == 0:
        return
    moving = np.flatnonzero(np.abs(rise - 1.0) > _AWAY)
    settled = int(moving[-1]) + 1 if moving.size else origin
    within = missing[(missing >= origin) & (missing <= settled)]
    if within.size:
        at = float(line.time[whole][int(within[0])]) + line.offset
        raise NotScored(
            f"{within.size} sample(s) without a value while the response moves, "
            f"the first at {at:.6g} s"
        )


def _noise(
    moving: FloatArray, first: FloatArray, last: FloatArray, resolution: float, decaying: bool
) -> Noise:
    """Return the noise of the settled windows; of a decaying tail only what is white in it.

    `moving` is everything from the edge on. Where a sensor's steps hide the noise at rest, they are
    the noise of what moves.
    """
    noise = held_noise(moving, [last], [first])
    if not noise.known:
        return noise
    if decaying:
        return Noise(np.array([white_noise(last) ** 2]), noise.freedom)
    rounding = resolution**2 / 12.0
    if noise.sd**2 < rounding:
        return Noise(np.array([rounding]), noise.freedom)
    return noise


def held_noise(
    held: FloatArray,
    last: list[FloatArray],
    others: list[FloatArray],
    beside: Sequence[FloatArray] = (),
) -> Noise:
    """Return the noise of settled windows; where it is slow, of the whole second half of the hold.

    `held` is everything from the edge on, `last` the end of it. A few of its own times of
    correlation tell little of a slow noise, and a short window does not show noise of 1 / f; what
    is read `beside` them is asked for that alone.
    """
    noise = estimate([*others, *last])
    if not noise.known:
        return noise
    latter = held[held.size // 2 :]
    most, steady = _ALIKE * noise.sd**2, _steady(latter)
    # a slow noise may by chance seem small at the end: of its means, all that is steady tells
    rest, end = [*others, *beside], [latter] if steady else last
    # what moves the end of a hold and nothing at rest is no noise: it still settles
    block = max(1, min((window.size for window in (*rest, *end)), default=0) // _PARTS)
    alike = _scatter(end, block) <= _ALIKE * _scatter(rest, block)
    settled = [*rest, *end] if alike else []
    if noise.flickers:
        return with_means(noise, settled)
    shown = estimate([*others, *beside, latter])
    if shown.flickers and shown.sd**2 <= most and steady:
        return with_means(shown, settled)
    if noise.slow < _FEW_SLOW:
        longer = estimate([*others, latter]) if beside else shown
        noise = longer if longer.sd**2 <= most else noise
    return with_means(noise, settled)


def _scatter(windows: Sequence[FloatArray], block: int) -> float:
    """Return the variance of windows' means over blocks about a line, 0 where there is none."""
    residuals = [detrended(means_over(window, block)) for window in windows if window.size]
    count = sum(residual.size for residual in residuals)
    return sum(float(residual @ residual) for residual in residuals) / max(count, 1)


def _steady(values: FloatArray) -> bool:
    """Return whether both halves of (n,) samples scatter alike: what still settles does not."""
    first, second = (detrended(half) for half in np.array_split(values, 2))
    return bool(first @ first <= _ALIKE * (second @ second))


def _transit(rise: FloatArray, noise: Noise) -> int:
    rough = smooth(rise, noise, 0.05, max(2, rise.size // 50)).values
    high = int(np.argmax(rough >= 0.75)) if np.any(rough >= 0.75) else rise.size - 1
    below = np.flatnonzero(rough[: high + 1] < 0.25)
    return max(high - int(below[-1]) if below.size else high, 1)


def _samples_a_rise(rise: FloatArray) -> float:
    """Return the sample periods from 10 to 90 %, by straight lines between samples."""
    places = []
    for share in (0.1, 0.9):
        index = int(np.argmax(rise >= share))
        if index == 0:
            return float(rise.size)
        before, after = float(rise[index - 1]), float(rise[index])
        places.append(index - 1 + (share - before) / (after - before))
    return places[1] - places[0]


def _notes(
    line: Timeline, rise: FloatArray, low: Level, noise: Noise, extrapolated: float, few: float
) -> tuple[str, ...]:
    notes = [line.how] if line.how else []
    if few < _FEW_A_RISE:
        notes.append(f"few samples: {few:.1f} from 10 to 90 % of the step")
    if low.samples < 4:
        notes.append(f"initial level from {low.samples} sample(s)")
    if not noise.known:
        notes.append("too few settled samples for an interval")
    if extrapolated > 0.0:
        notes.append("final level as predicted from its decaying tail")
    mode = histogram_levels(rise)[1]
    if noise.sd < 0.02 and abs(mode - 1.0) > 0.05:
        notes.append(f"by histogram (IEEE 181) the final level is {100 * mode:.0f} % of the step")
    return tuple(notes)
