"""The same runs cut into windows so short that an error stays in the balance it enters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eha_bench.core.arrays import FloatArray, IndexArray
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.windows import Window, window_at
from eha_bench.diagnosis.fit.problem import Problem, soften

WINDOW = 0.1
"""Length of a short window, s."""

_BUDGET = 6.0
_BUDGET_OF_FEW = 30.0
_BUDGET_TICKS = 2000
"""At least so many ticks, where the logs are slow."""
_FEWEST_TICKS = 24
_LOOKED_AT = 4


def medium_problem(problem: Problem, length: float = WINDOW) -> Problem:
    """Return the problem over short windows spread evenly over all runs."""
    runs = _runs(problem)
    share = _budget(runs) / len(runs)
    windows = []
    for measured in runs:
        time = measured.time
        fewest = max(6, round(_FEWEST_TICKS * length / WINDOW))
        size = max(fewest, round(length / measured.tick))
        most = max(2, round(share / length), round(_BUDGET_TICKS / len(runs) / size))
        places = _evenly(np.arange(0, time.size - size, size), most)
        windows += [window_at(measured, int(k), int(k) + size, problem.noise) for k in places]
    return Problem(
        problem.plant, windows, problem.noise, problem.step, problem.beliefs, problem.stretch
    )


def aligned_problem(problem: Problem, vector: FloatArray, knots: int) -> tuple[Problem, float]:
    """Return short windows that begin at multiples of one period, and that period, s.

    A curve of the time with so many knots a period acts in every window at the same instants; its
    last knot lies between a window and the next. Half of the windows are spread evenly, half are
    where most is left: what acts rarely would be missed. Over long windows an error also shows
    later than it acts, over short ones a badly known start shows too, so the smaller of both says
    how much is left.

    Args:
        problem: the long problem, for its runs and noise.
        vector: parameters that say where most is left.
        knots: of a period.
    """
    runs = _runs(problem)
    tick = max(measured.tick for measured in runs)
    length = max(WINDOW, _FEWEST_TICKS * tick)
    period = length * knots / (knots - 1.0)
    most = max(2, round(_budget(runs) / len(runs) / length))
    windows = [
        w for measured in runs for w in _aligned_windows(problem, measured, period, length, most)
    ]
    if not windows:
        # all runs are too short to be cut
        return problem.apart(), period
    whole = Problem(problem.plant, windows, problem.noise, problem.step, stretch=problem.stretch)
    whole.prepare(vector)
    left = np.minimum(
        _mean_squares(whole, vector, windows), _mean_squares(problem, vector, windows)
    )
    count = most * len(runs)
    if count >= len(windows):
        return whole, period
    even = _evenly(np.arange(len(windows)), count // 2)
    left[even] = -np.inf
    chosen = np.sort(np.concatenate([even, np.argsort(-left, kind="stable")[: count - even.size]]))
    own = [windows[k] for k in chosen]
    return (
        Problem(problem.plant, own, problem.noise, problem.step, stretch=problem.stretch),
        period,
    )


def _aligned_windows(
    problem: Problem, measured: Measured, period: float, length: float, most: int
) -> list[Window]:
    time = measured.time
    # a run that is shorter than a period has one window
    turns = _evenly(np.arange(max(int(time[-1] / period), 1)), _LOOKED_AT * most)
    found = []
    for turn in turns:
        first, last = np.searchsorted(time, (turn * period - 1e-9, turn * period + length))
        if last - first > _FEWEST_TICKS // 2:
            found.append(window_at(measured, int(first), int(last), problem.noise))
    return found


def _mean_squares(problem: Problem, vector: FloatArray, windows: Sequence[Window]) -> FloatArray:
    """Return the mean soft square of a problem's residual during each of some windows, (W,)."""
    soft, _ = soften(problem.residual(vector))
    sums: dict[str, FloatArray] = {}
    for piece in problem.pieces:
        window = problem.windows[piece.window]
        total = sums.setdefault(window.measured.run.name, np.zeros((2, window.measured.time.size)))
        ticks = window.first + piece.ticks
        np.add.at(total[0], ticks, soft[piece.rows] ** 2)
        np.add.at(total[1], ticks, 1.0)
    found = []
    for window in windows:
        square, count = sums[window.measured.run.name][:, window.first : window.last].sum(axis=1)
        found.append(square / count if count else 0.0)
    return np.array(found)


def _runs(problem: Problem) -> Sequence[Measured]:
    runs: dict[str, Measured] = {}
    for window in problem.windows:
        runs.setdefault(window.measured.run.name, window.measured)
    return list(runs.values())


def _budget(runs: Sequence[Measured]) -> float:
    # few runs are long ones: what happens in them may be far apart
    return _BUDGET if len(runs) > 3 else _BUDGET_OF_FEW


def _evenly(places: IndexArray, most: int) -> IndexArray:
    """Return at most so many, evenly, but not in step with anything periodic."""
    if places.size <= most:
        return places
    chosen = np.unique(np.linspace(0, places.size - 1, most).round().astype(int))
    return np.asarray(places[chosen])
