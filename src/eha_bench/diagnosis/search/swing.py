"""Finds the period and phase of an effect that swings with time.

From a period that is off by more than a part of the recording's length no fit finds its way. Over
windows that are short beside the period, a swing is a constant of another size in each of them:

    change(t) = [a cos(2 pi f t_w) + b sin(2 pi f t_w)] c(t) + d m(t)

with t_w the middle of a window, c what a constant of one unit changes, and m what the swing's mean
does. Two simulations give c and m; for every f the best a, b, d follow from sums over windows, off
what the calibrated parameters do (Lomb's periodogram, Astrophys. Space Sci. 39 (1976) 447,
doi:10.1007/BF00648343, of an input that is not measured).

An effect that swings is one with parameters `frequency` and `phase`; its strength is the amplitude.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.baseline import COARSE
from eha_bench.diagnosis.fit.candidates import Start, one_of_each_form
from eha_bench.diagnosis.fit.friction_at_rest import is_friction_at_rest
from eha_bench.diagnosis.fit.least_squares import Fit, calibrated_directions, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.short_windows import WINDOW
from eha_bench.diagnosis.search.periodic import in_parts
from eha_bench.diagnosis.search.refit import free_of
from eha_bench.diagnosis.search.state import Search
from eha_bench.plants.layout import Layout

_KEPT = 3
"""Periods from which a search begins."""
_STEP = 0.1
"""Step of the frequency, as a share of the inverse of the longest recording."""
_FASTEST = 0.35
"""Turns during a window up to which a swing is looked for."""
_SMALL = 0.2
"""Share of a strength that is probed: there the change is proportional to it."""


@dataclass(frozen=True)
class Sums:
    """Sums over windows, of what constants change, weighed and off the calibrated directions.

    Attributes:
        time: (W,) middle of each window, s. unit: (W, 3) products of c with c, m and the residual.
        mean: (2,) products of m with itself and the residual.
        known: (W, p) products of c with each calibrated direction; known_mean: (p,) of m.
        left: (p,) of the residual.
    """

    time: FloatArray
    unit: FloatArray
    mean: FloatArray
    known: FloatArray
    known_mean: FloatArray
    left: FloatArray

    def best(self, frequency: float) -> tuple[float, float, float]:
        """Return the predicted fall of the cost of a frequency, with its amplitude and phase."""
        angle = 2.0 * math.pi * frequency * self.time
        waves = np.column_stack([np.cos(angle), np.sin(angle)])
        known = np.column_stack([self.known.T @ waves, self.known_mean])
        normal = np.empty((3, 3))
        normal[:2, :2] = (waves * self.unit[:, :1]).T @ waves
        normal[:2, 2] = normal[2, :2] = waves.T @ self.unit[:, 1]
        normal[2, 2] = self.mean[0]
        normal -= known.T @ known
        right = np.append(waves.T @ self.unit[:, 2], self.mean[1]) - known.T @ self.left
        answer = -np.linalg.lstsq(normal, right, rcond=1e-9)[0]
        amplitude, phase = math.hypot(answer[0], answer[1]), math.atan2(answer[0], answer[1])
        return float(-right @ answer), amplitude, phase


def with_periods(search: Search, starts: Sequence[Start], vector: FloatArray) -> list[Start]:
    """Return starting points, those of a swing at the periods that the residual shows.

    Args:
        search: so far. starts: of candidates. vector: parameters with which the swing is missing.
    """
    layout = search.problem.plant.layout
    swinging = [start for start in starts if is_swing(start)]
    if not swinging:
        return list(starts)
    # all of them: windows that are spread evenly take a fast swing for a slow one
    short = in_parts(search.problem.at_step(COARSE), WINDOW)
    short.prepare(vector)
    short.scale_to(short.residual(vector))
    free = [one for one in free_of(search, vector, ()) if not is_friction_at_rest(one.key)]
    fit = levenberg_marquardt(short, vector, free, iterations=0)
    found = [start for start in starts if not is_swing(start)]
    for form in one_of_each_form(layout, swinging):
        found += best_periods(short, fit, layout, form)
    return found


def is_swing(start: Start) -> bool:
    """Whether a start is of something that swings with time."""
    return {f"{start.candidate}.frequency", f"{start.candidate}.phase"} <= {*start.keys}


def best_periods(problem: Problem, fit: Fit, layout: Layout, start: Start) -> list[Start]:
    """Return the best few periods of one swing, the best first.

    Args:
        problem: over short windows. fit: without the swing, there. layout: of the plant.
        start: of the swing, at any period.
    """
    sums = _sums(problem, fit, layout, start)
    longest = float(np.ptp(sums.time)) if sums.time.size else 0.0
    if longest <= 0.0:
        return [start]
    frequency_of = layout.by_key[f"{start.candidate}.frequency"]
    fastest = min(_FASTEST / WINDOW, frequency_of.high)
    grid = np.arange(max(1.0 / longest, frequency_of.low), fastest, _STEP / longest)
    tried = sorted(((*sums.best(float(f)), float(f)) for f in grid), reverse=True)
    kept: list[tuple[float, float, float, float]] = []
    for item in tried:
        if all(abs(item[3] - other[3]) > 1.0 / longest for other in kept):
            kept.append(item)
        if len(kept) == _KEPT:
            break
    probed = _SMALL * start.strength
    return [
        replace(
            _at(layout, start, frequency, phase),
            strength=min(max(amplitude * probed, 1e-3 * start.strength), start.high),
        )
        for _, amplitude, phase, frequency in kept
    ]


def _sums(problem: Problem, fit: Fit, layout: Layout, start: Start) -> Sums:
    soft, weight, basis = calibrated_directions(fit, problem.soft)
    base = problem.residual(fit.vector)
    small = replace(start, strength=_SMALL * start.strength)
    # a swing of no frequency is a constant, of the size that its phase says
    nothing, quarter = (
        (problem.residual(_at(layout, small, 0.0, phase).apply(fit.vector)) - base) * weight
        for phase in (0.0, 0.5 * math.pi)
    )
    unit = quarter - nothing
    windows = range(len(problem.windows))
    rows: list[list[slice]] = [[] for _ in windows]
    for piece in problem.pieces:
        rows[piece.window].append(piece.rows)

    def summed(values: FloatArray) -> FloatArray:
        """Return the sums of (N, k) products over each window's rows, (W, k)."""
        return np.array([sum(values[own].sum(axis=0) for own in rows[k]) for k in windows])

    time = np.array([w.measured.time[w.first : w.last].mean() for w in problem.windows])
    products = np.column_stack([unit * unit, unit * nothing, unit * soft])
    return Sums(
        time,
        summed(products),
        np.array([nothing @ nothing, nothing @ soft]),
        summed(basis * unit[:, None]),
        basis.T @ nothing,
        basis.T @ soft,
    )


def _at(layout: Layout, start: Start, frequency: float, phase: float) -> Start:
    """Return a start at a frequency, Hz, and a phase, rad."""
    places = (layout.index[f"{start.candidate}.{name}"] for name in ("frequency", "phase"))
    return start.at(dict(zip(places, (frequency, phase), strict=True)))
