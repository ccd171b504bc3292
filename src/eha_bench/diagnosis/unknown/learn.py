"""Fits a curve that was located, over short windows and then long ones, and says when it is on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.candidates import LEARNED, Start
from eha_bench.diagnosis.fit.least_squares import Fit, Free, free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem, cost_of
from eha_bench.diagnosis.unknown.curves import LocatedCurve
from eha_bench.diagnosis.unknown.places import curve_on
from eha_bench.plants.effect import AT

_ITERATIONS = 6
_ROUNDS = 3
_FALLS = 0.9


def learn(
    problem: Problem, short: Problem, fit: Fit, located: LocatedCurve, step: float
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
    free = (*free_parameters(problem.places, keys, vector), *curve)
    if located.period:
        at = layout.index[f"{LEARNED}.period"]
        free = (
            *free,
            Free(f"{LEARNED}.period", at, 0.5 * located.period, 2 * located.period, located.period),
        )
    # without the curve the parameters had been bent to imitate it; short windows straighten them
    near = _fit_until_settled(short.apart(), vector, free)
    long = problem.at_step(step)
    long.soft = 1.0
    done = levenberg_marquardt(long, near.vector, free, iterations=10, refresh=1)
    settings = tuple(
        (layout.index[f"{LEARNED}.{name}"], float(done.vector[layout.index[f"{LEARNED}.{name}"]]))
        for name in ("form", "variable", AT, "period", "low", "high")
        if f"{LEARNED}.{name}" in layout.index
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


def _fit_until_settled(short: Problem, vector: FloatArray, free: Sequence[Free]) -> Fit:
    """Fit, and weigh again by what is left, until that no longer falls much.

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


def times_of(problem: Problem, fit: Fit, declared: FloatArray) -> tuple[tuple[float, float], ...]:
    """Return when a learned curve of the time is on: (start, stop) in s from a run's start.

    On is one side of half way between its levels. A constant next to the curve may have been taken
    up by what was calibrated, so off is the level at which the declared model is nearer the
    recordings.

    Args:
        problem: the runs' windows. fit: with the curve. declared: vector before any calibration.
    """
    layout = problem.plant.layout
    effect = layout.effect(LEARNED)
    place = {p.name: layout.index[f"{LEARNED}.{p.name}"] for p in effect.parameters}
    size = effect.parameter("values").size
    knots = slice(place["values"], place["values"] + size)
    values = fit.vector[knots]
    period = float(fit.vector[place["period"]])
    low, high = float(fit.vector[place["low"]]), float(fit.vector[place["high"]])
    longest = max(float(window.measured.time[-1]) for window in problem.windows)
    time = np.linspace(0.0, longest, 4000)
    if period > 0.0:
        at = np.arange(size + 1) * period / size
        curve = np.interp(time % period, at, np.append(values, values[0]))
    else:
        curve = np.interp(time, np.linspace(low, high, size), values)
    upper, lower = np.quantile(curve, 0.9), np.quantile(curve, 0.1)

    def cost_with_off_at(level: float) -> float:
        vector = fit.vector.copy()
        for item in fit.free:
            if not item.of_effect and item.at < declared.size:
                vector[item.at] = declared[item.at]
        vector[knots] = values - level
        return cost_of(problem, vector)

    above = curve > 0.5 * (upper + lower)
    on = above if cost_with_off_at(lower) <= cost_with_off_at(upper) else ~above
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(np.int8)))
    pairs = zip(edges[::2], edges[1::2] - 1, strict=True)
    return tuple((round(float(time[a]), 3), round(float(time[b]), 3)) for a, b in pairs)[:100]
