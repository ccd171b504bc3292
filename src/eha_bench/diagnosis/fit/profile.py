"""How well the cost itself determines a parameter, where a Jacobian cannot tell.

Friction that sticks makes the cost jump: a rod breaks away or does not. Near its minimum the cost
of a weak effect is rough, the fit ends in one of its pits, and slopes say more about the pit than
about the parameter. So the parameter is moved to both sides, the others following to first order,
until the cost has clearly risen, and a parabola is laid through what was found. Its curvature, its
scatter, and how far its bottom is from where the fit has ended make the standard deviation.

Source of profiles: Venzon, Moolgavkar, Appl. Statist. 37 (1988) 87, doi:10.2307/2347496.
"""

from __future__ import annotations

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.problem import Problem, soften

_RISEN = 9.0
"""Rise of the cost at which a parabola can be seen (three standard deviations)."""
_ROUGH = 4.0
_BEGIN = 1.5
_FEWEST, _MOST = 3, 9
_FEWEST_PLACES = 5
"""Costs that a parabola is laid through at least."""
_ALIKE = 2.0
"""Factor that two rises of the cost may differ by and still be the same: 1.4 in the interval."""
_PIT = 0.2
"""Share of an interval within which a cost is rough and no parabola."""
_SEARCHED = 6
"""Simulations to each side for the end of an interval."""


def profile_deviation(problem: Problem, fit: Fit, key: str, deviation: float) -> float:
    """Return a parameter's standard deviation by the profile of the cost, SI.

    Args:
        problem: what was fitted, at any step. fit: the end, with its Jacobian there.
        key: of what was fitted. deviation: by the Jacobian, SI: where to begin.
    """
    at = next(k for k, item in enumerate(fit.free) if item.key == key)
    item = fit.free[at]
    if not np.isfinite(deviation) or deviation <= 0.0:
        return deviation
    direction = _following(fit, at)
    places, costs = [0.0], [_cost(problem, fit, direction, 0.0)]
    width = _BEGIN * deviation / item.scale
    for doubling in range(1, _MOST + 1):
        for place in (-width, width):
            if item.low <= fit.vector[item.at] + place * item.scale <= item.high:
                places.append(place)
                costs.append(_cost(problem, fit, direction, place))
        enough = doubling >= _FEWEST and len(places) >= _FEWEST_PLACES
        risen = min(costs[-2:]) - costs[0]
        if enough and risen > _RISEN + _ROUGH * _roughness(places, costs):
            break
        width *= 2.0
    if len(places) < _FEWEST_PLACES:
        return deviation
    places, costs = _near(places, costs)
    curvature, bottom, scatter = _parabola(places, costs)
    if curvature <= 0.0:
        return float("inf")
    spread = float(np.sqrt(np.mean(np.square(places))))
    # a scatter of the costs shifts the bottom of the parabola
    shift = scatter / (2.0 * curvature * spread * np.sqrt(len(places)))
    return float(np.sqrt(1.0 / curvature + shift**2 + bottom**2) * item.scale)


def cost_with(problem: Problem, fit: Fit, key: str, value: float) -> float:
    """Return the cost with a parameter at a value, the others following to first order.

    Args:
        problem: what was fitted. fit: the end. key: of what was fitted. value: SI.
    """
    at = next(k for k, item in enumerate(fit.free) if item.key == key)
    place = (value - fit.vector[fit.free[at].at]) / fit.free[at].scale
    return _cost(problem, fit, _following(fit, at), place)


