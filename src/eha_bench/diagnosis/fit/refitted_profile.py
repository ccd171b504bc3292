"""The interval of an effect's strength by its profile likelihood, all other numbers fitted again.

A linear interval of a strength may hold the value at which the effect is off although data without
the effect cannot be fitted at all: where a strength and a phase stand for two amplitudes, or a
strength and a shape for a curve, moving the strength alone to its end is no way that the data
allow. So the strength is held at places on either side, everything else is fitted again there, and
the interval ends where the cost has risen by as much as its 95 % level asks (Venzon, Moolgavkar,
Appl. Statist. 37 (1988) 87, doi:10.2307/2347496; Hauck, Donner, J. Am. Stat. Assoc. 72 (1977) 851,
doi:10.1080/01621459.1977.10479969).
"""

from __future__ import annotations

import math

from eha_bench.diagnosis.fit.least_squares import Fit, Free, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem

_HALVINGS = 6
"""Times a strength is halved, or doubled, in search of an end."""
_ITERATIONS = 6


def strength_interval(
    problem: Problem, fit: Fit, key: str, neutral: float, rise: float
) -> tuple[float, float] | None:
    """Return the 95 % interval of a strength, None where the data do not tell it from nothing.

    Args:
        problem: what was fitted. fit: its end. key: of the strength.
        neutral: strength at which the effect is off. rise: of the cost at the interval's ends.
    """
    item = next(free for free in fit.free if free.key == key)
    profile = _Profile(problem, fit, item)
    size = float(fit.vector[item.at]) - neutral
    if size == 0.0 or profile.rise_at(neutral, fit) < rise:
        return None
    limits = (item.low - neutral, item.high - neutral)
    ends = []
    for factor in (0.5, 2.0):
        inner, outer, below, above = 1.0, factor, 0.0, 0.0
        near = fit
        for _ in range(_HALVINGS):
            there = min(max(outer * size, limits[0]), limits[1])
            above = profile.rise_at(neutral + there, near)
            if above >= rise or there != outer * size:
                break
            inner, outer, below, near = outer, outer * factor, above, profile.last
        ends.append(neutral + size * _between(inner, outer, below, above, rise))
    low, high = sorted(ends)
    return max(low, item.low), min(high, item.high)


class _Profile:
    """The least cost at each strength.

    Attributes:
        last: fit at the strength that was asked for last.
    """

    def __init__(self, problem: Problem, fit: Fit, item: Free) -> None:
        self._problem, self._item = problem, item
        self._others = tuple(free for free in fit.free if free is not item)
        own = levenberg_marquardt(
            problem, fit.vector, fit.free, iterations=_ITERATIONS, known=fit.columns, refresh=0
        )
        self._least = own.cost
        self.last = own

    def rise_at(self, value: float, near: Fit) -> float:
        """Return by how much the cost is above its least with the strength at a value.

        Args:
            value: SI. near: fit from which the others begin.
        """
        vector = near.vector.copy()
        vector[self._item.at] = value
        self.last = levenberg_marquardt(
            self._problem, vector, self._others, iterations=_ITERATIONS, refresh=1
        )
        return self.last.cost - self._least


def _between(inner: float, outer: float, below: float, above: float, rise: float) -> float:
    """Return where the cost has risen by `rise`, along a parabola through two places."""
    if above <= rise:
        return outer
    root_below, root_above = math.sqrt(max(below, 0.0)), math.sqrt(above)
    share = (math.sqrt(rise) - root_below) / (root_above - root_below)
    return inner + share * (outer - inner)
