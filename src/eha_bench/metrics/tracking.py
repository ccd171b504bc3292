"""Tracking error: reference minus measurement over the scored time."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray
from eha_bench.core.budget import Budget
from eha_bench.core.metric import Better, MetricSpec
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial
from eha_bench.metrics.coverage import NORMAL, type_a, type_b
from eha_bench.metrics.memo import remembered
from eha_bench.metrics.metric import Metric, NotScored, spec_of
from eha_bench.metrics.noise import white_noise
from eha_bench.metrics.one_sided import longest_loss, open_ended
from eha_bench.metrics.samples import samples
from eha_bench.metrics.step_response import require_finite
from eha_bench.metrics.window import timeline

_FAR = (1e3, 1e6)
"""How far beyond a sensor's end a reading is tried, in units of the largest value."""


@dataclass(frozen=True)
class TrackingError:
    """Reference minus measurement, over the scored time.

    Attributes:
        error: (n,) in units of `scale`.
        reference: (n,) in units of `scale`.
        period: time between samples, s.
        span: max - min of the reference, the time of settling included, in units of `scale`.
        scale: SI value of one.
        noise: standard deviation of the error's white part, in units of `scale`.
        how: where the reference comes from, for the reason of a score.
        offset: standard uncertainty of the sensor that all samples share, in units of `scale`.
        gain: the same as a share of the reading.
        cut: samples (n,) at the sensor's end and whether what was cut off lies above, for each end.
        lost: s, from to, where samples are lost.
    """

    error: FloatArray
    reference: FloatArray
    period: float
    span: float
    scale: float
    noise: float
    how: str
    offset: float = 0.0
    gain: float = 0.0
    cut: tuple[tuple[BoolArray, bool], ...] = ()
    lost: tuple[tuple[float, float], ...] = ()

    def sensor(self, weights: FloatArray) -> Budget:
        """Return what the sensor's calibration does to sum(weights * error), in SI."""
        readings = self.reference - self.error
        offset = self.offset * float(np.sum(weights))
        gain = self.gain * float(weights @ readings)
        return type_b("sensor", self.scale * math.hypot(offset, gain))

    def least(self) -> TrackingError:
        """Return the least error that readings may have had that the sensor's end cut off."""
        error = self.error.copy()
        for at, above in self.cut:
            # a reading that was higher leaves an error that is lower
            error[at] = np.minimum(error[at], 0.0) if above else np.maximum(error[at], 0.0)
        return replace(self, error=error, cut=())

    def beyond(self, far: float) -> TrackingError:
        """Return the error with readings that were cut off `far` beyond the sensor's end."""
        error = self.error.copy()
        for at, above in self.cut:
            error[at] -= far if above else -far
        return replace(self, error=error, cut=())


def tracking_error(recording: Recording, trial: Trial, channel: str) -> TrackingError:
    """Return the error of the channel that should follow the reference.

    Raises:
        NotScored: another channel, no sample in the scored time, or samples without a value.
        MissingChannelError: no such channel.
    """
    return remembered(
        recording, trial, ("tracking", channel), lambda: _error(recording, trial, channel)
    )


def _error(recording: Recording, trial: Trial, channel: str) -> TrackingError:
    data = samples(recording, trial, channel)
    values = data.values
    if channel != trial.channel:
        raise NotScored(f"{channel} is not what the reference asks for ({trial.channel} is)")
    line = timeline(recording, trial)
    window = line.between(0.0, trial.duration)
    count = window.stop - window.start
    if count < 2:
        raise NotScored("fewer than two samples in the scored time")
    end = float(line.time[-1]) + line.period
    if end < 0.5 * trial.duration:
        raise NotScored(f"the recording ends at {end:.4g} s of {trial.duration:.4g} s to score")
    require_finite(line, values, window)
    require_finite(line, line.reference, window)
    largest = max(
        float(np.max(np.abs(values[window]))), float(np.max(np.abs(line.reference[window])))
    )
    scale = largest or 1.0
    reference = line.reference[window] / scale
    error = reference - values[window] / scale
    commanded = line.reference[: window.stop] / scale
    span = float(np.ptp(commanded[np.isfinite(commanded)]))
    how = line.how if line.recorded else "reference as the trial defines it"
    if end < trial.duration - 0.5 * line.period:
        how = "; ".join(part for part in (how, f"recording ends at {end:.4g} s") if part)
    how = "; ".join(part for part in (how, *data.notes(line, window)) if part)
    return TrackingError(
        error,
        reference,
        line.period,
        span,
        scale,
        white_noise(error),
        how,
        data.uncertainty / scale,
        data.relative,
        tuple((item.at, item.above) for item in data.cut_off(window)),
        tuple(line.lost(window)),
    )


def _ends(found: Measure) -> tuple[float, float]:
    """Return the ends of a measure's interval, its value where it has none."""
    return (found.value, found.value) if math.isnan(found.high) else (found.low, found.high)


