"""The shaft's angle where each run begins, estimated from effects of the angle in the run.

A run's angle moves the residuals of that run only, so all runs are moved at once and each is read
by itself: the angle is scanned over one period, and then refined by Gauss-Newton steps. Its spread
is that of an unknown angle, and what it could explain is taken out of the residual as for
every start state (`problem`), so the intervals of everything else hold whatever it is.

Runs that begin alike are the rule to be refuted: different angles are freedom, one number a run.
Under the rule twice the log likelihood ratio is chi-square with as many degrees (Wilks, Ann. Math.
Stat. 9 (1938) 60, doi:10.1214/aoms/1177732360).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from scipy.special import chdtri

from eha_bench.core.arrays import FloatArray, IndexArray
from eha_bench.diagnosis.data.start_angle import StartAngle
from eha_bench.diagnosis.fit.evidence import SOFT_MEAN
from eha_bench.diagnosis.fit.problem import Problem, cost_of, soften
from eha_bench.diagnosis.fit.short_windows import medium_problem
from eha_bench.plants.effect import BoundEffect
from eha_bench.plants.layout import Layout

_CHANCE = 1e-3
"""Probability of finding different start angles where the runs have the same."""
_NEARLY = 0.75
"""Share of what different angles explain that a common one explains where runs begin alike: an
integrated speed drifts, and phases half a radian off cost a quarter (the square of a cosine)."""
_POINTS = 12
"""Angles that are tried in a period."""
_TELLS = 4.0
"""Difference of the cost between angles from which a run tells its own: two sigma."""
_ROUNDS = 3
_MOVE = 0.1
"""Difference by which slopes are taken, in spreads."""
_FURTHEST = 0.5
"""Longest step, in spreads."""


def is_periodic(effect: BoundEffect) -> bool:
    """Whether an effect is periodic in the shaft's angle: it has a `count` and a `phase`."""
    names = {parameter.name for parameter in effect.parameters}
    return {"count", "phase"} <= names


def counts_on(layout: Layout, vector: FloatArray) -> list[float]:
    """Return the periods a revolution of everything periodic that a vector has on."""
    return [
        max(1.0, float(vector[layout.index[f"{effect.id}.count"]]))
        for effect in periodic_effects(layout, vector)
    ]


def periodic_effects(layout: Layout, vector: FloatArray) -> list[BoundEffect]:
    """Return the effects that are periodic in an angle and that a vector has on."""
    return [
        effect
        for effect in layout.effects
        if is_periodic(effect)
        and vector[layout.index[f"{effect.id}.{effect.strength.name}"]] != effect.neutral
    ]


def without_periodic(layout: Layout, vector: FloatArray) -> FloatArray:
    """Return a vector with nothing on that is periodic in an angle."""
    off = vector.copy()
    for effect in periodic_effects(layout, vector):
        off[layout.index[f"{effect.id}.{effect.strength.name}"]] = effect.neutral
    return off


def begin_apart(
    common: float, apart: float, more: int, *, level: float = 1.0, tries: int = 1
) -> bool:
    """Whether runs begin at different angles.

    Args:
        common: fall of the cost with one angle for all runs. apart: with one each.
        more: how many more numbers that takes.
        level: by how much chance gains more than noise would (1: the residual is noise).
        tries: how many times it was asked (Bonferroni).
    """
    chance = level * float(chdtri(more, _CHANCE / tries))
    return common < _NEARLY * apart and apart - common > chance


def starts_of(problem: Problem) -> dict[str, StartAngle]:
    """Return the start angles that are estimated, by run."""
    measured = (window.measured for window in problem.windows)
    return {item.run.name: item.start for item in measured if item.start.is_estimated}


def angles_of(problem: Problem) -> dict[str, float]:
    """Return the angle at which each run begins, rad, by run."""
    measured = (window.measured for window in problem.windows)
    return {item.run.name: item.start.value for item in measured}


def rows_of_runs(problem: Problem) -> dict[str, IndexArray]:
    """Return the places of each run in the stacked residual, in the order of the runs."""
    windows: dict[str, list[int]] = {}
    for number, window in enumerate(problem.windows):
        windows.setdefault(window.measured.run.name, []).append(number)
    return {name: problem.rows_of(own) for name, own in windows.items()}


