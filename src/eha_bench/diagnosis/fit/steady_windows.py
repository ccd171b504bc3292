"""Windows that end where the last digit of their simulation begins to matter.

Where valves open and close again and again, or something sticks and slips, a simulation may part
from its neighbours exponentially. From then on the cost jumps with every digit of a parameter, and
no slope leads anywhere: the Lipschitz constant of a simulation error grows with the length of a
window (Ribeiro et al., Automatica 121 (2020) 109158, doi:10.1016/j.automatica.2020.109158). What
halving the step of integration changes tells where: it is as small as the last digits are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.windows import Window, is_whole
from eha_bench.diagnosis.fit.problem import Problem

_SURE = 0.01
"""Mean square over a window, in the noise's, that half a step of integration may change."""
_FEWEST = 0.25
"""Least share of a window that is kept; of less, its start would be most."""
_FEW = 0.2
"""Share of what is simulated that may go from a fit of a whole model."""


def steady_problem(problem: Problem, vector: FloatArray, most: float = _FEW) -> Problem:
    """Return the problem over its windows as far as their simulation is sure, prepared.

    Runs that are simulated whole stay as they are.

    Args:
        problem: at the step that fits will have; the same is returned where nothing is cut.
        vector: parameters, at which it is prepared.
        most: share of what is simulated that may go; where more would, nothing goes.
    """
    problem.prepare(vector)
    change = problem.residual(vector) - problem.at_step(0.5 * problem.step).residual(vector)
    kept = [*_kept(problem, change)]
    before, left = (sum(_ticks(window) for window in own) for own in (problem.windows, kept))
    if not (1.0 - most) * before <= left < before:
        return problem
    steady = problem.over(kept)
    steady.prepare(vector)
    return steady


def _kept(problem: Problem, change: FloatArray) -> Iterator[Window]:
    for piece in problem.pieces:
        window = problem.windows[piece.window]
        grown = np.cumsum(change[piece.rows] ** 2)
        if is_whole(window.measured) or not grown.size or grown[-1] <= _SURE * grown.size:
            yield window
            continue
        ticks = int(piece.ticks[np.searchsorted(grown, _SURE * grown.size)])
        if ticks >= _FEWEST * _ticks(window):
            yield replace(window, last=window.first + ticks)


def cut_alike(problem: Problem, steady: Problem) -> Problem:
    """Return a problem over the stretches of another one of the same runs; it needs `prepare`.

    Args:
        problem: over whole windows. steady: over these, as far as their simulation is sure.
    """
    ends = _ends(steady.windows)
    kept = (item for item in problem.windows if _start(item) in ends)
    return problem.over([replace(item, last=ends[_start(item)]) for item in kept])


def _ends(windows: Sequence[Window]) -> dict[tuple[str, int], int]:
    """Return where windows end, by where they begin."""
    return {_start(item): item.last for item in windows}


def _start(window: Window) -> tuple[str, int]:
    """Return the run and the tick at which a window begins."""
    return window.measured.run.name, window.first


def _ticks(window: Window) -> int:
    return window.last - window.first


def unsteady_notes(before: Sequence[Window], after: Sequence[Window]) -> list[str]:
    """Say which stretches are not fitted, one sentence a run.

    Args:
        before, after: windows as they were, and as far as their simulation is sure.
    """
    ends = _ends(after)
    stretches: dict[str, list[tuple[float, float]]] = {}
    for window in before:
        first = ends.get(_start(window), window.first)
        if first < window.last:
            time = window.measured.time
            own = stretches.setdefault(window.measured.run.name, [])
            # a stretch over several windows is one
            joins = own and first > 0 and own[-1][1] == time[first - 1]
            begins = own.pop()[0] if joins else float(time[first])
            own.append((begins, float(time[window.last - 1])))
    return [
        f"run '{name}' is not fitted at {', '.join(f'{a:.3g} to {b:.3g} s' for a, b in own)}: "
        "there small changes of a parameter change the simulation much, so a fit would learn "
        "nothing from it; that is no fault of the log"
        for name, own in stretches.items()
    ]
