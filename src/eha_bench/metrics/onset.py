"""Where a response crosses a level close to a corner: it sets off, or stops, all at once.

A dead time with a first-order lag behind it leaves a kink, and 5 % of the step lie a fraction of a
sample after it: no polynomial follows both sides. There the response is taken for

    r(t) = 0 before d,   b1 (x - c (1 - e^(-x / c))) + b2 x^2 + b3 x^3 with x = t - d from d on,

a corner at d that a lag c rounds, by least squares over everything from the edge to half of the
step. A machine that moves as fast as it may stops all at once. What is missing to the end is, seen
backwards in time, x = d - t,

    1 - r(t) = b1 c e^(x / c) after d,   b1 (x + c) + b2 x^2 + b3 x^3 before.

For every d and c the b are known in closed form, so these two alone are tried (variable
projection: G. Golub, V. Pereyra, doi:10.1088/0266-5611/19/2/201); the interval holds what any of
them says that leaves no more than the best does and 3.84 of the noise's variance (profile
likelihood: D. J. Venzon, S. H. Moolgavkar, Applied Statistics 37, 1988, doi:10.2307/2347496).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.metrics.coverage import NORMAL
from eha_bench.metrics.crossing import Crossing
from eha_bench.metrics.noise import Noise

_SURE = 2.0  # standard deviations that the slope at the start is from none, at least
_FOLLOWS = 4.0  # standard deviations of chi^2 that the fit may leave more than noise
_PLACES = 24  # of the kink that are tried first, over all the time that it may lie in ...
_FIRST_LAGS = (0.0, 0.04, 0.1, 0.2, 0.4)  # ... with these lags on the clock: the last is none ...
_NEAR = np.linspace(-1.0, 1.0, 9)  # ... and around the best of them
_LAGS = np.concatenate(([0.0], np.geomspace(0.02, 1.0, 8)))  # of the time to half of the step
_SMOOTH = 0.2  # of the time from the edge to half of the step: no corner, what a lag rounds more
_ROWS = np.linspace(-1.0, 1.0, 9)
_ZOOMS = 5  # at least ...
_MOST_ZOOMS = 14
_LIKELY = 12  # ... and until so many of the 81 last tried are likely: they tell the interval
_NEARER = 0.5
_FEWEST = 7  # samples from the edge to half of the step
_REGULAR = 1e-12  # of the trace
_CORNERED = 1.4
"""What the variance grows by, by simulation: a corner between two samples is not a smooth function
of either, and what rounds it may be another curve than a lag's."""


