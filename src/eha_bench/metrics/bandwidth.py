"""Bandwidth at -3 dB and at -90 degrees, and resonance, of a measured frequency response."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.budget import Budget
from eha_bench.core.metric import MetricSpec
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial
from eha_bench.metrics.band_interpolation import (
    CrossingCurve,
    crossing,
    extreme_between,
    first_below,
)
from eha_bench.metrics.coverage import reach, type_a
from eha_bench.metrics.frequency_response import (
    FrequencyResponse,
    excites_a_band,
    frequency_response,
)
from eha_bench.metrics.low_frequency import low_frequency_gain
from eha_bench.metrics.metric import Metric, NotScored, spec_of

_HALF_POWER = math.log(math.sqrt(0.5))  # -3 dB is half the power
_BEYOND = 1.0  # standard deviations from which on a largest gain at the end may be a resonance
_END = 2  # points that are the end: the last alone may be low by what rings on after a sweep


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
        notes += response.notes
        return replace(found, reason="; ".join(notes), budget=found.budget.merged())

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
        level, level_budget = low_frequency_gain(response)
        logs = np.log(np.maximum(response.gain, 1e-300)) - level
        spread = np.sqrt(response.relative_sd**2 + level_budget.variance)
        first = first_below(response, logs, _HALF_POWER, spread, "the gain has not fallen by 3 dB")
        inverse = np.exp(-2.0 * logs)
        curve = CrossingCurve(
            2.0 - inverse, 2.0 * response.relative_sd * inverse, level_budget.scaled(4.0)
        )
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
        curve = CrossingCurve(inverse.real, sd * np.abs(inverse))
        return crossing(response, curve, first, "phase lag of 90 deg, local cubic in f²")


class ResonancePeak(BandMetric):
    """Largest gain over that at low frequency, a ratio; 1 where there is no resonance.

    Interpolated is 1 / |G|^2 over f^2, as for the bandwidth.
    """

    spec = MetricSpec("resonance_peak", "largest gain over the gain at low frequency")

    def of(self, response: FrequencyResponse) -> Measure:
        """Return the largest gain, between the points where they have a maximum there."""
        level, level_budget = low_frequency_gain(response)
        found = _resonance(response)
        if found is None:
            index = int(np.argmax(response.gain))
            sd = float(np.nan_to_num(response.relative_sd[index]))
            log = math.log(float(response.gain[index]))
            own = type_a("noise", sd**2, response.points[index].freedom)
            spread = math.hypot(sd, level_budget.standard)
            if index >= response.frequency.size - _END and log - level > _BEYOND * spread:
                raise NotScored(
                    f"the largest gain is at {response.frequency[index]:.4g} Hz, the end of what "
                    "can be relied upon: a resonance may lie beyond, or it is none"
                )
            reason = f"largest measured gain, at {response.frequency[index]:.4g} Hz"
        else:
            log, own = math.log(found.gain), found.relative
            reason = f"largest gain, at {found.frequency:.4g} Hz, local cubic of 1/gain² in f²"
        value = math.exp(log - level)
        budget = (own + level_budget).scaled(value)
        half = reach(budget)
        # 0 Hz counts as well: nothing is below 1 (written so that NaN stays NaN)
        value, low, high = (
            part if not part < 1.0 else 1.0 for part in (value, value - half, value + half)
        )
        return Measure(value, low, high, reason, budget)


class ResonanceFrequency(BandMetric):
    """Frequency in Hz at which the gain is largest, where it rises above that at low frequency."""

    spec = MetricSpec("resonance_frequency", "where the gain is largest", "Hz")
    by_default = False

    def of(self, response: FrequencyResponse) -> Measure:
        """Return the place of the maximum between the points."""
        level, level_budget = low_frequency_gain(response)
        found = _resonance(response)
        if found is None:
            raise NotScored(
                "no resonance: the largest gain is at "
                f"{'the lowest' if np.argmax(response.gain) == 0 else 'the highest'} frequency "
                "that can be relied upon"
            )
        spread = (found.relative + level_budget).standard
        if math.log(found.gain) - level < 2.0 * spread:
            raise NotScored("no resonance: the gain does not rise beyond its noise")
        half = reach(found.place)
        low, high = found.frequency - half, found.frequency + half
        reason = "largest gain, local cubic of 1/gain² in f²"
        return Measure(found.frequency, low, high, reason, found.place)


@dataclass(frozen=True)
class _Resonance:
    """A maximum of the gain: Hz with what moves it, gain with what moves it as a share of it."""

    frequency: float
    place: Budget
    gain: float
    relative: Budget


def _resonance(response: FrequencyResponse) -> _Resonance | None:
    """Return the maximum between the points; None where the largest gain is at an end of them."""
    index = int(np.argmax(response.gain))
    if not 0 < index < response.frequency.size - 1:
        return None
    size = float(response.gain[index])
    inverse = (size / np.maximum(response.gain, 1e-300)) ** 2
    curve = CrossingCurve(inverse, 2.0 * response.relative_sd * inverse)
    found = extreme_between(response, curve, index)
    if found is None:
        return None
    return _Resonance(
        frequency=found.frequency,
        place=found.place,
        gain=size / math.sqrt(found.value),
        relative=found.height.scaled(0.5 / found.value),
    )
