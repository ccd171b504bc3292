"""The extreme of a noisy response, by a local polynomial that follows it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray
from eha_bench.metrics.local import LocalFit, fit, holds_around
from eha_bench.metrics.noise import LinearCovariance, Noise

_NARROWEST = 4
_WIDEST = 1.5  # transits
_NARROWER = 0.6  # of a window: what a cubic in it is compared with
_SMOOTH = 1.5  # second differences that the polynomial of a smooth response misses at most
_SAME = 3.0  # standard deviations that both may be apart, else the narrower counts


@dataclass(frozen=True)
class Peak:
    """The largest value of a response.

    Attributes:
        value: of the response.
        time: s.
        variance: of the value.
        earliest, latest: of the samples that it is taken from, s.
        between, between_times: how far interpolation may be off, of the value and, in s, of time.
        around: the polynomial it was found with; None where single samples tell.
    """

    value: float
    time: float
    variance: float
    earliest: float
    latest: float
    between: float = 0.0
    between_times: float = 0.0
    around: LocalFit | None = None

    @property
    def window(self) -> tuple[float, float]:
        """First and last time that it was found with, s; NaN where single samples tell."""
        local = self.around
        if local is None:
            return math.nan, math.nan
        return local.origin - local.scale, local.origin + local.scale

    def interval(self, noise: Noise) -> tuple[float, float]:
        """Return the 95 % interval of its time, s."""
        if self.around is None:
            return self.earliest, self.latest
        spread = noise.spread(self.around.operator)
        return _flat(self.around, self.time, spread, noise.quantile())


def peak(
    time: FloatArray, values: FloatArray, index: int, noise: Noise, transit: float, height: float
) -> Peak:
    """Return the maximum of a local polynomial around sample `index` of (n,) samples.

    `transit` is how many samples the response takes from 25 to 75 %, its own scale of time;
    `height` is roughly how far the peak rises above the level that it stands on.
    """
    half, missed = _half(noise, transit, height), 0.0
    while True:
        local, place = _around(time, values, index, half)
        if half <= _NARROWEST:
            if local.follows(noise):
                break
            # a corner: no polynomial follows it, and only the samples tell
            return _of_samples(time, values, index, noise)
        narrower = max(int(_NARROWER * half), _NARROWEST)
        other = fit(time, values, local.origin, narrower, 3)
        difference, sd = local.apart(other, place, noise)
        missed = math.sqrt(max(difference**2 - 2.0 * sd**2, 0.0))
        if abs(difference) <= _SAME * sd and local.follows(noise):
            break
        half = narrower
    local = local.robust(time, values, noise)
    value = local.value(place)
    spread = noise.spread(local.operator)
    at_place = np.array([place])
    variance = float(spread.variances(local.powers(at_place))[0])
    curvature = _curvature(local, place)
    if curvature < 0.0:
        # the maximum of a noisy parabola lies above the true one by this much on average
        excess = float(spread.variances(local.derivatives(at_place))[0]) / (-2.0 * curvature)
        excess = min(excess, math.sqrt(variance))
        value -= excess
        variance += 2.0 * excess**2  # the square of a normal slope varies as much
    return Peak(value, place, variance, place, place, missed, around=local)


def _around(time: FloatArray, values: FloatArray, index: int, half: int) -> tuple[LocalFit, float]:
    """Return the local cubic whose window follows the maximum near a sample, and its place."""
    centre = float(time[index])
    for _ in range(3):
        local = fit(time, values, centre, half, 3)
        grid = np.linspace(-0.9, 0.9, 181)
        heights = local.values(local.origin + grid * local.scale)
        best = float(grid[int(np.argmax(heights))])
        place = min(max(local.origin + best * local.scale, float(time[0])), float(time[-1]))
        if abs(best) < 0.2:
            break
        centre = place
    return local, place


def _of_samples(time: FloatArray, values: FloatArray, index: int, noise: Noise) -> Peak:
    """Return the maximum of the samples around sample `index`, and what noise makes of it."""
    start = max(index - _NARROWEST, 0)
    best = start + int(np.argmax(values[start : index + _NARROWEST + 1]))
    found = vertex(time, values, best, 0)
    around = slice(max(best - 1, 0), best + 2)
    return replace(
        found,
        variance=noise.sd**2,
        earliest=float(time[around][0]),
        latest=float(time[around][-1]),
    )


def _half(noise: Noise, transit: float, height: float) -> int:
    """Return the window in which a cubic misses less of a peak than its noise.

    By the sizes of noise and peak and by the response's speed, as for crossings: around the
    overshoot of a second order (T = 0.9 / omega_n) a cubic over h samples misses a tenth of the
    quartic term, about 0.0024 (h / T)^4 of the overshoot, and its noise is 1.1 sd / sqrt(h); the
    former may be a thirtieth of the latter.
    """
    half = (14.0 * noise.sd / max(height, noise.sd) * transit**4) ** (1.0 / 4.5)
    return int(min(max(half, _NARROWEST), max(_WIDEST * transit, _NARROWEST)))


def _flat(
    local: LocalFit, place: float, spread: LinearCovariance, quantile: float
) -> tuple[float, float]:
    """Return where around a place the slope may be zero (Fieller's interval)."""

    def reach(times: FloatArray) -> FloatArray:
        return quantile * np.sqrt(spread.variances(local.derivatives(times)))

    def flat(times: FloatArray) -> BoolArray:
        return np.asarray(np.abs(local.slopes(times)) <= reach(times))

    earliest, latest = holds_around(local, place, flat)
    curvature = _curvature(local, place)
    if curvature < 0.0:
        # flat up to the end of the window: the straight line of the slope goes on
        further = float(reach(np.array([place]))[0]) / -curvature
        if earliest <= local.origin - 0.999 * local.scale:
            earliest = min(earliest, place - further)
        if latest >= local.origin + 0.999 * local.scale:
            latest = max(latest, place + further)
    return earliest, latest


def _curvature(local: LocalFit, place: float) -> float:
    x = (place - local.origin) / local.scale
    coefficients = np.polynomial.polynomial.polyder(local.coefficients, 2)
    if coefficients.size == 0:
        return 0.0
    return float(np.polynomial.polynomial.polyval(x, coefficients)) / local.scale**2


def interpolated_peak(
    time: FloatArray, values: FloatArray, index: int, first: int, noise: Noise
) -> Peak:
    """Return the maximum between the samples around `index`, none before `first`, in noise."""
    found = vertex(time, values, index, first)
    half = min(2, index - max(first, 0), values.size - 1 - index)
    if half < 1:
        return replace(found, variance=noise.sd**2)
    around = slice(index - half, index + half + 1)
    scale = float(time[around][-1] - time[around][0])
    inverse = np.linalg.inv(np.vander((time[around] - found.time) / scale, increasing=True))
    value, slope, bend = inverse[0], inverse[1] / scale, 2.0 * inverse[2] / scale**2
    curvature = float(bend @ values[around])
    variance, turning = noise.variance(value), noise.variance(slope)
    if not curvature < 0.0:
        return replace(found, variance=variance)
    excess = min(turning / (-2.0 * curvature), math.sqrt(variance))
    reach = noise.quantile() * math.sqrt(turning) / -curvature
    return replace(
        found,
        value=found.value - excess,
        variance=variance + 2.0 * excess**2,
        earliest=found.time - reach,
        latest=found.time + reach,
    )


def vertex(time: FloatArray, values: FloatArray, index: int, first: int) -> Peak:
    """Return the maximum of the polynomial through the samples around `index` (no noise).

    Through five samples, none before `first`; it is off by about as much as the parabola through
    the nearest three is apart from it. Where there are no five, the parabola stands, and may be off
    by what it adds to the sample. At a corner (a limit that holds the response) no polynomial
    follows: the sample stands, and may be off by what the polynomial adds to it.
    """
    at = float(time[index])
    here = Peak(float(values[index]), at, 0.0, at, at)
    three = _vertex(time, values, index, 1)
    if three is None or not max(first, 0) <= index - 1 <= index + 1 < values.size:
        return here
    wide = max(first, 0) <= index - 2 and index + 2 < values.size
    five = _vertex(time, values, index, 2) if wide else None
    place, value = three if five is None else five
    away = (here.time, here.value) if five is None else three
    if wide and _is_at_a_corner(time, values, index, first):
        missed = max(value - here.value, abs(value - away[1]))
        return replace(here, between=missed, between_times=abs(place - at))
    return Peak(value, place, 0.0, place, place, abs(value - away[1]), abs(place - away[0]))


def _is_at_a_corner(time: FloatArray, values: FloatArray, index: int, first: int) -> bool:
    """Whether the polynomial through five samples misses the next ones by more than they bend.

    Of a smooth response it misses them by the fifth difference, a small part of the second. Around
    a corner differences do not fall with their order.
    """
    coefficients, scale = _through(time, values, index, 2)
    beside = np.array([k for k in (index - 3, index + 3) if max(first, 0) <= k < values.size], int)
    followed = np.polyval(coefficients, (time[beside] - time[index]) / scale)
    missed = np.abs(followed - (values[beside] - values[index]))
    bend = abs(values[index - 1] - 2.0 * values[index] + values[index + 1])
    return bool(np.any(missed > _SMOOTH * bend))


def _through(
    time: FloatArray, values: FloatArray, index: int, half: int
) -> tuple[FloatArray, float]:
    """Return the polynomial through 2 half + 1 samples, and its unit of time in s.

    Counted from sample `index`, in time and in value; the highest power first.
    """
    around = slice(index - half, index + half + 1)
    scale = float(time[index + 1] - time[index - 1])
    place = (time[around] - time[index]) / scale
    coefficients = np.linalg.solve(np.vander(place), values[around] - float(values[index]))
    return np.asarray(coefficients, dtype=np.float64), scale


def _vertex(
    time: FloatArray, values: FloatArray, index: int, half: int
) -> tuple[float, float] | None:
    """Return place and value of the maximum of the polynomial through 2 half + 1 samples."""
    if not half <= index < values.size - half:
        return None
    coefficients, scale = _through(time, values, index, half)
    place = (time[index - half : index + half + 1] - time[index]) / scale
    roots = np.roots(np.polyder(coefficients)) if np.any(coefficients[:-1] != 0.0) else np.zeros(0)
    real = roots[np.abs(roots.imag) < 1e-9].real
    real = real[(real >= place[half - 1]) & (real <= place[half + 1])]
    if real.size == 0:
        return None
    best = float(real[int(np.argmax(np.polyval(coefficients, real)))])
    height = float(np.polyval(coefficients, best))
    if height < 0.0:
        return None
    return float(time[index]) + best * scale, float(values[index]) + height
