"""Bandwidth at -3 dB and at -90 degrees, and resonance, of a measured frequency response."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from eha_bench.core.metric import MetricSpec
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial
from eha_bench.metrics.frequency_response import (
    FrequencyResponse,
    excites_a_band,
    frequency_response,
)
from eha_bench.metrics.metric import Metric, NotScored, spec_of

FloatArray = NDArray[np.float64]

_HALF_POWER = math.log(math.sqrt(0.5))  # -3 dB is half the power
_REACH = math.log(1.6)  # on either side of a place, in which a cubic follows the response
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
        first = _first_below(response, logs, _HALF_POWER, spread, "the gain has not fallen by 3 dB")
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
        first = _first_below(response, response.phase, -0.5 * math.pi, sd, what)
        size = response.gain[first]
        inverse = size / response.response
        curve = Curve(inverse.real, sd * np.abs(inverse), 0.0)
        return crossing(response, curve, first, "phase lag of 90 deg, local cubic in f²")


class ResonancePeak(BandMetric):
    """Largest gain over that at low frequency, a ratio; 1 where there is no resonance."""

    spec = MetricSpec("resonance_peak", "largest gain over the gain at low frequency")

    def of(self, response: FrequencyResponse) -> Measure:
        """Return the largest of the measured gains over the gain at low frequency."""
        level, variance = low_frequency_gain(response)
        index = int(np.argmax(response.gain))
        value = float(response.gain[index]) * math.exp(-level)
        sd = math.hypot(float(response.relative_sd[index]), math.sqrt(variance)) * value
        reach = _quantile(response, np.array([index])) * sd
        reason = f"largest measured gain, at {response.frequency[index]:.4g} Hz"
        return Measure(value, value - reach, value + reach, reason)


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
    weights = _weights(sd[low])
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


def _weights(sd: FloatArray) -> FloatArray:
    """Return weights of least squares; no point counts more than ten times another."""
    if not np.all(np.isfinite(sd)) or not np.any(sd > 0.0):
        return np.ones(sd.size)
    floor = 0.1 * float(np.max(sd))
    weights: FloatArray = floor / np.maximum(sd, floor)
    return weights


@dataclass(frozen=True)
class Curve:
    """What crosses zero downwards at the place sought.

    Attributes:
        values: (n,) at the response's frequencies.
        sd: (n,) standard deviations.
        common: variance that all values share.
    """

    values: FloatArray
    sd: FloatArray
    common: float


@dataclass(frozen=True)
class _Local:
    """A polynomial in f^2, in units of the guess's, around 1; `misfit` is chi^2 per freedom."""

    coefficients: FloatArray
    operator: FloatArray
    chosen: NDArray[np.intp]
    misfit: float = 1.0

    def value(self, x: FloatArray | float) -> FloatArray:
        return np.asarray(np.polynomial.polynomial.polyval(np.asarray(x) - 1.0, self.coefficients))

    def slope(self, x: float) -> float:
        derived = np.polynomial.polynomial.polyder(self.coefficients)
        return float(np.polynomial.polynomial.polyval(x - 1.0, derived))

    def weights(self, x: float) -> FloatArray:
        powers = (x - 1.0) ** np.arange(self.coefficients.size)
        row: FloatArray = powers @ self.operator
        return row


def _first_below(
    response: FrequencyResponse, curve: FloatArray, level: float, spread: FloatArray, what: str
) -> int:
    """Return the first point below a level that is not only noise; raises NotScored."""
    below = curve < level
    again = np.append(below[1:], True)  # the next point agrees, or there is none
    index = np.flatnonzero(below & (again | (curve + 2.0 * np.nan_to_num(spread) < level)))
    frequency = response.frequency
    if index.size == 0:
        raise NotScored(f"{what} up to {frequency[-1]:.4g} Hz, the highest that can be relied upon")
    if index[0] == 0:
        raise NotScored(
            f"it lies below {frequency[0]:.4g} Hz, the lowest frequency that can be relied upon"
        )
    return int(index[0])


def crossing(response: FrequencyResponse, curve: Curve, first: int, reason: str) -> Measure:
    """Return the frequency in Hz at which a curve falls below zero before point `first`."""
    squares = response.frequency**2
    before, after = curve.values[first - 1], curve.values[first]
    share = before / (before - after) if before > 0.0 > after else 0.5
    guess = float(squares[first - 1] + share * (squares[first] - squares[first - 1]))
    x = squares / guess
    sd = np.nan_to_num(curve.sd)
    local = _local(x, curve.values, sd)
    place = _root(local, float(x[first - 1]), float(x[first]))
    row = local.weights(place)
    variance = local.misfit * float(np.sum((row * sd[local.chosen]) ** 2)) + curve.common
    # relative error of the frequency: half that of its square
    slope = max(abs(local.slope(place)) * place, 1e-12)
    reach = 0.5 * _quantile(response, local.chosen) * math.sqrt(variance) / slope
    value = math.sqrt(guess * place)
    if not math.isfinite(reach) or reach > 3.0:
        return Measure(value, reason=reason)
    return Measure(value, value * math.exp(-reach), value * math.exp(reach), reason)


def _local(x: FloatArray, values: FloatArray, sd: FloatArray) -> _Local:
    """Fit a cubic to the points around 1: the nearest four, and more while they agree."""
    distance = np.abs(np.log(x))
    nearest = np.argsort(distance, kind="stable")
    within = int(np.count_nonzero(distance <= 2.0 * _REACH))
    count = min(4, x.size)
    best = _cubic(x, values, sd, np.sort(nearest[:count]))
    while count < within:
        count = min(max(count + 1, round(1.4 * count)), within)
        wider = _cubic(x, values, sd, np.sort(nearest[:count]))
        freedom = count - wider.coefficients.size
        rest = values[wider.chosen] - wider.value(x[wider.chosen])
        rest /= np.maximum(sd[wider.chosen], 1e-12)
        misfit = float(rest @ rest) / freedom
        if misfit > 1.0 + 2.0 * math.sqrt(2.0 / freedom):
            break
        best = replace(wider, misfit=max(misfit, 1.0))
    return best


def _cubic(x: FloatArray, values: FloatArray, sd: FloatArray, chosen: NDArray[np.intp]) -> _Local:
    order = min(3, chosen.size - 1)
    weights = _weights(sd[chosen])
    design = np.vander(x[chosen] - 1.0, order + 1, increasing=True)
    operator = np.linalg.pinv(design * weights[:, None]) * weights
    return _Local(operator @ values[chosen], operator, chosen)


def _root(local: _Local, low: float, high: float) -> float:
    """Return the root nearest to the guess, within an interval around the two points or 1."""
    if not np.any(local.coefficients[1:] != 0.0):
        return 1.0
    roots = np.roots(local.coefficients[::-1])
    real = roots[np.abs(roots.imag) < 1e-9].real + 1.0
    margin = high - low
    near = real[(real >= low - margin) & (real <= high + margin) & (real > 0.0)]
    return 1.0 if near.size == 0 else float(near[np.argmin(np.abs(near - 1.0))])


def _quantile(response: FrequencyResponse, chosen: NDArray[np.intp]) -> float:
    """Return Student's quantile for the points' variances taken together."""
    lowest = min(response.points[int(index)].freedom for index in chosen)
    return float(stdtrit(lowest, 0.975)) if lowest > 0.0 else math.nan