def profile_interval(
    problem: Problem, fit: Fit, key: str, half: float
) -> tuple[float, float] | None:
    """Return a parameter's interval by the profile, None where it stays in the linear one.

    The cost has to rise by as much as a parabola of the Jacobian's curvature does over the linear
    interval, so that what is in that interval beyond noise is in this one as well. Where the cost
    rises sooner it may be rough, and the linear interval stands.

    Args:
        problem: what was fitted. fit: the end, with its Jacobian there.
        key: of what was fitted. half: of the linear interval, SI.
    """
    at = next(k for k, item in enumerate(fit.free) if item.key == key)
    item, value = fit.free[at], float(fit.vector[fit.free[at].at])
    if not np.isfinite(half) or half <= 0.0:
        return None
    direction = _following(fit, at)
    _, weight = soften(fit.residual, fit.soft)
    moved = (fit.jacobian @ direction) * weight
    wanted = float(moved @ moved) * (half / item.scale) ** 2
    # a fit ends in a pit of a rough cost: what it rises by next to it is not information
    beside = [_cost(problem, fit, direction, x * half / item.scale) for x in (-_PIT, _PIT)]
    base = max(_cost(problem, fit, direction, 0.0), 0.5 * sum(beside) - _PIT**2 * wanted)
    ends, alike = [], True
    for side in (-1.0, 1.0):
        bound = abs((item.low if side < 0.0 else item.high) - value)
        inner, outer, width = 0.0, np.inf, half
        for _ in range(_SEARCHED):
            place = min(width, bound)
            rise = _cost(problem, fit, direction, side * place / item.scale) - base
            ratio = rise / wanted
            if 1.0 / _ALIKE < ratio < _ALIKE or (place == bound and ratio < 1.0):
                break
            alike = False
            if ratio < 1.0:
                inner, width = place, 2.0 * place if np.isinf(outer) else 0.5 * (place + outer)
            else:
                outer, width = place, 0.5 * (inner + place)
        ends.append(value + side * min(width, bound))
    further = ends[0] < value - half or ends[1] > value + half
    return (ends[0], ends[1]) if further and not alike else None


def _following(fit: Fit, at: int) -> FloatArray:
    """Return how all parameters move, scaled, where one of them moves by 1."""
    _, weight = soften(fit.residual, fit.soft)
    weighted = fit.jacobian * weight[:, None]
    normal = weighted.T @ weighted
    others = [k for k in range(len(fit.free)) if k != at]
    direction = np.zeros(len(fit.free))
    direction[at] = 1.0
    if others:
        direction[others] = -np.linalg.lstsq(
            normal[np.ix_(others, others)], normal[others, at], rcond=1e-10
        )[0]
    return direction


def _cost(problem: Problem, fit: Fit, direction: FloatArray, place: float) -> float:
    vector = fit.vector.copy()
    for item, share in zip(fit.free, direction, strict=True):
        value = vector[item.at] + place * share * item.scale
        vector[item.at] = min(max(value, item.low), item.high)
    soft, _ = soften(problem.residual(vector), fit.soft)
    return float(soft @ soft)


def _roughness(places: list[float], costs: list[float]) -> float:
    """Return by how much the cost falls again on its way up, to either side.

    A smooth cost only rises, as a parabola or steeper where others follow badly.
    """
    drops = [0.0]
    for side in (-1.0, 1.0):
        way = sorted((abs(p), c) for p, c in zip(places, costs, strict=True) if p * side >= 0.0)
        heights = np.array([cost for _, cost in way])
        drops.append(float(np.max(np.maximum.accumulate(heights) - heights)))
    return max(drops)


def _near(places: list[float], costs: list[float]) -> tuple[list[float], list[float]]:
    """Return the places, and their costs, up to where the cost stands out from its roughness.

    Further off a smooth cost bends away from the parabola that it is near its bottom.
    """
    risen = _RISEN + _ROUGH * _roughness(places, costs)
    distances = sorted({abs(place) for place in places})
    for distance in distances:
        inside = [k for k, place in enumerate(places) if abs(place) <= distance]
        ends = [costs[k] - costs[0] for k in inside if abs(places[k]) == distance]
        if len(inside) >= _FEWEST_PLACES and min(ends) > risen:
            return [places[k] for k in inside], [costs[k] for k in inside]
    return places, costs


def _parabola(places: list[float], costs: list[float]) -> tuple[float, float, float]:
    """Return the curvature, the place of the bottom, and the scatter of the costs about it."""
    unit = max(abs(place) for place in places)
    x = np.array(places) / unit
    y = np.array(costs) - costs[0]
    factors = np.polyfit(x, y, 2)
    scatter = float(np.sqrt(np.sum((np.polyval(factors, x) - y) ** 2) / max(1, x.size - 3)))
    if factors[0] <= 0.0:
        return 0.0, 0.0, scatter
    bottom = -0.5 * factors[1] / factors[0]
    return float(factors[0] / unit**2), float(bottom * unit), scatter
