"""Numbers of a drawing that are wrong, and that the readings hardly tell from right ones.

A piston area that is declared too small is made up for by a mass, a friction and a leak that are
each too small: nothing is missing, but what is believed of these is contradicted. So each number
that nobody calibrates is fitted beside what is calibrated, to readings and beliefs, and one with
which all is as believed is named. Areas that are declared the same are one number.

Where readings tell nothing, the cost has a narrow valley along which parameters follow powers of
one another. In their logarithms it is straight, and differences to both sides see it: by one-sided
ones it would seem to rise.

Source: Björck, Numerical Methods for Least Squares Problems, SIAM 1996, section 9.2 (Gauss-Newton).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.beliefs import contradicted
from eha_bench.diagnosis.fit.candidates import pairs_alike
from eha_bench.diagnosis.fit.least_squares import Fit, Free, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import cost_of
from eha_bench.diagnosis.search.state import Search
from eha_bench.plants.layout import Layout

_SEVERAL = 2
"""Values further off than is believed from which one cause of all of them is looked for."""
_AGREES = 1.5
"""Multiple of what is given under `within` up to which a value is as believed."""
_DIFFERENCE = 0.01
"""Of a logarithm, to either side, by which a slope is taken."""
_STEPS = 4
_SHARES = (0.5, 1.0, 2.0)
"""Of a step, that are tried: the valley is longer than its slopes promise, or shorter."""
_ITERATIONS = 4
_WORTH = 1.0
"""Fall of the cost by a step from which the next one is tried."""


@dataclass(frozen=True)
class DoubtfulNumber:
    """A number with which everything would be as it is believed.

    Attributes:
        names: of the parameters that are this number. declared, asked: SI. unit: of both.
        off: parameters that are further off than believed without it.
    """

    names: tuple[str, ...]
    declared: float
    asked: float
    unit: str
    off: tuple[str, ...]

    @property
    def note(self) -> str:
        """What to do about it, in a sentence."""
        unit = f" {self.unit}" if self.unit else ""
        are = "are" if len(self.names) > 1 else "is"
        return (
            f"CAUTION: nothing is missing, but {', '.join(self.off)} are further off than is "
            f"believed of them. {' and '.join(self.names)} {are} declared as {self.declared:.4g}"
            f"{unit} and not calibrated; with {self.asked:.4g}{unit} all would be as believed: "
            "check that number, and the scale of the channels beside it"
        )


def doubtful_number(search: Search) -> DoubtfulNumber | None:
    """Return the number with which all is as believed that is not, None where there is none.

    Args:
        search: finished, without anything that was added.
    """
    problem, vector = search.problem, search.fit.vector
    off = contradicted(problem.beliefs, vector)
    numbers = list(_numbers(problem.plant.layout, vector, search.keys))
    if len(off) < _SEVERAL or not numbers:
        return None
    problem.prepare(vector)
    before, residual = cost_of(problem, vector), problem.residual(vector)
    slopes = _slopes(search, vector)

    def promised(number: tuple[str, ...]) -> float:
        _, left = _step(slopes, _slope(search, vector, number), residual)
        return left

    best = min(numbers, key=promised)
    fitted = _fitted(search, best)
    falls = before - cost_of(problem, fitted)
    if falls < search.thresholds.gain or contradicted(problem.beliefs, fitted, _AGREES):
        return None
    layout = problem.plant.layout
    at, unit = layout.index[best[0]], layout.by_key[best[0]].unit
    names = tuple(item.key for item in off)
    return DoubtfulNumber(best, float(vector[at]), float(fitted[at]), unit, names)


def _numbers(
    layout: Layout, vector: FloatArray, calibrated: tuple[str, ...]
) -> Iterator[tuple[str, ...]]:
    """Yield numbers of a drawing that nobody calibrates; together those that are one."""
    drawn = [item.name for item in layout.parameters if item.drawn and item.name not in calibrated]
    alike = pairs_alike(layout, vector)
    pairs = [pair for pair in alike if set(pair) <= set(drawn)]
    paired = {name for pair in alike for name in pair}
    for names in (*pairs, *((name,) for name in drawn if name not in paired)):
        if all(vector[layout.index[name]] for name in names):
            yield names


def _fitted(search: Search, number: tuple[str, ...]) -> FloatArray:
    """Return parameters with a number fitted beside what is calibrated, as far down as it goes."""
    problem, vector = search.problem, search.fit.vector
    cost = cost_of(problem, vector)
    for _ in range(_STEPS):
        slopes, own = _slopes(search, vector), _slope(search, vector, number)
        step, _ = _step(slopes, own, problem.residual(vector))

        ends = [_followed(search, vector, number, share * step) for share in _SHARES]
        best = min(ends, key=lambda end: end.cost)
        if not best.cost < cost - _WORTH:
            break
        cost, vector = best.cost, best.vector
    return vector


def _followed(search: Search, vector: FloatArray, number: tuple[str, ...], step: FloatArray) -> Fit:
    """Return the fit of what is calibrated with a number moved: the valley bends."""
    moved = _times(search, vector, number, float(np.exp(step[-1])))
    for item, change in zip(search.fit.free, step[:-1], strict=True):
        moved[item.at] = _moved(item, vector, change)
    return levenberg_marquardt(
        search.problem, moved, search.fit.free, known=search.fit.columns, refresh=0,
        iterations=_ITERATIONS,
    )  # fmt: skip


def _slopes(search: Search, vector: FloatArray) -> FloatArray:
    """Return what the residual changes by with what is calibrated, as `_moved` counts, (N, p)."""
    columns = []
    for item in search.fit.free:
        there, back = vector.copy(), vector.copy()
        there[item.at] = _moved(item, vector, _DIFFERENCE)
        back[item.at] = _moved(item, vector, -_DIFFERENCE)
        columns.append(_difference(search, there, back))
    return np.column_stack(columns)


def _slope(search: Search, vector: FloatArray, number: tuple[str, ...]) -> FloatArray:
    """Return what the residual changes by with the logarithm of a number, (N,)."""
    there, back = (
        _times(search, vector, number, float(np.exp(way))) for way in (_DIFFERENCE, -_DIFFERENCE)
    )
    return _difference(search, there, back)


def _difference(search: Search, there: FloatArray, back: FloatArray) -> FloatArray:
    change = search.problem.residual(there) - search.problem.residual(back)
    return np.asarray(change / (2.0 * _DIFFERENCE), dtype=np.float64)


def _moved(item: Free, vector: FloatArray, change: float) -> float:
    """Return a parameter moved by a change of its logarithm, or in its scale where it has none."""
    value = float(vector[item.at])
    positive = item.low >= 0.0 and value > 0.0
    moved = value * float(np.exp(change)) if positive else value + change * item.scale
    return min(max(moved, item.low), item.high)


def _times(
    search: Search, vector: FloatArray, number: tuple[str, ...], factor: float
) -> FloatArray:
    """Return parameters with a number so many times as large."""
    moved = vector.copy()
    for name in number:
        moved[search.problem.plant.layout.index[name]] *= factor
    return moved


def _step(slopes: FloatArray, own: FloatArray, residual: FloatArray) -> tuple[FloatArray, float]:
    """Return the step of what is calibrated and of a number, and the squares that it leaves."""
    columns = np.column_stack([slopes, own])
    step = np.asarray(-np.linalg.lstsq(columns, residual)[0], dtype=np.float64)
    left = residual + columns @ step
    return step, float(left @ left)
