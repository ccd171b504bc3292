"""Local polynomials: the value of a noisy response around a place, with its variance.

The window is chosen by the intersection of confidence intervals of a lower order (Goldenshluger
and Nemirovski, Math. Methods of Statistics 6, 1997), and the value is then taken from a fit of a
higher order in that window, so that its bias is small against the interval that is reported
(robust bias correction: Calonico, Cattaneo and Farrell, JASA 113, 2018,
doi:10.1080/01621459.2017.1285776).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.ndimage import convolve1d

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray
from eha_bench.metrics.noise import Noise

_GROWTH = 1.3
_LARGEST = 4000
_TAILS = 2.5  # standard deviations up to which a sample counts in full
_ROUNDS = 8
_WELL = 1e6  # largest elements of normal equations and inverse: they lose no digits that matter
_FARTHEST = 3.0  # the same, of what a sample may say against a polynomial
UNDERSMOOTHED = 0.6
"""Share of the window in which a line is straight that a peak is sought in."""


@dataclass(frozen=True)
class Smooth:
    """A response smoothed by a moving parabola, to find places; values come from local fits.

    Attributes:
        values: (n,).
        sd: standard deviation of its noise.
        half: half-width of the window in samples (0: not smoothed).
    """

    values: FloatArray
    sd: float
    half: int


@cache
def _parabola(half: int) -> FloatArray:
    """Return the weights of a moving parabola over 2 half + 1 samples; they are asked for often."""
    from scipy.signal import savgol_coeffs  # slow to import

    return np.asarray(savgol_coeffs(2 * half + 1, 2))


@cache
def _basis(half: int) -> FloatArray:
    """Return orthogonal parabolas over 2 half + 1 samples, (2 half + 1, 3)."""
    return np.asarray(np.linalg.qr(_powers(np.linspace(-1.0, 1.0, 2 * half + 1), 3))[0])


def smooth(values: FloatArray, noise: Noise, target: float, widest: int) -> Smooth:
    """Return (n,) values smoothed until the noise is below `target`, or the window is `widest`."""
    half = 0
    deviation = noise.sd
    widest = min(widest, (values.size - 1) // 2)
    while deviation > target and half < widest:
        half = min(max(2, math.ceil(half * _GROWTH)), widest)
        if half < 2:
            half = 0
            break
        deviation = math.sqrt(noise.variance(_parabola(half)))
    if half < 2:
        return Smooth(values, noise.sd, 0)
    return Smooth(_smoothed(values, half), deviation, half)


def _smoothed(values: FloatArray, half: int) -> FloatArray:
    """Return what a moving parabola makes of (n,) values; at the ends, the first and last stay."""
    width = 2 * half + 1
    inside = convolve1d(values, _parabola(half), mode="constant")
    basis = _basis(half)
    inside[:half] = basis[:half] @ (basis.T @ values[:width])
    inside[-half:] = basis[-half:] @ (basis.T @ values[-width:])
    return np.asarray(inside)


@dataclass(frozen=True)
class LocalFit:
    """A polynomial through the samples around a place.

    Attributes:
        origin: time of the place, s.
        scale: half the window, s; the polynomial is in (t - origin) / scale.
        coefficients: ascending.
        operator: (order + 1, m): coefficients = operator @ samples.
        design: (m, order + 1) the weight of every coefficient in each sample.
        samples: (m,) that it was fitted to.
        first: index of the first sample in the window.
    """

    origin: float
    scale: float
    coefficients: FloatArray
    operator: FloatArray
    design: FloatArray
    samples: FloatArray
    first: int = 0

    def apart(self, other: LocalFit, time: float, noise: Noise) -> tuple[float, float]:
        """Return how far two polynomials are apart at a time, and the noise's share of it (sd)."""
        start = min(self.first, other.first)
        stops = (one.first + one.operator.shape[1] for one in (self, other))
        weights = np.zeros(max(stops) - start)
        at = np.array([time])
        for sign, one in ((1.0, self), (-1.0, other)):
            row = one.powers(at)[0] @ one.operator
            weights[one.first - start : one.first - start + row.size] += sign * row
        return self.value(time) - other.value(time), math.sqrt(noise.variance(weights))

    def robust(self, time: FloatArray, values: FloatArray, noise: Noise) -> LocalFit:
        """Return the polynomial that no single sample of the noise's tails bends.

        Samples count as no farther from it than 2.5 standard deviations (P. J. Huber, Annals of
        Mathematical Statistics 35, 1964, doi:10.1214/aoms/1177703732). Where it does not follow
        its samples, it stays as it is: they are right and it is wrong.
        """
        if not noise.sd > 0.0 or not self.follows(noise):
            return self
        window = slice(self.first, self.first + self.operator.shape[1])
        design = self.powers(time[window])
        coefficients, bound = self.coefficients, _TAILS * noise.sd
        for _ in range(_ROUNDS):
            fitted = design @ coefficients
            away = values[window] - fitted
            if np.max(np.abs(away)) <= bound:
                break
            coefficients = self.operator @ (fitted + np.clip(away, -bound, bound))
        return replace(self, coefficients=coefficients)

    def follows(self, noise: Noise) -> bool:
        """Return whether it leaves no more of its samples than noise would (4 sd of chi^2).

        One sample in the tails of the noise is no reason to doubt it.
        """
        free = self.operator.shape[1] - self.coefficients.size
        correlation = noise.autocovariance / max(noise.sd**2, 1e-300)
        spread = math.sqrt(2.0 * free * (2.0 * float(correlation @ correlation) - 1.0))
        rest = self.samples - self.design @ self.coefficients
        left = float(np.sum(np.minimum(rest**2, (_FARTHEST * noise.sd) ** 2)))
        return bool(left <= noise.sd**2 * (free + 4.0 * spread))

    def value(self, time: float) -> float:
        """Return the polynomial at `time` (s)."""
        return float(self.values(np.array([time]))[0])

    def values(self, times: FloatArray) -> FloatArray:
        """Return the polynomial at (k,) times."""
        found: FloatArray = self.powers(times) @ self.coefficients
        return found

    def slope(self, time: float) -> float:
        """Return its derivative at `time`, per s."""
        return float(self.slopes(np.array([time]))[0])

    def slopes(self, times: FloatArray) -> FloatArray:
        """Return its derivative at (k,) times, per s."""
        found: FloatArray = self.derivatives(times) @ self.coefficients
        return found

    def powers(self, times: FloatArray) -> FloatArray:
        """Return the weight of every coefficient in the value at (k,) times, (k, order + 1)."""
        return _powers((times - self.origin) / self.scale, self.coefficients.size)

    def derivatives(self, times: FloatArray) -> FloatArray:
        """Return the weight of every coefficient in the slope at (k,) times, (k, order + 1)."""
        found = np.zeros((times.size, self.coefficients.size))
        orders = np.arange(1, self.coefficients.size)
        found[:, 1:] = self.powers(times)[:, :-1] * orders / self.scale
        return found


