"""Windows of long training data that were not chosen, and err more than any that was.

Of long data a share is fitted, chosen evenly. What acts in few instants (iron that saturates, a
valve that opens at peaks of the pressure) may lie between: a model that fits every chosen window is
then called complete. One simulation of what was left out at the calibrated parameters tells where
it errs beyond chance and beyond all that was seen; those windows are fitted as well. Where nothing
is missing none does, so no window is chosen for its noise. Where much is missing in what was chosen
none is added: a measured machine errs somewhere most, and that is no better place to learn from.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.windows import Window, cut_windows
from eha_bench.diagnosis.fit.chosen_windows import budget_of, chunks, is_thinned, length
from eha_bench.diagnosis.fit.evidence import SOFT_MEAN
from eha_bench.diagnosis.fit.problem import Problem, soften

_SHOWS = 0.1
"""Mean excess of the chosen windows, in the noise's, from which what is missing shows in them: more
of it would weigh only where a model errs most."""
_BEYOND_CHANCE = 6.0
"""Standard deviations of a window's mean square beyond which chance makes it in no diagnosis."""
_BEYOND_SEEN = 2.0
"""Multiple of the largest excess of a chosen window that one has to have to tell something new."""
_MORE = 0.25
"""Share of what is simulated at most that is added at most."""


def telling_windows(
    problem: Problem, vector: FloatArray, measured: Sequence[Measured]
) -> list[Window]:
    """Return windows that were not chosen and err most, where they tell what the chosen do not.

    Args:
        problem: over the chosen windows, prepared. vector: parameters fitted to it.
        measured: runs that the windows were chosen from.
    """
    if not is_thinned(measured):
        return []
    every = [window for item in measured for window in cut_windows(item, problem.noise)]
    others = _left_out(chunks(every), problem.windows)
    if not others:
        return []
    chosen = [excess for excess, _ in _excesses(problem, vector)]
    if float(np.mean(chosen)) > _SHOWS * SOFT_MEAN:
        return []
    seen = max(chosen)
    unseen = problem.over(others)
    unseen.prepare(vector)
    found = [
        (excess, window)
        for (excess, chance), window in zip(_excesses(unseen, vector), others, strict=True)
        if excess > max(_BEYOND_CHANCE * chance, _BEYOND_SEEN * seen)
    ]
    found.sort(key=lambda pair: -pair[0])
    most = _MORE * budget_of(every)
    totals = accumulate(length(window) for _, window in found)
    # the one that errs most is telling, however long it is
    return [
        window
        for number, ((_, window), total) in enumerate(zip(found, totals, strict=True))
        if number == 0 or total <= most
    ]


def note_of(windows: Sequence[Window]) -> str:
    """Say in which runs windows were added, and how much."""
    names = dict.fromkeys(window.measured.run.name for window in windows)
    return (
        f"{sum(map(length, windows)):.2g} s more are simulated: there, in {', '.join(names)}, the "
        "model errs more than in all that was chosen"
    )


def _left_out(windows: Sequence[Window], chosen: Sequence[Window]) -> list[Window]:
    """Return the windows that share no tick with those chosen."""
    taken: dict[str, list[tuple[int, int]]] = {}
    for window in chosen:
        taken.setdefault(window.measured.run.name, []).append((window.first, window.last))
    return [
        window
        for window in windows
        if all(
            window.last <= first or last <= window.first
            for first, last in taken.get(window.measured.run.name, ())
        )
    ]


def _excesses(problem: Problem, vector: FloatArray) -> list[tuple[float, float]]:
    """Return each window's mean square above the noise's, and the standard deviation of chance."""
    soft, _ = soften(problem.residual(vector), problem.soft)
    squares = [soft[piece.rows] ** 2 for piece in problem.pieces]
    return [
        (float(np.mean(own)) - SOFT_MEAN, math.sqrt(2.0 / own.size)) if own.size else (0.0, 1.0)
        for own in squares
    ]
