"""Bandwidth at -3 dB and at -90 degrees, and resonance, of a measured frequency response."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.metric import MetricSpec
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial
from eha_bench.metrics.band_interpolation import (
    Curve,
    band_quantile,
    crossing,
    extreme_between,
    first_below,
    point_weights,
)
from eha_bench.metrics.frequency_response import (
    FrequencyResponse,
    excites_a_band,
    frequency_response,
)
from eha_bench.metrics.metric import Metric, NotScored, spec_of

FloatArray = NDArray[np.float64]

_HALF_POWER = math.log(math.sqrt(0.5))  # -3 dB is half the power
_LOW_BAND = 2.5  # times the lowest frequency: what the gain at 0 Hz is extrapolated from


class BandMetric(Metric):
    """Scores trials whose signal excites a band of frequencies."""

    def applies(self, trial: Trial) -> bool:
        """Whether the signal is a stepped sine, a sweep, or periodic."""
        return excites_a_band(trial)

    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:
        """Return the value from the frequency response."""
        response = frequency_response(recording, trial, channel)
        found = self.of(response)
        notes = [found.reason, f"{response.method}, {len(response.points)} frequencies"]
        if response.left_out:
            frequency, reason = response.left_out[0]
            notes.append(
                f"{len(response.left_out)} left out, the first at {frequency:.4g} Hz: {reason}"
            )
        if response.how:
            notes.append(response.how)
        return Measure(found.value, found.low, found.high, "; ".join(notes))

    @abstractmethod
    def of(self, response: FrequencyResponse) -> Measure:
        """Return the value; `reason` holds the convention."""


class Bandwidth3dB(BandMetric):
    """Frequency in Hz at which the gain has fallen by 3 dB from that at low frequency.

    Interpolated is 1 / |G|^2 over f^2, which for poles without zeros is a polynomial.
    """

    spec = spec_of("bandwidth_3db")

    def of(self, response: FrequencyResponse) -> Measure:
        """Return the first crossing of half the power."""
        level, variance = low_frequency_gain(response)
        logs = np.log(np.maximum(response.gain, 1e-300)) - level
        spread = np.sqrt(response.relative_sd**2 + variance)
        first = first_below(response, logs, _HALF_POWER, spread, "the gain has not fallen by 3 dB")
        inverse = np.exp(-2.0 * logs)
        curve = Curve(2.0 - inverse, 2.0 * response.relative_sd * inverse, 16.0 * variance)
        reason = "3 dB below the gain at low frequency, local cubic of 1/gain² in f²"
        return crossing(response, curve, first, reason)


class Bandwidth90Deg(BandMetric):
    """Frequency in Hz at which the phase lag reaches 90 degrees.

    Interpolated is the real part of 1 / G over f^2, which for poles without zeros is a polynomial.
    """

    spec = spec_of("bandwidth_90deg")

    def of(self, response: FrequencyResponse) -> Measure:
        """Return the first crossing of -90 degrees."""
        what = "the phase lag has not reached 90 deg"
        sd = response.relative_sd
        first = first_below(response, response.phase, -0.5 * math.pi, sd, what)
        size = response.gain[first]
        inverse = size / response.response
        curve = Curve(inverse.real, sd * np.abs(inverse), 0.0)
        return crossing(response, curve, first, "phase lag of 90 deg, local cubic in f²")


class ResonancePeak(BandMetric):
    """Largest gain over that at low frequency, a ratio; 1 where there is no resonance.

    Interpolated is 1 / |G|^2 over f^2, as for the bandwidth.
    """

    spec = MetricSpec("resonance_peak", "largest gain over the gain at low frequency")

    def of(self, response: FrequencyResponse) -> Measure:
        """Return the largest gain, between the points where they have a maximum there."""
        level, variance = low_frequency_gain(response)
        found = _resonance(response)
        if found is None:
            index = int(np.argmax(response.gain))
            gain, sd = float(response.gain[index]), float(response.relative_sd[index])
            reason = f"largest measured gain, at {response.frequency[index]:.4g} Hz"
            quantile = band_quantile(response, np.array([index]))
        else:
            gain, sd, quantile = found.gain, found.relative_sd, found.quantile
            reason = f"largest gain, at {found.frequency:.4g} Hz, local cubic of 1/gain² in f²"
        value = gain * math.exp(-level)
        reach = quantile * math.hypot(sd, math.sqrt(variance)) * value
        # 0 Hz counts as well: nothing is below 1 (written so that NaN stays NaN)
        value, low, high = (
            part if not part < 1.0 else 1.0 for part in (value, value - reach, value + reach)
        )
        return Measure(value, low, high, reason)


class ResonanceFrequency(BandMetric):
    """Frequency in Hz at which the gain is largest, where it rises above that at low frequency."""

    spec = MetricSpec("resonance_frequency", "where the gain is largest", "Hz")
    by_default = False

    def of(self, response: FrequencyResponse) -> Measure:
        """Return the place of the maximum between the points."""
        level, variance = low_frequency_gain(response)
        found = _resonance(response)
        if found is None:
            raise NotScored(
                "no resonance: the largest gain is at "
                f"{'the lowest' if np.argmax(response.gain) == 0 else 'the highest'} frequency "
                "that can be relied upon"
            )
        spread = math.hypot(found.relative_sd, math.sqrt(variance))
        if math.log(found.gain) - level < 2.0 * spread:
            raise NotScored("no resonance: the gain does not rise beyond its noise")
        low, high = found.frequency - found.reach, found.frequency + found.reach
        return Measure(found.frequency, low, high, "largest gain, local cubic of 1/gain² in f²")


@dataclass(frozen=True)
class _Resonance:
    """A maximum of the gain: Hz with the reach of its 95 % interval, gain and its relative sd."""

    frequency: float
    reach: float
    gain: float
    relative_sd: float
    quantile: float


def _resonance(response: FrequencyResponse) -> _Resonance | None:
    """Return the maximum between the points; None where the largest gain is at an end of them."""
    index = int(np.argmax(response.gain))
    if not 0 < index < response.frequency.size - 1:
        return None
    size = float(response.gain[index])
    inverse = (size / np.maximum(response.gain, 1e-300)) ** 2
    curve = Curve(inverse, 2.0 * response.relative_sd * inverse, 0.0)
    found = extreme_between(response, curve, index)
    if found is None:
        return None
    return _Resonance(
        frequency=found.frequency,
        reach=found.reach,
        gain=size / math.sqrt(found.value),
        relative_sd=0.5 * found.sd / found.value,
        quantile=found.quantile,
    )


def low_frequency_gain(response: FrequencyResponse) -> tuple[float, float]:
    """Return the logarithm of the gain extrapolated to 0 Hz, and its variance.

    1 / |G|^2 is even in frequency: a line in f^2 through the points below 2.5 times the lowest one,
    at least three, or a parabola where they tell its bend. Where that leads far from the lowest
    point, the lowest point stands.
    """
    frequency, gain, sd = response.frequency, response.gain, response.relative_sd
    if response.left_out and response.left_out[0][0] < 0.5 * frequency[0]:
        raise NotScored(
            "the gain at low frequency is not known: "
            f"{response.left_out[0][0]:.4g} Hz is left out ({response.left_out[0][1]}), "
            f"the lowest frequency that can be relied upon is {frequency[0]:.4g} Hz"
        )
    first = float(np.log(max(float(gain[0]), 1e-300)))
    count = max(int(np.count_nonzero(frequency <= _LOW_BAND * frequency[0])), 3)
    if frequency.size < count or frequency[count - 1] > 6.0 * frequency[0]:
        return first, _known(float(sd[0]) ** 2)
    low = slice(0, count)
    inverse = (gain[0] / np.maximum(gain[low], 1e-300)) ** 2
    x = (frequency[low] / frequency[count - 1]) ** 2
    weights = point_weights(sd[low])
    first_variance = _known(float(2.0 * sd[0]) ** 2)
    for order in (2, 1):
        design = np.vander(x, order + 1, increasing=True)
        operator = np.linalg.pinv(design * weights[:, None]) * weights
        variance = _known(float(np.sum((operator[0] * 2.0 * sd[low] * inverse) ** 2)))
        if variance <= 2.0 * first_variance:  # the bend costs little where points are far apart
            break
    at_zero = float(operator[0] @ inverse)
    if abs(at_zero - 1.0) > 0.2 + 3.0 * math.sqrt(variance):
        return first, _known(float(sd[0]) ** 2)
    return first - 0.5 * math.log(at_zero), 0.25 * variance / at_zero**2


def _known(variance: float) -> float:
    return variance if math.isfinite(variance) else 0.0