def _powers(places: FloatArray, count: int) -> FloatArray:
    """Return the first powers of (k,) places from 0 on, (k, count); `numpy.vander` is slower."""
    found = np.ones((places.size, count))
    for order in range(1, count):
        np.multiply(found[:, order - 1], places, out=found[:, order])
    return found


def _inverse(design: FloatArray) -> FloatArray:
    """Return the pseudo-inverse of a polynomial's design (n, k), places between -1 and 1.

    By the normal equations, many times as fast as by singular values, and as good: of a cubic over
    a window their condition is some thousands. Where there are too few places they are singular.
    """
    squares = design.T @ design
    try:
        inverse = np.linalg.inv(squares)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(design), dtype=np.float64)
    # the largest of the squares is that of the constant
    if float(squares[0, 0]) * float(np.abs(inverse).max()) < _WELL:
        return np.asarray(inverse @ design.T, dtype=np.float64)
    return np.asarray(np.linalg.pinv(design), dtype=np.float64)


def _window(time: FloatArray, centre: float, half: int, order: int) -> slice:
    """Return the samples within `half` samples of `centre` (s), at least order + 1 of them."""
    index = int(time.searchsorted(centre))
    first, last = max(0, index - half), min(time.size, index + half)
    while last - first < min(order + 1, time.size):
        first, last = max(0, first - 1), min(time.size, last + 1)
    return slice(first, last)


def fit(time: FloatArray, values: FloatArray, centre: float, half: int, order: int) -> LocalFit:
    """Fit the samples within `half` samples of `centre` (s), at least order + 1 of them."""
    window = _window(time, centre, half, order)
    stamps = time[window] - centre
    scale = max(abs(float(stamps[0])), abs(float(stamps[-1]))) or 1.0
    design = _powers(stamps / scale, min(order, stamps.size - 1) + 1)
    operator = _inverse(design)
    coefficients = operator @ values[window]
    return LocalFit(centre, scale, coefficients, operator, design, values[window], window.start)


def through(time: FloatArray, values: FloatArray, first: int) -> LocalFit:
    """Return the polynomial through all of (n,) samples, of which the first is number `first`."""
    origin, scale = 0.5 * float(time[0] + time[-1]), 0.5 * float(time[-1] - time[0])
    design = _powers((time - origin) / scale, time.size)
    operator = np.asarray(np.linalg.inv(design), dtype=np.float64)
    return LocalFit(origin, scale, operator @ values, operator, design, values, first)