class TrackingMetric(Metric):
    """Scores every trial that has a reference to follow."""

    def applies(self, trial: Trial) -> bool:
        """Whether the signal lasts at all."""
        return trial.duration > 0.0

    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:
        """Return the value from the error over the scored time."""
        error = tracking_error(recording, trial, channel)
        found = self.of(error)
        if error.cut:
            found = self._open(found, error)
        reason = "; ".join(part for part in (found.reason, error.how) if part)
        return replace(found, reason=reason)

    def _open(self, found: Measure, error: TrackingError) -> Measure:
        """Return a measure that holds what the sensor's end hid: no error is too large for that."""
        low, _ = _ends(self.of(error.least()))
        (_, high), (_, farther) = (_ends(self.of(error.beyond(far))) for far in _FAR)
        grows = not farther <= high * (1.0 + 1e-6)
        now = _ends(found)
        return replace(
            found,
            low=min(now[0], low),
            high=math.inf if grows else max(now[1], high),
            reason=f"the sensor's end cut readings off; {found.reason}",
        )

    @abstractmethod
    def of(self, error: TrackingError) -> Measure:
        """Return the value from the error."""


def root_mean_square(error: TrackingError) -> Measure:
    """Return the RMS with the spread that white sensor noise gives it.

    Where samples are lost, errors may have been as large as the largest that was read.
    """
    values = error.error
    power = float(values @ values) / values.size
    clean = max(power - error.noise**2, 0.0)
    spread = math.sqrt((4.0 * clean * error.noise**2 + 2.0 * error.noise**4) / values.size)
    low, high = max(power - 1.96 * spread, 0.0), power + 1.96 * spread
    unread = sum(round((stop - start) / error.period) - 1 for start, stop in error.lost)
    high = (high * values.size + unread * float(np.max(values**2))) / (values.size + unread)
    value, low, high = (math.sqrt(part) * error.scale for part in (power, low, high))
    slope = values / (max(math.sqrt(power), 1e-300) * values.size)
    reason = "measured error, sensor noise included"
    if error.lost:
        reason += "; errors in lost samples taken as no larger than the largest that was read"
    found = Measure(value, low, high, reason)
    return with_sensor(found, error.sensor(slope))


def with_sensor(found: Measure, sensor: Budget) -> Measure:
    """Return a measure whose interval is that of its noise, with the sensor's calibration in it."""
    noise = type_a("noise", ((found.high - found.low) / (2.0 * NORMAL)) ** 2)
    own = NORMAL * sensor.standard
    return replace(
        found,
        low=max(found.value - math.hypot(found.value - found.low, own), 0.0),
        high=found.value + math.hypot(found.high - found.value, own),
        budget=(noise + sensor).merged(),
    )


class TrackingRms(TrackingMetric):
    """Root mean square of reference minus measurement, in the channel's unit."""

    spec = spec_of("tracking_rms")

    def of(self, error: TrackingError) -> Measure:
        """Return the RMS."""
        return root_mean_square(error)


class TrackingMax(TrackingMetric):
    """Largest magnitude of reference minus measurement, in the channel's unit."""

    spec = spec_of("tracking_max")

    def of(self, error: TrackingError) -> Measure:
        """Return the largest magnitude; the interval reaches as far as its sample's noise."""
        value = float(np.max(np.abs(error.error)))
        largest = error.noise * math.sqrt(2.0 * math.log(max(error.error.size, 2)))
        low, high = max(value - largest, 0.0), value + 1.96 * error.noise
        value, low, high = (part * error.scale for part in (value, low, high))
        at = int(np.argmax(np.abs(error.error)))
        weights = np.zeros(error.error.size)
        weights[at] = 1.0
        reason = "measured error, sensor noise included"
        found = with_sensor(Measure(value, low, high, reason), error.sensor(weights))
        return open_ended(found, 1.0, longest_loss(error.lost)) if error.lost else found


class TrackingNrmse(TrackingMetric):
    """RMS error over the span of the reference."""

    spec = spec_of("tracking_nrmse")

    def of(self, error: TrackingError) -> Measure:
        """Return RMS / (max - min of the reference)."""
        span = error.span * error.scale
        if not error.span > 1e-12:
            raise NotScored("the reference is constant: it has no span to normalise by")
        rms = root_mean_square(error)
        reason = "RMS over the span (max - min) of the reference"
        value, low, high = (part / span for part in (rms.value, rms.low, rms.high))
        return Measure(value, low, high, reason, rms.budget.scaled(1.0 / span))


class TrackingPercentile95(TrackingMetric):
    """The error's magnitude that 95 % of the samples keep, in the channel's unit."""

    spec = MetricSpec(
        "tracking_p95", "95th percentile of |reference - measurement|", None, better=Better.LOWER
    )
    by_default = False

    def of(self, error: TrackingError) -> Measure:
        """Return the percentile."""
        value = float(np.percentile(np.abs(error.error), 95.0)) * error.scale
        return Measure(value, reason="95 % of the samples are within it")