def with_refined_angles(problem: Problem, vector: FloatArray) -> Problem:
    """Return a problem whose runs begin where each fits best, near where they begin now.

    Angles that are taken for known stay, and where all are it is the problem itself.
    """
    starts = starts_of(problem)
    if not starts or not counts_on(problem.plant.layout, vector):
        return problem
    rows = {name: own for name, own in rows_of_runs(problem).items() if name in starts}
    residual = problem.residual(vector)
    for _ in range(_ROUNDS):
        soft, weight = soften(residual, problem.soft)
        turned = {name: _by(start, _MOVE * start.spread) for name, start in starts.items()}
        change = (problem.at_angles(turned).residual(vector) - residual) * weight
        trial = {}
        for name, start in starts.items():
            slope, own = change[rows[name]], soft[rows[name]]
            square = float(slope @ slope)
            step = -float(slope @ own) / square if square > 0.0 else 0.0
            step = float(np.clip(step * _MOVE, -_FURTHEST, _FURTHEST))
            trial[name] = _by(start, step * start.spread)
        after = problem.at_angles(trial).residual(vector)
        new, _ = soften(after, problem.soft)
        better = [n for n, k in rows.items() if float(new[k] @ new[k]) < float(soft[k] @ soft[k])]
        if not better:
            break
        starts |= {name: trial[name] for name in better}
        problem = problem.at_angles(starts)
        for name in better:
            residual[rows[name]] = after[rows[name]]
    return problem


def own_angles(problem: Problem, vector: FloatArray) -> dict[str, StartAngle]:
    """Return the angles at which runs begin, by run; nothing where they may all begin at zero.

    Args:
        problem: the runs. vector: of a model that may have something periodic on.
    """
    layout = problem.plant.layout
    if not counts_on(layout, vector):
        return {}
    short = _short_windows(problem, vector)
    if short is None:
        return {}
    starts, common, apart = _scan_angles(short, vector)
    nothing = cost_of(short, without_periodic(layout, vector))
    level = max(1.0, apart / (SOFT_MEAN * short.size))
    more = len(rows_of_runs(short))
    if not begin_apart(nothing - common, nothing - apart, more, level=level):
        return {}
    return _refine_angles(problem, short.at_angles(starts), vector)


def estimated_angles(problem: Problem, vector: FloatArray) -> dict[str, StartAngle]:
    """Return the angle at which each run fits best, by run; those that do not tell are not there.

    Args:
        problem: the runs. vector: of a model with something periodic on.
    """
    if not counts_on(problem.plant.layout, vector):
        return {}
    short = _short_windows(problem, vector)
    if short is None:
        return {}
    return _refine_angles(problem, short.at_angles(_scan_angles(short, vector)[0]), vector)


def angles_note(starts: Mapping[str, StartAngle]) -> str:
    """Say in words where runs begin."""
    each = ", ".join(f"{name} {start.value:.3g}" for name, start in starts.items())
    return f"the shaft's angle at the start of each run was estimated from the run, in rad: {each}"


def _scan_angles(short: Problem, vector: FloatArray) -> tuple[dict[str, StartAngle], float, float]:
    """Return the best of some angles for each run, and the cost with zero and with these.

    A run that fits equally well at every angle has no estimate. Short windows begin at measured
    angles, so no other parameter has to be right.
    """
    counts = counts_on(short.plant.layout, vector)
    common = math.gcd(*(round(count) for count in counts))
    period, spread = 2.0 * math.pi / common, 1.0 / max(counts)
    tries = _POINTS * math.ceil(max(counts) / common)
    rows = rows_of_runs(short)
    tried: dict[str, list[tuple[float, float]]] = {name: [] for name in rows}
    costs = []
    for number in range(tries):
        angle = math.remainder(period * number / tries, period)
        moved = short.at_angles(dict.fromkeys(rows, StartAngle(angle, spread)))
        soft, _ = soften(moved.residual(vector), short.soft)
        costs.append(float(soft @ soft))
        for name, own in rows.items():
            tried[name].append((float(soft[own] @ soft[own]), angle))
    best = {name: min(own) for name, own in tried.items()}
    starts = {
        name: StartAngle(angle, spread)
        for name, (cost, angle) in best.items()
        if max(tried[name])[0] - cost > _TELLS
    }
    return starts, costs[0], sum(cost for cost, _ in best.values())


def _refine_angles(problem: Problem, short: Problem, vector: FloatArray) -> dict[str, StartAngle]:
    """Return the angles refined over short windows, and then over the problem's own."""
    long = problem.at_angles(starts_of(with_refined_angles(short, vector)))
    long.prepare(vector)
    long.scale_to(long.residual(vector))
    return starts_of(with_refined_angles(long, vector))


def _short_windows(problem: Problem, vector: FloatArray) -> Problem | None:
    """Return the same runs over short windows, prepared; None where they are shorter still."""
    short = medium_problem(problem)
    if not short.windows:
        return None
    short.prepare(vector)
    short.scale_to(short.residual(vector))
    return short


def _by(start: StartAngle, turn: float) -> StartAngle:
    return StartAngle(start.value + turn, start.spread)
