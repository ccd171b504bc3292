"""When what is missing acts, where that is seldom: a push, a valve that sticks, a bad contact.

The excess of a stretch is the sum of its squared residuals, softened as a fit does, less what noise
makes. Where nearly all of it lies in a small part of the time, that part says more than any curve:
whoever was at the machine may know what happened then.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

from eha_bench.core.arrays import FloatArray
from eha_bench.core.per_cent import per_cent
from eha_bench.diagnosis.fit.evidence import SOFT_MEAN
from eha_bench.diagnosis.fit.problem import Problem, soften

_LENGTH = 0.25
"""Length of a stretch, s."""
_NEARLY_ALL = 0.8
"""Share of the excess that has to lie in few stretches."""
_SELDOM = 0.1
"""Share of the time that these are at most."""
_SAID = 4
"""Stretches that a sentence names."""


class RunStretch(NamedTuple):
    """A part of a run, s from its first sample."""

    run: str
    start: float
    stop: float


def rare_stretches(problem: Problem, vector: FloatArray) -> tuple[list[RunStretch], float, float]:
    """Return the stretches in which nearly all of the excess lies; none where these are many.

    Args:
        problem: with its windows. vector: parameters.

    Returns:
        The stretches in the order of the runs, the share of the excess in them, and of the time.
    """
    excess: defaultdict[tuple[str, int], float] = defaultdict(float)
    seconds: defaultdict[tuple[str, int], float] = defaultdict(float)
    soft, _ = soften(problem.residual(vector), problem.soft)
    for piece in problem.pieces:
        window = problem.windows[piece.window]
        measured, run = window.measured, window.measured.run.name
        own = soft[piece.rows] ** 2 - SOFT_MEAN
        for number, value in zip(
            _bins(measured.time[window.first + piece.ticks]), own, strict=True
        ):
            excess[run, number] += float(value)
        ticks = measured.time[window.first : window.last]
        for number in _bins(ticks):
            seconds[run, number] += measured.tick
    total, time = sum(excess.values()), sum(seconds.values())
    if total <= 0.0:
        return [], 0.0, 0.0
    chosen: list[tuple[str, int]] = []
    inside = spent = 0.0
    for key in sorted(excess, key=lambda key: -excess[key]):
        if inside >= _NEARLY_ALL * total:
            break
        chosen.append(key)
        inside += excess[key]
        spent += seconds[key]
    if inside < _NEARLY_ALL * total or spent > _SELDOM * time:
        return [], 0.0, 0.0
    return _joined(chosen), min(inside / total, 1.0), spent / time


def note_of_rare_stretches(problem: Problem, vector: FloatArray) -> list[str]:
    """Say when what is missing acts, where that is seldom: a sentence, or none."""
    stretches, share, time = rare_stretches(problem, vector)
    if not stretches:
        return []
    said = ", ".join(f"{s.run} at {s.start:.3g} to {s.stop:.3g} s" for s in stretches[:_SAID])
    more = f", and {len(stretches) - _SAID} more" if len(stretches) > _SAID else ""
    return [
        f"{per_cent(share)} of what is missing lies in {per_cent(time, 1)} of the time: "
        f"{said}{more}; what happened there?"
    ]


def _bins(time: FloatArray) -> list[int]:
    return [math.floor(instant / _LENGTH) for instant in time]


def _joined(chosen: Sequence[tuple[str, int]]) -> list[RunStretch]:
    """Return stretches of which neighbours are one."""
    found: list[RunStretch] = []
    for run, number in sorted(chosen):
        start, stop = number * _LENGTH, (number + 1) * _LENGTH
        if found and found[-1].run == run and found[-1].stop == start:
            start = found.pop().start
        found.append(RunStretch(run, start, stop))
    return found
