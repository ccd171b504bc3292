"""Finds the count of an effect that is periodic in the shaft's angle.

In a long replay a wrong angle loses the phase, and every count looks alike. So the count is scanned
in windows of 40 ms, each with the shaft's angle integrated from the measured speed: for a fixed
count the effect is nearly linear in its sine and cosine amplitudes, two simulations say what it
would gain, and only the best counts are refined over long windows.

A periodic effect is one with parameters `count` and `phase`; its strength is the amplitude.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eha_bench.diagnosis.candidates import Start
from eha_bench.diagnosis.fit import free_parameters, jacobian, levenberg_marquardt
from eha_bench.diagnosis.gate import Measured
from eha_bench.diagnosis.problem import Problem, soften
from eha_bench.diagnosis.windows import Window, shaft_angle, window_at
from eha_bench.plants.assembly import Layout
from eha_bench.plants.effect import Effect

FloatArray = NDArray[np.float64]

SHORT = 0.04
"""Length of a window in which the phase cannot be lost, s."""
_BUDGET = 4.0
_COUNTS = (*range(1, 49), 54, 56, 60, 66, 72, 80, 84, 90, 96)
_KEEP = 3
_ENOUGH = 60


def is_periodic(effect: Effect) -> bool:
    """Whether an effect is periodic in the shaft's angle."""
    names = {parameter.name for parameter in effect.parameters}
    return {"count", "phase"} <= names


def short_problem(problem: Problem, noise: dict[str, float]) -> Problem | None:
    """Return the problem over short windows while the shaft turns, or None without a speed."""
    runs: dict[str, Measured] = {}
    for window in problem.windows:
        runs.setdefault(window.measured.run.name, window.measured)
    places: list[tuple[Measured, int, int]] = []
    for measured in runs.values():
        angle = shaft_angle(measured)
        if angle is None:
            continue
        time = measured.time
        length = max(5, round(SHORT / float(np.median(np.diff(time)))))
        for first in range(length, time.size - length, length):
            if time[first + length - 1] - time[first] > 2.0 * SHORT:
                continue
            if abs(angle[first + length] - angle[first]) > 5.0 * SHORT:
                places.append((measured, first, first + length))
    if not places:
        return None
    most = round(_BUDGET / SHORT)
    chosen = np.unique(np.linspace(0, len(places) - 1, min(most, len(places))).round().astype(int))
    windows: list[Window] = []
    for k in chosen:
        measured, first, last = places[k]
        windows.append(window_at(measured, first, last, noise))
    return Problem(problem.plant, windows, noise, problem.step)


def scan(
    short: Problem, vector: FloatArray, keys: Sequence[str], layout: Layout, starts: Sequence[Start]
) -> list[Start]:
    """Return the best starting points of one periodic effect, the most promising first.

    Args:
        short: problem over short windows.
        vector: calibrated parameters. keys: what is calibrated anyway.
        layout: of the plant. starts: the effect's own starting points; one for each of its choices
            is used, at every count.
    """
    if not starts:
        return []
    name = starts[0].candidate
    at_count, at_phase = layout.index[f"{name}.count"], layout.index[f"{name}.phase"]
    short.prepare(vector)
    base = short.residual(vector)
    short.scale_to(base)
    free = free_parameters(layout, keys, vector)
    columns_of = jacobian(short, vector, free, base)
    known = {item.key: columns_of[:, k] for k, item in enumerate(free)}
    # every count is looked at in every other window, and the best ones in all
    few = range(0, len(short.windows), 2 if len(short.windows) >= _ENOUGH else 1)
    rows = short.rows_of(few)
    fewer = short.subset(few)
    soft, weight = soften(base[rows], short.soft)
    matrix = columns_of[rows] * weight[:, None]
    norms = np.linalg.norm(matrix, axis=0)
    basis = np.linalg.qr(matrix[:, norms > 1e-6 * norms.max(initial=1e-300)])[0]
    target = soft - basis @ (basis.T @ soft)
    counts = sorted({*_COUNTS, *(int(dict(s.settings)[at_count]) for s in starts)})
    template = starts[0]
    found: list[tuple[float, Start]] = []
    for count in counts:
        columns = []
        for phase in (0.0, 0.5 * math.pi):
            trial = _at(template, at_count, at_phase, float(count), phase)
            change = (fewer.residual(trial.apply(vector)) - base[rows]) * weight
            columns.append(change - basis @ (basis.T @ change))
        pair = np.column_stack(columns)
        normal = pair.T @ pair
        if normal[0, 0] < 1e-6 or np.linalg.cond(normal) > 1e8:
            continue
        amplitude = -np.linalg.solve(normal, pair.T @ target)
        gain = float(-(pair.T @ target) @ amplitude)
        phase = math.atan2(float(amplitude[1]), float(amplitude[0]))
        size = template.strength * float(np.hypot(*amplitude))
        size = min(max(size, 1e-3 * template.strength), template.high)
        best = replace(_at(template, at_count, at_phase, float(count), phase), strength=size)
        found.append((gain, best))
    found.sort(key=lambda item: -item[0])
    refined = []
    for _, start in found[:_KEEP]:
        here = start.apply(vector)
        # what is calibrated moves along: without the effect it had been bent to imitate it
        together = (*free, *free_parameters(layout, start.keys, here))
        moved = levenberg_marquardt(short, here, together, iterations=6, known=known, refresh=1)
        strength = float(moved.vector[start.strength_at])
        if strength == start.neutral:
            continue
        # a shaft has a whole number of poles, slots or pistons: with it the phase cannot run away
        whole = float(round(moved.vector[at_count]))
        settings = tuple(
            (at, whole if at == at_count else float(moved.vector[at])) for at, _ in start.settings
        )
        settings += tuple((item.at, float(moved.vector[item.at])) for item in free)
        keys = tuple(key for key in start.keys if key != f"{name}.count")
        refined.append(replace(start, settings=settings, strength=strength, keys=keys))
    return refined


def _at(start: Start, at_count: int, at_phase: int, count: float, phase: float) -> Start:
    settings = tuple(
        (at, count if at == at_count else phase if at == at_phase else value)
        for at, value in start.settings
    )
    return replace(start, settings=settings)
