"""Ranks every candidate by one simulation each: what would it gain?

The residual's change at a starting strength is projected off the sensitivities of what is
calibrated anyway, so that a candidate is credited only with what the parameters cannot do; then the
best amplitude within the strength's bounds gives the predicted fall of the cost. Predictions are a
fraction of what a refit gains, but their order holds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.candidates import Start
from eha_bench.diagnosis.fit.least_squares import Fit, calibrated_directions
from eha_bench.diagnosis.fit.problem import Problem, cost_of
from eha_bench.diagnosis.fit.side_by_side import side_by_side
from eha_bench.plants.layout import Layout
from eha_bench.plants.parameter import Parameter

_SHARES = (0.2, 1.0)
_ALIKE = 0.999
"""Cosine from which two starts are one."""
_STEPS = (1.12, 1.05)
"""Factors by which a setting is moved."""
_SMALLEST = 0.01
"""Least share of a predicted size that a fit begins with."""


Asked = tuple[Start, tuple[float, ...]]
"""A start, with the shares of its strength that are simulated."""


@dataclass(frozen=True)
class Screened:
    """A candidate's start with what it is predicted to gain.

    Attributes:
        start: where its search begins.
        amplitude: best multiple of the starting strength.
        gain: predicted fall of the cost.
        direction: (N,) change of the weighted residual off the calibrated directions, per unit of
            amplitude, as float32.
    """

    start: Start
    amplitude: float
    gain: float
    direction: NDArray[np.float32]


def _probe(amplitude: float) -> float:
    """Return a size to look at near another one: the same, but where that is next to nothing."""
    return math.copysign(max(abs(amplitude), _SMALLEST), amplitude)


def _amplitudes(start: Start) -> tuple[float, float]:
    """Return the least and the largest multiple of a start's strength within its bounds."""
    ends = ((bound - start.neutral) / (start.strength - start.neutral)
            for bound in (start.low, start.high))  # fmt: skip
    low, high = sorted(ends)
    return low, high


def _furthest(item: Screened, moved: Callable[[Screened, float], Screened | None]) -> Screened:
    """Return what gains most of what is reached by steps to either side, longer while they gain.

    Args:
        item: where steps begin. moved: a start moved by a factor; None where it may not be there.
    """
    for step in _STEPS:
        for factor in (step, 1.0 / step):
            stride = factor
            while True:
                found = moved(item, stride)
                if found is not None and found.gain > item.gain:
                    item, stride = found, stride * stride
                elif stride == factor:
                    break
                else:
                    stride = factor
    return item


