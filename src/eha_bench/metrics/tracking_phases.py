"""Tracking error with its lag taken off, and apart for motion and rest of the reference."""

from __future__ import annotations

import math
from abc import abstractmethod

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from eha_bench.core.arrays import BoolArray, FloatArray
from eha_bench.core.metric import Better, MetricSpec
from eha_bench.core.score import Measure
from eha_bench.metrics.metric import NotScored
from eha_bench.metrics.tracking import TrackingError, TrackingMetric

_LONGEST = 0.25  # of the scored time: lags that are tried
_STILL = 1e-3  # of the fastest change: below it the reference rests


class TrackingLagCompensated(TrackingMetric):
    """RMS error left when the measurement is moved forward in time by its best lag."""

    spec = MetricSpec(
        "tracking_rms_lag_compensated",
        "tracking_rms at the best time lag",
        None,
        better=Better.LOWER,
    )
    by_default = False

    def of(self, error: TrackingError) -> Measure:
        """Return the least RMS over lags from 0 to a quarter of the scored time."""
        reference, measured = error.reference, error.reference - error.error
        longest = max(int(_LONGEST * reference.size), 1)
        tried = _rms_of_lags(reference, measured, longest)
        # a periodic reference fits again a period later: the first minimum as good as any
        low = tried <= float(tried.min()) + 0.05 * float(np.ptp(tried))
        first = int(np.argmax(low))
        end = first + (int(np.argmin(low[first:])) if not np.all(low[first:]) else low.size - first)
        best = first + int(np.argmin(tried[first:end]))
        at_best = reference[: reference.size - best] - measured[best:]
        found = [(math.sqrt(float(at_best @ at_best) / at_best.size), float(best))]
        for whole in range(max(best - 1, 0), min(best + 1, reference.size - 2)):
            found.append(_between_lags(reference, measured, whole))
        value, lag = min(found)
        reason = f"RMS after removing a lag of {lag * error.period:.4g} s"
        return Measure(value * error.scale, reason=reason)


def _between_lags(reference: FloatArray, measured: FloatArray, whole: int) -> tuple[float, float]:
    """Return the least RMS over lags from `whole` to `whole` + 1 samples, and the lag.

    With the measurement interpolated by straight lines, the rest is linear in the share of a
    sample, and its mean square a parabola.
    """
    here, next_one = measured[whole:-1], measured[whole + 1 :]
    rest, change = reference[: here.size] - here, next_one - here
    power = float(change @ change)
    share = min(max(float(rest @ change) / power, 0.0), 1.0) if power > 0.0 else 0.0
    rest -= share * change
    return math.sqrt(float(rest @ rest) / rest.size), whole + share


def _rms_of_lags(reference: FloatArray, measured: FloatArray, longest: int) -> FloatArray:
    """Return the RMS of reference[k] - measured[k + lag], lags 0 to `longest`, by correlation."""
    middle = 0.5 * (float(reference.mean()) + float(measured.mean()))
    r, m = reference - middle, measured - middle
    count = r.size
    lags = np.arange(longest + 1)
    size = next_fast_len(count + longest, real=True)  # further lags may wrap around
    together = irfft(rfft(m, size) * np.conj(rfft(r, size)), size)[: longest + 1]
    powers_r = np.concatenate([[0.0], np.cumsum(r * r)])[count - lags]
    powers_m = np.concatenate([[0.0], np.cumsum(m * m)])
    squares = powers_r + powers_m[count] - powers_m[lags] - 2.0 * together
    found: FloatArray = np.sqrt(np.maximum(squares, 0.0) / (count - lags))
    return found


class _PhaseMetric(TrackingMetric):
    """RMS error over the part of the scored time in which the reference moves, or rests."""

    by_default = False

    def of(self, error: TrackingError) -> Measure:
        """Return the RMS over that part."""
        change = np.abs(np.gradient(error.reference))
        moving = change > _STILL * float(change.max())
        part = error.error[self.counted_samples(moving)]
        if part.size < 8:
            raise NotScored(f"{part.size} sample(s) in this phase of the motion")
        value = math.sqrt(float(part @ part) / part.size)
        reason = f"RMS over {part.size} of {error.error.size} samples"
        return Measure(value * error.scale, reason=reason)

    @abstractmethod
    def counted_samples(self, moving: BoolArray) -> BoolArray:
        """Return which samples count."""


class TrackingMoving(_PhaseMetric):
    """RMS error while the reference moves."""

    spec = MetricSpec(
        "tracking_rms_moving", "tracking_rms while the reference moves", None, better=Better.LOWER
    )

    def counted_samples(self, moving: BoolArray) -> BoolArray:
        """Return the samples at which the reference changes."""
        return moving


class TrackingResting(_PhaseMetric):
    """RMS error while the reference rests."""

    spec = MetricSpec(
        "tracking_rms_resting", "tracking_rms while the reference rests", None, better=Better.LOWER
    )

    def counted_samples(self, moving: BoolArray) -> BoolArray:
        """Return the samples at which the reference does not change."""
        return ~moving
