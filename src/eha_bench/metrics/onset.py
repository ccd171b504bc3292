"""Where a response crosses a level that it comes to soon after it sets off all at once.

A dead time with a first-order lag behind it leaves a kink, and 5 % of the step lie a fraction of a
sample after it: no polynomial follows both sides. There the response is taken for

    r(t) = 0 before d,   b1 (x - c (1 - e^(-x / c))) + b2 x^2 + b3 x^3 with x = t - d from d on,

a corner at d that a lag c rounds, by least squares over everything from the edge to half of the
step. For every d and c the b are known in closed form, so these two alone are tried (variable
projection: G. Golub, V. Pereyra, doi:10.1088/0266-5611/19/2/201); the interval holds what any of
them says that leaves no more than the best does and 3.84 of the noise's variance (profile
likelihood: D. J. Venzon, S. H. Moolgavkar, Applied Statistics 37, 1988, doi:10.2307/2347496).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.metrics.coverage import NORMAL
from eha_bench.metrics.crossing import Crossing
from eha_bench.metrics.noise import Noise

_SURE = 2.0  # standard deviations that the slope at the start is from none, at least ...
SETS_OFF = 0.35
"""Share of its mean slope up to half of the step that a response sets off with at a corner ..."""
STOPS = 0.7
"""... and that it stops from, where a lag alone comes to its end ever more slowly."""
_FOLLOWS = 4.0  # standard deviations of chi^2 that the fit may leave more than noise
_PLACES = 24  # of the kink that are tried first, over all the time that it may lie in ...
_LAGS = np.concatenate(([0.0], np.geomspace(0.02, 1.0, 8)))  # of the time to half of the step
_SMOOTH = 0.2  # of the time from the edge to half of the step: no corner, what a lag rounds more
_ROWS = 9
_ZOOMS = 5
_NEARER = 0.5
_FEWEST = 7  # samples from the edge to half of the step
_REGULAR = 1e-12  # of the trace
_CORNERED = 1.4
"""What the variance grows by, by simulation: a corner between two samples is not a smooth function
of either, and what rounds it may be another curve than a lag's."""


def sudden_crossing(
    time: FloatArray,
    values: FloatArray,
    level: float,
    noise: Noise,
    latest: float,
    steepness: float = SETS_OFF,
) -> Crossing | None:
    """Return where a response that sets off all at once crosses a level; None where it does not.

    Args:
        time: (n,) s, from the edge to where half of the step is reached.
        values: (n,) normalised response, 0 before it sets off.
        level: that it crosses.
        noise: of `values`.
        latest: s, at which the level is surely crossed.
        steepness: slope at the corner that it has at least, of the mean slope up to half of the
            step.
    """
    if time.size < _FEWEST or not latest > float(time[0]):
        return None
    span = float(time[-1] - time[0])
    clock = (time - time[0]) / span
    places = np.linspace(0.0, min((latest - float(time[0])) / span, float(clock[-4])), _PLACES)
    coarse = _fitted(clock, values, places, np.zeros(_PLACES))
    corner = float(places[int(np.argmin(coarse.left))])
    for _ in range(3):  # finer and finer around the best
        width = float(places[1] - places[0])
        places = np.linspace(max(corner - width, 0.0), corner + width, 9)
        coarse = _fitted(clock, values, places, np.zeros(9))
        corner = float(places[int(np.argmin(coarse.left))])
    slopes = coarse.coefficients[int(np.argmin(coarse.left))]
    operator = np.asarray(np.linalg.pinv(_jacobian(clock, corner, slopes)), dtype=np.float64)
    spread = noise.spread(operator)
    own = math.sqrt(spread.variance(np.array([0.0, 1.0, 0.0, 0.0])))
    if slopes[0] < max(_SURE * own, steepness * 0.5 / max(1.0 - corner, 1e-9)):
        return None
    placed = np.array([1.0, 0.0, 0.0, 0.0])
    tried = _tried(clock, values, corner, math.sqrt(spread.variance(placed)))
    free = time.size - 5
    if float(tried.left.min()) > noise.sd**2 * (free + _FOLLOWS * _chi_spread(noise, free)):
        return None
    white = placed @ spread.white @ placed
    longer = max(spread.variance(placed) / max(float(white), 1e-300), 1.0)
    return tried.crossing(level, noise.sd**2 * longer, float(time[0]), span)


