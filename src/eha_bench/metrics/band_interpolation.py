"""Between the points of a frequency response: crossings and extremes by local cubics in f^2.

For poles without zeros 1 / |G|^2 and the real part of 1 / G are polynomials of f^2, and so is the
imaginary part of 1 / G over f: what is interpolated is nearly a polynomial, on a grid of any kind.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from eha_bench.core.arrays import FloatArray, IndexArray
from eha_bench.core.budget import UNSAID, Budget
from eha_bench.core.score import Measure
from eha_bench.metrics.coverage import between, reach, type_a
from eha_bench.metrics.frequency_response import FrequencyResponse
from eha_bench.metrics.metric import NotScored

_REACH = math.log(1.6)  # on either side of a place, in which a cubic follows the response


@dataclass(frozen=True)
class CrossingCurve:
    """What crosses zero downwards at the place sought.

    Attributes:
        values: (n,) at the response's frequencies.
        sd: (n,) standard deviations.
        common: uncertainty that all values share.
    """

    values: FloatArray
    sd: FloatArray
    common: Budget = UNSAID


@dataclass(frozen=True)
class Local:
    """A polynomial in x = f^2 / guess^2 around 1.

    Attributes:
        coefficients: (order + 1,), ascending, in x - 1.
        operator: (order + 1, m): coefficients = operator @ values of the points.
        chosen: (m,) points it was fitted to.
        misfit: chi^2 per degree of freedom, at least 1.
    """

    coefficients: FloatArray
    operator: FloatArray
    chosen: IndexArray
    misfit: float = 1.0

    def value(self, x: FloatArray | float) -> FloatArray:
        """Return the polynomial at x."""
        return np.asarray(np.polynomial.polynomial.polyval(np.asarray(x) - 1.0, self.coefficients))

    def slope(self, x: float) -> float:
        """Return its derivative at x."""
        derived = np.polynomial.polynomial.polyder(self.coefficients)
        return float(np.polynomial.polynomial.polyval(x - 1.0, derived))

    def bend(self, x: float) -> float:
        """Return its second derivative at x."""
        derived = np.polynomial.polynomial.polyder(self.coefficients, 2)
        return float(np.polynomial.polynomial.polyval(x - 1.0, derived)) if derived.size else 0.0

    def slope_weights(self, x: float) -> FloatArray:
        """Return the weight of every point in the slope at x, (m,)."""
        orders = np.arange(self.coefficients.size)
        powers = np.zeros(orders.size)
        powers[1:] = orders[1:] * (x - 1.0) ** (orders[1:] - 1)
        row: FloatArray = powers @ self.operator
        return row

    def weights(self, x: float) -> FloatArray:
        """Return the weight of every point in the value at x, (m,)."""
        powers = (x - 1.0) ** np.arange(self.coefficients.size)
        row: FloatArray = powers @ self.operator
        return row


def first_below(
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


def crossing(response: FrequencyResponse, curve: CrossingCurve, first: int, reason: str) -> Measure:
    """Return the frequency in Hz at which a curve falls below zero before point `first`."""
    squares = response.frequency**2
    before, after = curve.values[first - 1], curve.values[first]
    share = before / (before - after) if before > 0.0 > after else 0.5
    guess = float(squares[first - 1] + share * (squares[first] - squares[first - 1]))
    x = squares / guess
    sd = np.nan_to_num(curve.sd)
    local = local_cubic(x, curve.values, sd)
    place = _root(local, float(x[first - 1]), float(x[first]))
    row = local.weights(place)
    # relative error of the frequency: half that of its square
    half = 0.5 / max(abs(local.slope(place)) * place, 1e-12)
    variance = local.misfit * float(np.sum((row * sd[local.chosen]) ** 2))
    others = (_cubic(x, curve.values, sd, chosen) for chosen in _beside(local, x.size, first))
    at_place = [(other.chosen, other.weights(place)) for other in others]
    budget = (
        type_a("noise", variance, _freedom(response, local.chosen))
        + curve.common
        + between("interpolation", _disagreement(curve, sd, (local.chosen, row), at_place))
    ).scaled(half)
    value = math.sqrt(guess * place)
    own = reach(budget)
    if not math.isfinite(own) or own > 3.0:
        return Measure(value, reason=reason)
    low, high = value * math.exp(-own), value * math.exp(own)
    return Measure(value, low, high, reason, budget.scaled(value))


def _beside(local: Local, size: int, first: int) -> list[IndexArray]:
    """Return the points of the neighbouring cubics: one point to the left, or right."""
    found = []
    for start in (first - 3, first - 2, first - 1):
        if 0 <= start <= size - 4:
            chosen = np.arange(start, start + 4)
            if not np.array_equal(chosen, local.chosen):
                found.append(chosen)
    return found


Weights = tuple[IndexArray, FloatArray]
"""Points, and the weight of each in a value."""


def _disagreement(
    curve: CrossingCurve, sd: FloatArray, own: Weights, others: Sequence[Weights]
) -> float:
    """Return how far other cubics are from the one that is used, noise taken off."""

    def spread_out(chosen: IndexArray, weights: FloatArray) -> FloatArray:
        row = np.zeros(curve.values.size)
        row[chosen] = weights
        return row

    mine = spread_out(*own)
    rows = [spread_out(*other) for other in others]
    return max((apart(row, mine, curve.values, sd) for row in rows), default=0.0)


def apart(one: FloatArray, other: FloatArray, values: FloatArray, sd: FloatArray) -> float:
    """Return how far two linear functions of (n,) values are apart beyond what noise explains."""
    difference = one - other
    noise = float(np.sum((difference * sd) ** 2))
    return math.sqrt(max(float(difference @ values) ** 2 - 2.0 * noise, 0.0))


@dataclass(frozen=True)
class Minimum:
    """A minimum between points.

    Attributes:
        frequency: Hz; `place` is what moves it.
        value: of the curve there; `height` is what moves it.
    """

    frequency: float
    place: Budget
    value: float
    height: Budget


def extreme_between(
    response: FrequencyResponse, curve: CrossingCurve, index: int
) -> Minimum | None:
    """Return the minimum of a positive curve near point `index`, its least; None if it has none."""
    squares = response.frequency**2
    guess = float(squares[index])
    x = squares / guess
    sd = np.nan_to_num(curve.sd)
    bounds = float(x[index - 1]), float(x[index + 1])
    local = local_cubic(x, curve.values, sd)
    found = _lowest(local, bounds)
    if found is None:
        return None
    place, value = found

    def spread(row: FloatArray) -> float:
        return local.misfit * float(np.sum((row * sd[local.chosen]) ** 2))

    freedom = _freedom(response, local.chosen)
    height = type_a("noise", spread(local.weights(place)), freedom)
    shift = type_a("noise", spread(local.slope_weights(place)), freedom)
    shift = shift.scaled(1.0 / local.bend(place))
    # where the minimum lies, and how low, by the cubics through other points
    places, values = [], []
    for first in (index, index + 1):
        for chosen in _beside(local, x.size, first):
            other = _lowest(_cubic(x, curve.values, sd, chosen), bounds)
            if other is not None:
                places.append(abs(other[0] - place))
                values.append(abs(other[1] - value))
    noise_place, noise_value = 2.0 * shift.variance, 2.0 * height.variance
    moved = math.sqrt(max(max(places, default=0.0) ** 2 - 2.0 * noise_place, 0.0))
    raised = math.sqrt(max(max(values, default=0.0) ** 2 - 2.0 * noise_value, 0.0))
    frequency = math.sqrt(guess * place)
    return Minimum(
        frequency=frequency,
        place=(shift + between("interpolation", moved)).scaled(0.5 * frequency / place),
        value=value,
        height=height + between("interpolation", raised),
    )


def _lowest(local: Local, bounds: tuple[float, float]) -> tuple[float, float] | None:
    """Return place and value of the least minimum of a polynomial within bounds."""
    roots = np.roots(np.polynomial.polynomial.polyder(local.coefficients)[::-1])
    real = roots[np.abs(roots.imag) < 1e-9].real + 1.0
    real = real[(real > bounds[0]) & (real < bounds[1])]
    bends = [at for at in real.tolist() if local.bend(at) > 0.0]
    if not bends:
        return None
    place = min(bends, key=lambda at: float(local.value(at)))
    value = float(local.value(place))
    return (place, value) if value > 0.0 else None


def local_cubic(x: FloatArray, values: FloatArray, sd: FloatArray) -> Local:
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


def _cubic(x: FloatArray, values: FloatArray, sd: FloatArray, chosen: IndexArray) -> Local:
    order = min(3, chosen.size - 1)
    weights = point_weights(sd[chosen])
    design = np.vander(x[chosen] - 1.0, order + 1, increasing=True)
    operator = np.linalg.pinv(design * weights[:, None]) * weights
    return Local(operator @ values[chosen], operator, chosen)


def _root(local: Local, low: float, high: float) -> float:
    """Return the root nearest to the guess, within an interval around the two points or 1."""
    if not np.any(local.coefficients[1:] != 0.0):
        return 1.0
    roots = np.roots(local.coefficients[::-1])
    real = roots[np.abs(roots.imag) < 1e-9].real + 1.0
    margin = high - low
    near = real[(real >= low - margin) & (real <= high + margin) & (real > 0.0)]
    return 1.0 if near.size == 0 else float(near[np.argmin(np.abs(near - 1.0))])


def _freedom(response: FrequencyResponse, chosen: IndexArray) -> float:
    """Return the degrees of freedom of the points' variances taken together."""
    return min(response.points[int(index)].freedom for index in chosen)


def band_quantile(response: FrequencyResponse, chosen: IndexArray) -> float:
    """Return Student's quantile for the points' variances taken together."""
    lowest = _freedom(response, chosen)
    return float(stdtrit(lowest, 0.975)) if lowest > 0.0 else math.nan


def point_weights(sd: FloatArray) -> FloatArray:
    """Return weights of least squares; no point counts more than ten times another."""
    if not np.all(np.isfinite(sd)) or not np.any(sd > 0.0):
        return np.ones(sd.size)
    floor = 0.1 * float(np.max(sd))
    weights: FloatArray = floor / np.maximum(sd, floor)
    return weights