def _line(
    time: FloatArray, values: FloatArray, centre: float, half: int
) -> tuple[float, FloatArray]:
    """Return the value at `centre` of a straight line through its window, and its weights."""
    window = _window(time, centre, half, 1)
    stamps = time[window] - centre
    middle = float(stamps.mean())
    away = stamps - middle
    power = float(away @ away)
    weights = np.full(away.size, 1.0 / away.size)
    if power > 0.0:
        weights -= middle / power * away
    return float(weights @ values[window]), weights


def half_width(
    time: FloatArray,
    values: FloatArray,
    centre: float,
    noise: Noise,
    widest: int,
    share: float = UNDERSMOOTHED,
) -> int:
    """Return the window in which a straight line is as good as the noise lets one see.

    It is `widest` unless the response bends before; then it is a `share` of what was chosen. That
    choice depends on the noise itself: a smaller window pays for it with a wider interval.
    """
    halves = _halves(max(min(widest, _LARGEST), 2))
    if noise.autocovariance.size == 1:
        estimates, weights = _lines(time, values, centre, halves)
        spreads = 2.0 * noise.sd * np.sqrt(weights)
        lows = np.maximum.accumulate(estimates - spreads)
        highs = np.minimum.accumulate(estimates + spreads)
        apart = np.flatnonzero(lows > highs)
        count = int(apart[0]) if apart.size else halves.size
    else:
        low, high, count = -math.inf, math.inf, halves.size
        for place, half in enumerate(halves.tolist()):
            estimate, own = _line(time, values, centre, half)
            spread = 2.0 * math.sqrt(noise.variance(own))
            low, high = max(low, estimate - spread), min(high, estimate + spread)
            if low > high:
                count = place
                break
    most = int(halves[-1])
    if count == halves.size:
        return most
    return min(max(2, round(share * int(halves[max(count - 1, 0)]))), most)


@cache
def _halves(widest: int) -> IndexArray:
    """Return the half-widths that are tried, from 2 samples on."""
    found = [2]
    while found[-1] < widest:
        found.append(min(max(found[-1] + 1, math.ceil(found[-1] * _GROWTH)), widest))
    return np.array(found)


def _lines(
    time: FloatArray, values: FloatArray, centre: float, halves: IndexArray
) -> tuple[FloatArray, FloatArray]:
    """Return the values at `centre` of straight lines through windows, and their squared weights.

    As `_line` does of one, by sums over all samples up to each.
    """
    index = int(np.searchsorted(time, centre))
    first = np.maximum(index - halves, 0)
    last = np.minimum(index + halves, time.size)
    start, stop = int(first[-1]), int(last[-1])
    if np.any(last - first < 2):
        single = [_line(time, values, centre, int(half)) for half in halves]
        return np.array([one[0] for one in single]), np.array([w @ w for _, w in single])
    stamps, read = time[start:stop] - centre, values[start:stop]
    sums = np.zeros((5, stop - start + 1))
    for row, terms in enumerate(
        (np.ones(stamps.size), stamps, stamps * stamps, read, stamps * read)
    ):
        np.cumsum(terms, out=sums[row, 1:])
    count, total, square, level, moment = sums[:, last - start] - sums[:, first - start]
    middle = total / count
    power = square - middle * total
    slope = np.where(power > 0.0, (moment - middle * level) / np.where(power > 0.0, power, 1.0), 0)
    shift = np.where(power > 0.0, middle**2 / np.where(power > 0.0, power, 1.0), 0.0)
    return level / count - middle * slope, 1.0 / count + shift


def holds_around(
    local: LocalFit, place: float, near: Callable[[FloatArray], BoolArray]
) -> tuple[float, float]:
    """Return how far from a place, within the window, a condition holds without a break."""
    ends = []
    for side in (-1.0, 1.0):
        edge = local.origin + side * local.scale
        if (edge - place) * side <= 0.0:
            ends.append(place)
            continue
        stamps = np.linspace(place, edge, 33)
        held = near(stamps[1:])
        if np.all(held):
            ends.append(edge)
            continue
        first = int(np.argmin(held))
        ends.append(_between(float(stamps[first]), float(stamps[first + 1]), near))
    return ends[0], ends[1]


def _between(yes: float, no: float, near: Callable[[FloatArray], BoolArray]) -> float:
    for _ in range(2):  # into 64 parts each: as fine as halving twelve times
        stamps = np.linspace(yes, no, 65)
        held = near(stamps[1:-1])
        first = 63 if np.all(held) else int(np.argmin(held))
        yes, no = float(stamps[first]), float(stamps[first + 1])
    return yes
