"""Fits a curve that was located, over short windows and then long ones, and says when it is on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eha_bench.diagnosis.fit.candidates import LEARNED, Start
from eha_bench.diagnosis.fit.least_squares import Fit, Free, free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.unknown.curves import Located
from eha_bench.diagnosis.unknown.places import curve_on

FloatArray = NDArray[np.float64]

_ITERATIONS = 6
_ROUNDS = 3
_FALLS = 0.9


def learn(
    problem: Problem, short: Problem, fit: Fit, located: Located, step: float
) -> tuple[Start, Fit]:
    """Fit a located curve with everything that is fitted anyway: over short windows, then long."""
    plant = problem.plant
    layout = plant.layout
    size = layout.by_key[f"{LEARNED}.values"].size
    low, high = float(located.knots[0]), float(located.knots[-1])
    if located.period:
        values = located.values
    else:
        values = np.interp(np.linspace(low, high, size), located.knots, located.values)
    vector = curve_on(plant, fit.vector, located.template, low, high, values, located.period)
    keys = [item.key for item in fit.free if "[" not in item.key]
    scale = max(float(np.abs(values).max()), 1e-12)
    curve = tuple(
        replace(item, scale=scale)
        for item in free_parameters(layout, [f"{LEARNED}.values"], vector)
    )
    free = (*free_parameters(layout, keys, vector), *curve)
    if located.period:
        at = layout.index[f"{LEARNED}.period"]
        free = (
            *free,
            Free(f"{LEARNED}.period", at, 0.5 * located.period, 2 * located.period, located.period),
        )
    # without the curve the parameters had been bent to imitate it; short windows straighten them
    near = _settled(short.apart(), vector, free)
    long = problem.at_step(step)
    long.soft = 1.0
    done = levenberg_marquardt(long, near.vector, free, iterations=10, refresh=1)
    settings = tuple(
        (layout.index[f"{LEARNED}.{name}"], float(done.vector[layout.index[f"{LEARNED}.{name}"]]))
        for name in ("equation", "form", "variable", "place", "period", "low", "high")
    )
    start = Start(
        LEARNED,
        settings,
        layout.index[f"{LEARNED}.scale"],
        0.0,
        1.0,
        -10.0,
        10.0,
        (f"{LEARNED}.values",),
        located.template.equation,
    )
    return start, done


def _settled(short: Problem, vector: FloatArray, free: Sequence[Free]) -> Fit:
    """Fit, and weigh anew by what is left, until that no longer falls much.

    What the curve left before it was there reads as outliers and as wrong starts.
    """
    fit = levenberg_marquardt(short, vector, free, iterations=_ITERATIONS, refresh=1)
    for _ in range(_ROUNDS):
        before = float(np.mean(fit.residual**2))
        short.prepare(fit.vector)
        short.scale_to(short.residual(fit.vector))
        fit = levenberg_marquardt(
            short, fit.vector, free, iterations=_ITERATIONS, known=fit.columns, refresh=1
        )
        if float(np.mean(fit.residual**2)) > _FALLS * before:
            break
    return fit


def times_of(problem: Problem, fit: Fit) -> tuple[tuple[float, float], ...]:
    """Return when a learned curve of the time is on: (start, stop) in s from a run's start.

    On is what lies beyond half way from the curve's median to its farthest value.
    """
    layout = problem.plant.layout
    effect = layout.effect(LEARNED)
    place = {p.name: layout.index[f"{LEARNED}.{p.name}"] for p in effect.parameters}
    size = effect.parameter("values").size
    values = fit.vector[place["values"] : place["values"] + size]
    period = float(fit.vector[place["period"]])
    low, high = float(fit.vector[place["low"]]), float(fit.vector[place["high"]])
    longest = max(float(window.measured.time[-1]) for window in problem.windows)
    time = np.linspace(0.0, longest, 4000)
    if period > 0.0:
        knots = np.arange(size + 1) * period / size
        curve = np.interp(time % period, knots, np.append(values, values[0]))
    else:
        curve = np.interp(time, np.linspace(low, high, size), values)
    # the side on which it spends less time is the one on which it is on
    upper, lower = np.quantile(curve, 0.9), np.quantile(curve, 0.1)
    above = curve > 0.5 * (upper + lower)
    on = above if abs(upper) >= abs(lower) else ~above
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(np.int8)))
    pairs = zip(edges[::2], edges[1::2] - 1, strict=True)
    return tuple((round(float(time[a]), 3), round(float(time[b]), 3)) for a, b in pairs)[:100]
