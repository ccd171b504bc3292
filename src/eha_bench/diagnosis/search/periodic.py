"""Finds the count and phase of an effect that is periodic in the shaft's angle.

A model that is a little off loses the angle in a long replay, and with it the phase: every count
looks alike. The measured speed does not: its noise, integrated over seconds, is a hundredth of a
radian. So an effect is looked for over short windows, each of which begins at the angle that the
measured speed has come to. For a fixed count the effect is then nearly linear in its sine and
cosine amplitudes: two simulations say what it would gain. Only the best counts are refitted, over
short windows, then over longer ones, and last over whole runs, whose phase the model has to keep.

A periodic effect is one with parameters `count` and `phase`; its strength is the amplitude.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eha_bench.diagnosis.data.windows import split
from eha_bench.diagnosis.fit.candidates import Start
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.problem import Problem, soften
from eha_bench.diagnosis.fit.side_by_side import side_by_side
from eha_bench.plants.effect import Effect
from eha_bench.plants.layout import Layout

FloatArray = NDArray[np.float64]

_COUNTS = (*range(1, 49), 54, 56, 60, 66, 72, 80, 84, 90, 96)
_KEEP = 2


def is_periodic(effect: Effect) -> bool:
    """Whether an effect is periodic in the shaft's angle."""
    names = {parameter.name for parameter in effect.parameters}
    return {"count", "phase"} <= names


def in_parts(problem: Problem, length: float) -> Problem:
    """Return a problem with its windows cut into parts of about a length in s, not yet prepared."""
    parts = [part for window in problem.windows for part in split(window, length)]
    other = Problem(problem.plant, parts, problem.noise, problem.step)
    other.soft = problem.soft
    return other


def scan(problem: Problem, fit: Fit, layout: Layout, starts: Sequence[Start]) -> list[Start]:
    """Return the best counts of one periodic effect in each of its forms, the best first.

    Args:
        problem: over short windows. fit: without the effect, on these windows.
        layout: of the plant. starts: the effect's own starting points.
    """
    soft, weight = soften(fit.residual, problem.soft)
    matrix = fit.jacobian * weight[:, None]
    norms = np.linalg.norm(matrix, axis=0)
    basis = np.linalg.qr(matrix[:, norms > 1e-6 * norms.max(initial=1e-300)])[0]
    target = soft - basis @ (basis.T @ soft)
    base = problem.residual(fit.vector)

    def moved(trial: Start) -> FloatArray:
        """Return what a trial does off the calibrated directions."""
        change = (problem.residual(trial.apply(fit.vector)) - base) * weight
        return np.asarray(change - basis @ (basis.T @ change), dtype=np.float64)

    found: list[tuple[float, Start]] = []
    for template in _forms(layout, starts):
        name = template.candidate
        at_count, at_phase = layout.index[f"{name}.count"], layout.index[f"{name}.phase"]
        counts = sorted({*_COUNTS, *(int(dict(s.settings)[at_count]) for s in starts)})
        # a small size stays where the change is proportional to it
        small = replace(template, strength=0.2 * template.strength)
        waves = [(count, phase) for count in counts for phase in (0.0, 0.5 * math.pi)]
        columns = side_by_side(
            moved, [_at(small, at_count, at_phase, float(count), phase) for count, phase in waves]
        )
        gains = []
        for count, sine, cosine in zip(counts, columns[::2], columns[1::2], strict=True):
            pair = np.column_stack([sine, cosine])
            normal = pair.T @ pair
            if normal[0, 0] < 1e-6 or np.linalg.cond(normal) > 1e8:
                continue
            amplitude = -np.linalg.solve(normal, pair.T @ target)
            gain = float(-(pair.T @ target) @ amplitude)
            phase = math.atan2(float(amplitude[1]), float(amplitude[0]))
            size = small.strength * float(np.hypot(*amplitude))
            size = min(max(size, 1e-3 * template.strength), template.high)
            best = _at(small, at_count, at_phase, float(count), phase)
            # a shaft has a whole number of poles, slots or pistons: fixed, no phase runs away
            keys = tuple(key for key in template.keys if key != f"{name}.count")
            gains.append((gain, replace(best, strength=size, keys=keys)))
        gains.sort(key=lambda item: -item[0])
        found += gains[:_KEEP]
    found.sort(key=lambda item: -item[0])
    return [start for _, start in found]


def _forms(layout: Layout, starts: Sequence[Start]) -> list[Start]:
    """Return one starting point for each combination of an effect's choices."""
    forms: dict[tuple[float, ...], Start] = {}
    for start in starts:
        settings = dict(start.settings)
        effect = layout.effect(start.candidate)
        words = [p.name for p in effect.parameters if p.choices]
        key = tuple(settings[layout.index[f"{effect.id}.{name}"]] for name in words)
        forms.setdefault(key, start)
    return list(forms.values())


def _at(start: Start, at_count: int, at_phase: int, count: float, phase: float) -> Start:
    settings = tuple(
        (at, count if at == at_count else phase if at == at_phase else value)
        for at, value in start.settings
    )
    return replace(start, settings=settings)