class Screen:
    """Screens candidates against one fit.

    Args:
        problem: residuals, at a step as coarse as differences of simulations allow.
        fit: without the candidates; its residual may come from a finer step.
    """

    def __init__(self, problem: Problem, fit: Fit) -> None:
        self.problem = problem
        self.fit = fit
        self._base = problem.residual(fit.vector)
        soft, self._weight, self._basis = calibrated_directions(fit, fit.soft, 1e-9)
        self._target = self._off(soft)

    def _off(self, column: FloatArray) -> FloatArray:
        return column - self._basis @ (self._basis.T @ column)

    def run(self, start: Start, shares: Sequence[float] = _SHARES) -> Screened:
        """Return a start's predicted gain, from simulations at shares of its strength."""
        best = Screened(start, 0.0, 0.0, np.zeros(0, dtype=np.float32))
        queue = list(shares)
        again = 2
        while queue:
            found = self._at(start, queue.pop(0))
            if found is None:
                continue
            if found.gain > best.gain:
                best = found
            # far from the probe the change is not proportional: probe where it points to
            if (
                not queue
                and again
                and best.gain > 0.0
                and abs(best.amplitude) < 0.1 * min(map(abs, shares))
            ):
                queue = [best.amplitude]
                shares = [abs(best.amplitude)]
                again -= 1
        return best

    def _at(self, start: Start, share: float) -> Screened | None:
        """Return what the change at a share of the strength, made larger or less, is to gain."""
        column = self._column(start, share)
        size = float(column @ column)
        if size * share * share < 1e-6:
            return None
        return self._gains(start, float(-(column @ self._target) / size), column)

    def _of_size(self, start: Start, amplitude: float) -> Screened:
        """Return what a start gains at just this size."""
        return self._gains(start, amplitude, self._column(start, amplitude))

    def _column(self, start: Start, share: float) -> FloatArray:
        limit = 50.0 * self.fit.soft
        moved = self.problem.residual(start.apply(self.fit.vector, share))
        change = np.clip(moved - self._base, -limit, limit) * self._weight
        return self._off(change) / share

    def _gains(self, start: Start, amplitude: float, column: FloatArray) -> Screened:
        low, high = _amplitudes(start)
        amplitude = float(np.clip(amplitude, low, high))
        gain = -(2.0 * amplitude * float(column @ self._target) + amplitude**2 * (column @ column))
        return Screened(start, amplitude, float(gain), column.astype(np.float32))

    def refined(self, item: Screened, layout: Layout) -> Screened:
        """Return a candidate's start with its size, thresholds, knees and times moved to gain more.

        A fit does not find its way to a setting that is never reached, or that always is: what
        opens at 7.6 MPa looks like nothing at 9.5 and like a leak at 7.1. One after the other is
        therefore moved by steps that become longer while they gain and smaller in the end
        (coordinate search: Hooke, Jeeves, J. ACM 8 (1961) 212, doi:10.1145/321062.321069). The
        size is moved as well, before and after: the effect of saturating iron grows with a high
        power of it, and a slope tells little.
        """
        item = self._best_size(item)
        places = {layout.index[key]: layout.by_key[key] for key in item.start.keys}
        for at, value in item.start.settings:
            parameter = places.get(at)
            if parameter is None or at == item.start.strength_at or value <= 0.0:
                continue
            item = self._best_setting(item, at, parameter)
        return self._best_size(item)

    def _best_size(self, item: Screened) -> Screened:
        if item.amplitude == 0.0:
            return item
        low, high = _amplitudes(item.start)
        least, most = _SMALLEST * abs(item.amplitude), abs(item.amplitude) / _SMALLEST

        def moved(best: Screened, factor: float) -> Screened | None:
            amplitude = best.amplitude * factor
            within = low <= amplitude <= high and least <= abs(amplitude) <= most
            return self._of_size(item.start, amplitude) if within else None

        best = _furthest(self._of_size(item.start, item.amplitude), moved)
        return best if best.gain > 0.0 else item

    def _best_setting(self, item: Screened, at: int, parameter: Parameter) -> Screened:
        # what is predicted at another setting is compared with what is predicted here
        item = self.run(item.start, (_probe(item.amplitude),))

        def moved(best: Screened, factor: float) -> Screened | None:
            value = dict(best.start.settings)[at] * factor
            start = best.start.at({at: value})
            vector = start.apply(self.fit.vector)
            permitted = self.problem.places.permits(vector, start.keys)
            if not parameter.low <= value <= parameter.high or not permitted:
                return None
            return self.run(start, (_probe(best.amplitude),))

        return _furthest(item, moved)

    def all(
        self, starts: Sequence[Start], known: dict[Asked, Screened] | None = None
    ) -> list[Screened]:
        """Return all starts, the most promising first; ties keep the order given.

        Args:
            starts: of candidates. known: what was screened by the same before; the rest is added.
        """
        count: dict[str, int] = {}
        for start in starts:
            count[start.candidate] = count.get(start.candidate, 0) + 1
        # where a candidate has many starts, these differ in strength already
        asked: list[Asked] = [
            (start, _SHARES if count[start.candidate] <= 2 else _SHARES[-1:]) for start in starts
        ]
        found = {} if known is None else known
        new = [one for one in dict.fromkeys(asked) if one not in found]
        found.update(zip(new, side_by_side(lambda one: self.run(*one), new), strict=True))
        return sorted((found[one] for one in asked), key=lambda item: -item.gain)


def unlike(screened: Sequence[Screened]) -> list[Screened]:
    """Return those of one candidate that do not move the outputs as a better one does already."""
    kept: list[Screened] = []
    for item in screened:
        size = float(np.linalg.norm(item.direction))
        if all(
            abs(float(item.direction @ other.direction))
            < _ALIKE * size * float(np.linalg.norm(other.direction))
            for other in kept
        ):
            kept.append(item)
    return kept


def starting_point(problem: Problem, item: Screened, fit: Fit) -> FloatArray:
    """Return a vector with a screened candidate on, at a size that makes nothing worse.

    A prediction far beyond the strength that was probed holds only where an effect is proportional
    to its strength; a fit that begins behind a ridge stays there. What was probed itself may be
    the better place: the instants of impacts are proportional to nothing.

    Args:
        problem: where a fit is to begin. item: the candidate. fit: without it, there.
    """
    share = 1.0
    while True:
        vector = started_vector(item, fit.vector, share)
        cost = cost_of(problem, vector)
        if cost <= fit.cost or share < _SMALLEST:
            break
        share /= 3.0
    probed = item.start.apply(fit.vector)
    return probed if cost_of(problem, probed) < cost else vector


def started_vector(item: Screened, vector: FloatArray, share: float = 1.0) -> FloatArray:
    """Return a vector with a screened candidate on, at a share of the size that was predicted."""
    # a predicted amplitude is a fraction of the real one; never start from nothing
    size = share * float(np.sign(item.amplitude) or 1.0) * max(abs(item.amplitude), 1e-3)
    return item.start.clipped(item.start.apply(vector, size))