class Shape(ABC):
    """What a response is made of around its corner, with the clock running away from the end level.

    Attributes:
        sharpest: slope at a sharp corner that it has at least, of the mean slope up to half of the
            step ...
        steepness: ... and, the same, of the line that is rounded there.
        later: by how many lags the corner seems to come later than it does, seen from far.
        before: how far before its corner it is looked at, on the clock.
    """

    sharpest: float
    steepness: float
    later: float
    before: float

    @abstractmethod
    def rounded_line(self, x: FloatArray, lags: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the straight line that a lag rounds, and its slope, at times since the corner."""

    def curve(
        self, x: FloatArray, lags: FloatArray, coefficients: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the responses of (k, 3) coefficients and their slopes, each at its time, (k,)."""
        line, slope = self.rounded_line(x, lags)
        after = np.maximum(x, 0.0)
        if not lags.any():
            line = after
        square, (first, second, third) = after * after, coefficients.T
        height = line * first + square * second + square * after * third
        return height, slope * first + 2.0 * after * second + 3.0 * square * third

    def columns(self, x: FloatArray, lags: FloatArray) -> FloatArray:
        """Return what a response is made of at times since its corner, (..., 3)."""
        found = np.empty((*x.shape, 3))
        after = np.maximum(x, 0.0)
        # an exponential is much slower than a product
        found[..., 0] = self.rounded_line(x, lags)[0] if lags.any() else after
        square = after * after
        found[..., 1] = square
        np.multiply(square, after, out=found[..., 2])
        return found

    def slopes(self, x: FloatArray, lags: FloatArray) -> FloatArray:
        """Return the derivatives of the columns."""
        after = np.maximum(x, 0.0)
        return np.stack((self.rounded_line(x, lags)[1], 2.0 * after, 3.0 * after**2), axis=-1)


class SetsOff(Shape):
    """A response that sets off with a corner: nothing before it."""

    sharpest = 0.35
    steepness = 0.35
    later = 1.0
    before = 0.0

    def rounded_line(self, x: FloatArray, lags: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what a lag makes of a line that begins."""
        slow, after = np.maximum(lags, 1e-12), np.maximum(x, 0.0)
        slope = -np.expm1(-after / slow)
        return after - slow * slope, slope


class ComesToRest(Shape):
    """A response that ends with a corner, seen backwards; a lag alone ends ever more slowly."""

    sharpest = 0.35
    steepness = 0.7
    later = -1.0
    before = 1.0

    def rounded_line(self, x: FloatArray, lags: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what a lag makes of a line that ends: it is behind it, and decays after it."""
        slow = np.maximum(lags, 1e-12)
        slope = np.exp(np.minimum(x, 0.0) / slow)
        return np.maximum(x, 0.0) + slow * slope, slope


@dataclass(frozen=True)
class Corner:
    """A corner that was found: fits of k corners, of which some are likely.

    Attributes:
        shape: what it was fitted by.
        starts, lags: (k,) where the response has its corner, and what rounds it, on the clock.
        coefficients: (k, 3).
        inverse: (k, 3, 3) of the normal equations.
        left: (k,) sums of squares that they leave.
        variance: of the noise, larger where it is correlated.
        origin, span: of the clock, s.
    """

    shape: Shape
    starts: FloatArray
    lags: FloatArray
    coefficients: FloatArray
    inverse: FloatArray
    left: FloatArray
    variance: float = 0.0
    origin: float = 0.0
    span: float = 1.0

    def crossing(self, level: float) -> Crossing | None:
        """Return where the best crosses a level, and how far the others that are likely differ."""
        likely = self.left <= float(self.left.min()) + NORMAL**2 * self.variance
        likely &= self.coefficients[:, 0] > 0.0
        best = int(np.argmin(np.where(likely, self.left, np.inf)))
        if not likely[best] or self.lags[best] > _SMOOTH:
            return None
        kept = np.flatnonzero(likely)
        lags, coefficients = self.lags[kept], self.coefficients[kept]
        away = level / np.maximum(coefficients[:, 0], 1e-9) + self.shape.later * lags
        for _ in range(12):  # Newton
            height, steep = self.shape.curve(away, lags, coefficients)
            step = (height - level) / np.where(steep > 0.0, steep, np.inf)
            before, away = away, np.minimum(np.maximum(away - step, -self.shape.before), 1.0)
            if np.array_equal(before, away):
                break
        height, _ = self.shape.curve(away, lags, coefficients)
        good = (np.abs(height - level) < 1e-6) & (steep > 0.0)
        mine = int(np.searchsorted(kept, best))
        if not good[mine]:
            return None
        places = self.starts[kept] + away
        place = float(places[mine])
        apart = float(np.max(np.abs(places[good] - place))) / NORMAL
        columns = self.shape.columns(away, lags)[mine]
        own = columns @ self.inverse[best] @ columns * self.variance
        whole = _CORNERED * (float(own) + (apart * float(steep[mine])) ** 2)
        slope = float(steep[mine]) / self.span
        return Crossing(self.origin + place * self.span, slope, whole, span=self.span)


def corner(
    time: FloatArray, values: FloatArray, noise: Noise, latest: float, shape: Shape
) -> Corner | None:
    """Return the corner of a response; None where it has none, or no such one.

    Args:
        time: (n,) s, from the edge to where half of the step is reached.
        values: (n,) normalised response, 0 before it sets off.
        noise: of `values`.
        latest: s, at which it has surely set off.
        shape: what it is looked for by.
    """
    if time.size < _FEWEST or not latest > float(time[0]):
        return None
    span = float(time[-1] - time[0])
    clock = (time - time[0]) / span
    places = np.linspace(0.0, min((latest - float(time[0])) / span, float(clock[-4])), _PLACES)
    width = float(places[1] - places[0])
    lags = np.repeat(_FIRST_LAGS, _PLACES)
    places = np.tile(places, len(_FIRST_LAGS))
    for finer in range(4):  # finer and finer around the best
        starts = np.maximum(places - shape.later * lags, 0.0)
        first = _fit_corners(clock, values, starts, lags, shape)
        best = int(np.argmin(first.left))
        place = float(starts[best] + shape.later * lags[best])
        slopes, mean = first.coefficients[best], 0.5 / max(1.0 - place, 1e-9)
        # far from the best place a slope is too small, but not by much
        if slopes[0] < shape.sharpest * mean * (0.5 if finer == 0 else 1.0):
            return None
        if lags[best] == _FIRST_LAGS[-1]:
            return None
        lags = np.full(_NEAR.size, lags[best])
        places = place + width * _NEAR
        width *= 0.25
    operator = np.asarray(np.linalg.pinv(_jacobian(clock, place, slopes, shape)), dtype=np.float64)
    spread = noise.spread(operator)
    if slopes[0] < _SURE * math.sqrt(spread.variance(np.array([0.0, 1.0, 0.0, 0.0]))):
        return None
    placed = np.array([1.0, 0.0, 0.0, 0.0])
    white = float(placed @ spread.white @ placed)
    variance = noise.sd**2 * max(spread.variance(placed) / max(white, 1e-300), 1.0)
    width = math.sqrt(spread.variance(placed))
    tried = _likely_corners(clock, values, place, width, variance, shape)
    free = time.size - 5
    left = np.concatenate([one.left for one in tried])
    if float(left.min()) > noise.sd**2 * (free + _FOLLOWS * _chi_spread(noise, free)):
        return None
    coefficients = np.concatenate([one.coefficients for one in tried])
    if coefficients[int(np.argmin(left)), 0] < shape.steepness * mean:
        return None
    return Corner(
        shape,
        np.concatenate([one.starts for one in tried]),
        np.concatenate([one.lags for one in tried]),
        coefficients,
        np.concatenate([one.inverse for one in tried]),
        left,
        variance,
        float(time[0]),
        span,
    )


def _likely_corners(
    clock: FloatArray,
    values: FloatArray,
    place: float,
    width: float,
    variance: float,
    shape: Shape,
) -> list[Corner]:
    """Return fits of many corners, denser and denser around the best, until several are likely.

    `place` is where a sharp one lies, known to `width` in noise of `variance`. Far behind, a
    rounded one looks like a sharp one that comes by its lag later.
    """
    lags = _LAGS * (1.0 - place)
    places = place + 5.0 * width * _ROWS + lags[:, None] * (0.5 * _ROWS)
    found: list[Corner] = []
    least = math.inf
    reach_place, reach_lag = math.nan, math.nan
    for number in range(_MOST_ZOOMS):
        late, slow = places.ravel(), np.repeat(lags, _ROWS.size)
        # nothing answers before it is asked
        found.append(
            _fit_corners(clock, values, np.maximum(late - shape.later * slow, 0.0), slow, shape)
        )
        left = found[-1].left
        best = int(left.argmin())
        least = min(least, float(left[best]))
        likely = np.count_nonzero(left <= least + NORMAL**2 * variance)
        if number + 1 >= _ZOOMS and likely >= _LIKELY:
            break
        lag = float(slow[best])
        at = float(found[-1].starts[best]) + shape.later * lag
        if number == 0:
            reach_place, reach_lag = 2.5 * width + 0.25 * lag, max(0.8 * lag, float(lags[1]))
        lags = np.maximum(lag + reach_lag * _ROWS, 0.0)
        # of a slower lag the corner comes earlier, or later
        places = at + reach_place * _ROWS + 0.0 * lags[:, None]
        reach_place, reach_lag = reach_place * _NEARER, reach_lag * _NEARER
    return found


def _fit_corners(
    clock: FloatArray, values: FloatArray, starts: FloatArray, lags: FloatArray, shape: Shape
) -> Corner:
    """Fit (n,) values for each of (k,) corners."""
    design = shape.columns(clock - starts[:, None], lags[:, None])
    transposed = np.swapaxes(design, 1, 2)
    normal = transposed @ design
    # of a corner behind the last samples they are singular; an inverse is much quicker than pinv
    diagonal = np.einsum("kii->ki", normal)
    diagonal += _REGULAR * (diagonal.sum(axis=1)[:, None] + 1e-300)
    inverse = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    coefficients = (inverse @ (transposed @ values)[..., None])[..., 0]
    rest = values - (design @ coefficients[..., None])[..., 0]
    rest *= rest
    return Corner(shape, starts, lags, coefficients, inverse, rest.sum(axis=1))


def _jacobian(
    clock: FloatArray, place: float, coefficients: FloatArray, shape: Shape
) -> FloatArray:
    """Return how (n,) values move with a sharp corner's place and with the coefficients, (n, 4)."""
    x = clock - place
    none = np.zeros(x.size)
    moved = np.where(x > 0.0, -shape.slopes(x, none) @ coefficients, 0.0)
    return np.column_stack((moved, shape.columns(x, none)))


def _chi_spread(noise: Noise, free: int) -> float:
    correlation = noise.autocovariance / max(noise.sd**2, 1e-300)
    return math.sqrt(2.0 * free * (2.0 * float(correlation @ correlation) - 1.0))