def _tried(clock: FloatArray, values: FloatArray, corner: float, width: float) -> _Fits:
    """Return fits of many corners, denser and denser around the best.

    `corner` is where a sharp one lies, known to `width`. Far behind, a rounded one looks like a
    sharp one that comes by its lag later.
    """
    lags = _LAGS * (1.0 - corner)
    apart = width * np.linspace(-5.0, 5.0, _ROWS) + 0.0 * lags[:, None]
    places = corner + apart + lags[:, None] * np.linspace(-0.5, 0.5, _ROWS)
    found: list[_Fits] = []
    reach_place, reach_lag = math.nan, math.nan
    for number in range(_ZOOMS):
        late, slow = (part.ravel() for part in np.broadcast_arrays(places, lags[:, None]))
        # nothing answers before it is asked
        found.append(_fitted(clock, values, np.maximum(late - slow, 0.0), slow))
        best = int(np.argmin(found[-1].left))
        at, lag = float(found[-1].starts[best] + slow[best]), float(slow[best])
        if number == 0:
            reach_place, reach_lag = 2.5 * width + 0.25 * lag, max(0.8 * lag, float(lags[1]))
        lags = np.maximum(lag + reach_lag * np.linspace(-1.0, 1.0, _ROWS), 0.0)
        # of a slower lag the corner comes earlier, or later
        places = at + reach_place * np.linspace(-1.0, 1.0, _ROWS) + 0.0 * lags[:, None]
        reach_place, reach_lag = reach_place * _NEARER, reach_lag * _NEARER
    return _Fits(
        *(
            np.concatenate([getattr(one, name) for one in found])
            for name in ("starts", "lags", "coefficients", "inverse", "left")
        )
    )


@dataclass(frozen=True)
class _Fits:
    """Fits of k corners.

    Attributes:
        starts, lags: (k,) where the response sets off, and what rounds the corner.
        coefficients: (k, 3).
        inverse: (k, 3, 3) of the normal equations.
        left: (k,) sums of squares that they leave.
    """

    starts: FloatArray
    lags: FloatArray
    coefficients: FloatArray
    inverse: FloatArray
    left: FloatArray

    def crossing(
        self, level: float, variance: float, origin: float, span: float
    ) -> Crossing | None:
        """Return where the best crosses a level, and how far the others that are likely differ.

        `variance` of the noise, larger where it is correlated; `origin` and `span`, s, of the
        clock.
        """
        likely = self.left <= float(self.left.min()) + NORMAL**2 * variance
        likely &= self.coefficients[:, 0] > 0.0
        best = int(np.argmin(np.where(likely, self.left, np.inf)))
        if not likely[best] or self.lags[best] > _SMOOTH:
            return None
        away = np.full(self.starts.size, level)
        away /= np.maximum(self.coefficients[:, 0], 1e-9)
        away += self.lags
        for _ in range(12):  # Newton
            columns, slopes = _columns(away, self.lags), _slopes(away, self.lags)
            height = np.sum(columns * self.coefficients, axis=-1)
            steep = np.sum(slopes * self.coefficients, axis=-1)
            away = np.clip(away - (height - level) / np.where(steep > 0.0, steep, np.inf), 0.0, 1.0)
        likely &= (np.abs(height - level) < 1e-6) & (steep > 0.0)
        if not likely[best]:
            return None
        places = self.starts + away
        place = float(places[best])
        apart = float(np.max(np.abs(places[likely] - place))) / NORMAL
        own = columns[best] @ self.inverse[best] @ columns[best] * variance
        slope = float(steep[best]) / span
        whole = _CORNERED * (float(own) + (apart * float(steep[best])) ** 2)
        return Crossing(origin + place * span, slope, whole, span=span)


def _fitted(clock: FloatArray, values: FloatArray, starts: FloatArray, lags: FloatArray) -> _Fits:
    """Fit (n,) values for each of (k,) corners."""
    design = _columns(np.maximum(clock - starts[:, None], 0.0), lags[:, None])
    transposed = np.swapaxes(design, 1, 2)
    normal = transposed @ design
    # of a corner behind the last samples they are singular; an inverse is much quicker than pinv
    size = np.trace(normal, axis1=1, axis2=2) + 1e-300
    normal += (_REGULAR * size)[:, None, None] * np.eye(3)
    inverse = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    coefficients = np.squeeze(inverse @ (transposed @ values)[..., None], -1)
    rest = values - np.squeeze(design @ coefficients[..., None], -1)
    return _Fits(starts, lags, coefficients, inverse, np.sum(rest**2, axis=1))


def _columns(x: FloatArray, lags: FloatArray) -> FloatArray:
    """Return the shapes that a response is made of, after a time, (..., 3)."""
    slow = np.maximum(lags, 1e-12)
    return np.stack((x + slow * np.expm1(-x / slow), x**2, x**3), axis=-1)


def _slopes(x: FloatArray, lags: FloatArray) -> FloatArray:
    slow = np.maximum(lags, 1e-12)
    return np.stack((-np.expm1(-x / slow), 2.0 * x, 3.0 * x**2), axis=-1)


def _jacobian(clock: FloatArray, corner: float, coefficients: FloatArray) -> FloatArray:
    """Return how (n,) values move with a sharp corner's place and with the coefficients, (n, 4)."""
    x = np.maximum(clock - corner, 0.0)
    none = np.zeros(x.size)
    moved = np.where(x > 0.0, -_slopes(x, none) @ coefficients, 0.0)
    return np.column_stack((moved, _columns(x, none)))


def _chi_spread(noise: Noise, free: int) -> float:
    correlation = noise.autocovariance / max(noise.sd**2, 1e-300)
    return math.sqrt(2.0 * free * (2.0 * float(correlation @ correlation) - 1.0))
