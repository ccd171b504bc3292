"""Ranks every candidate by one simulation each: what would it gain?

The residual's change at a starting strength is projected off the sensitivities of what is
calibrated anyway, so that a candidate is credited only with what the parameters cannot do; then the
best amplitude within the strength's bounds gives the predicted fall of the cost. Predictions are a
fraction of what a refit gains, but their order holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eha_bench.diagnosis.fit.candidates import Start
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.problem import Problem, soften
from eha_bench.diagnosis.fit.side_by_side import side_by_side

FloatArray = NDArray[np.float64]

_SHARES = (0.2, 1.0)


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
        soft, self._weight = soften(fit.residual, fit.soft)
        weighted = fit.jacobian * self._weight[:, None]
        norms = np.linalg.norm(weighted, axis=0)
        keep = norms > 1e-9 * max(float(norms.max(initial=0.0)), 1e-300)
        self._basis = np.linalg.qr(weighted[:, keep])[0] if keep.any() else np.zeros((soft.size, 0))
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
            if not queue and again and best.gain > 0.0 and abs(best.amplitude) < 0.1 * min(shares):
                queue = [best.amplitude]
                shares = [abs(best.amplitude)]
                again -= 1
        return best

    def _at(self, start: Start, share: float) -> Screened | None:
        limit = 50.0 * self.fit.soft
        moved = self.problem.residual(start.apply(self.fit.vector, share))
        change = np.clip(moved - self._base, -limit, limit) * self._weight
        column = self._off(change) / share
        size = float(column @ column)
        if size * share * share < 1e-6:
            return None
        low = (start.low - start.neutral) / (start.strength - start.neutral)
        high = (start.high - start.neutral) / (start.strength - start.neutral)
        low, high = min(low, high), max(low, high)
        amplitude = float(np.clip(-(column @ self._target) / size, low, high))
        gain = -(2.0 * amplitude * float(column @ self._target) + amplitude**2 * size)
        return Screened(start, amplitude, gain, column.astype(np.float32))

    def all(self, starts: Sequence[Start]) -> list[Screened]:
        """Return all starts, the most promising first; ties keep the order given."""
        count: dict[str, int] = {}
        for start in starts:
            count[start.candidate] = count.get(start.candidate, 0) + 1

        def screened(start: Start) -> Screened:
            # where a candidate has many starts, these differ in strength already
            return self.run(start, _SHARES if count[start.candidate] <= 2 else _SHARES[-1:])

        found = side_by_side(screened, starts)
        return sorted(found, key=lambda item: -item.gain)
