"""How friction behaves at rest: it sticks, or creeps at a speed that no data sheet declares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.least_squares import Fit, free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem, cost_of
from eha_bench.plants.layout import Layout

_CREEPS = "creep_speed"
_AT_REST: Mapping[str, tuple[float, ...]] = {
    "m/s": (0.0, 1e-5, 1e-4, 1e-3),
    "rad/s": (0.0, 1e-3, 1e-2, 1e-1),
}
"""Speeds over which friction may creep at rest, by their unit."""
_ALIKE = 0.1
"""Share by which two such speeds differ that are one."""
TELLING = 20.0
"""Fall of the cost that says that friction at rest is another one."""
_HOPELESS, _FAR_OFF = 50.0, 0.05
"""Rise of the cost with start states as they are, in `TELLING` and as a share of it, from which
other start states make nothing good: of a fan they took back 19 of `TELLING`, and 13 % of it."""


def is_friction_at_rest(key: str) -> bool:
    """Whether a parameter says how friction behaves at rest.

    No data sheet declares that: it is always fitted, and never an effect. Sticking (0) is
    asked for again like any other: creeping may have imitated what was missing.
    """
    return key.endswith(_CREEPS)


def friction_at_rest_of(layout: Layout) -> dict[str, tuple[float, ...]]:
    """Return the speeds that are tried for how friction behaves at rest, by parameter."""
    return {
        item.name: _AT_REST[item.unit]
        for item in layout.parameters
        if is_friction_at_rest(item.name) and item.unit in _AT_REST
    }


def sticks(key: str, value: float) -> bool:
    """Whether friction at rest has come back to sticking: free there, it spoils a Jacobian."""
    return is_friction_at_rest(key) and value == 0.0


def at_rest(problem: Problem, fit: Fit) -> Fit:
    """Return a fit with friction at rest as the data ask for: sticking, or creeping at any speed.

    The spread of start states depends on how friction creeps, so the problem is prepared again
    for each fit that is compared, and for the one returned.
    """
    layout = problem.plant.layout
    vector = fit.vector
    for key, sizes in friction_at_rest_of(layout).items():
        moving = [
            k
            for k, window in enumerate(problem.windows)
            if layout.by_key[key].unit == "rad/s" or not window.measured.run.locked
        ]
        if not moving:
            continue
        at = layout.index[key]
        part = problem.subset(moving).apart()
        own = float(vector[at])
        # a fit moves it by so little itself
        others = [size for size in sizes if abs(size - own) > _ALIKE * own]
        trials = {size: _with(vector, at, size) for size in dict.fromkeys((own, *others))}
        part.prepare_starts(vector)
        roughly = {size: cost_of(part, trial) for size, trial in trials.items()}
        costs = {own: roughly[own]}
        for size in others:
            # a start state moves a cost by a part of what friction at rest does
            if roughly[size] - costs[own] < max(_HOPELESS * TELLING, _FAR_OFF * costs[own]):
                part.prepare_starts(trials[size])
                costs[size] = cost_of(part, trials[size])
        size = min(costs, key=lambda size: costs[size])
        if costs[size] < costs[own] - TELLING:
            vector = trials[size]
    held = _declared_and_held(layout, fit)
    if vector is fit.vector and not held:
        return fit
    problem.prepare(vector)
    return _along(problem, fit, vector, held)


def _declared_and_held(layout: Layout, fit: Fit) -> list[str]:
    """Return the creeping that was declared, and that a fit does not move.

    Held there, every candidate would be credited with what moving it gains.
    """
    moved = {item.key for item in fit.free}
    return [
        key
        for key in friction_at_rest_of(layout)
        if key not in moved and fit.vector[layout.index[key]] != 0.0
    ]


def _with(vector: FloatArray, at: int, size: float) -> FloatArray:
    trial = vector.copy()
    trial[at] = size
    return trial


def friction_at_rest(problem: Problem, fit: Fit) -> Fit:
    """Return a fit with friction at rest as the data ask for, in a problem prepared as it is."""
    layout = problem.plant.layout
    for key, sizes in friction_at_rest_of(layout).items():
        at = layout.index[key]
        best, cost = fit.vector, fit.cost
        for size in sizes:
            trial = _with(fit.vector, at, size)
            if (reached := cost_of(problem, trial)) < cost:
                best, cost = trial, reached
        if best is not fit.vector:
            moved = _along(problem, fit, best)
            if moved.cost < fit.cost - TELLING:
                fit = moved
    return fit


def _along(problem: Problem, fit: Fit, vector: FloatArray, held: Sequence[str] = ()) -> Fit:
    """Return the fit from a vector whose friction at rest is another one.

    Args:
        problem, fit: where it begins. vector: with other friction at rest. held: friction at rest
            that is the same there, and is fitted from now on.
    """
    layout = problem.plant.layout
    changed = [
        key
        for key in friction_at_rest_of(layout)
        if key in held or vector[layout.index[key]] != fit.vector[layout.index[key]]
    ]
    known = {key: column for key, column in fit.columns.items() if key not in changed}
    creeps = [key for key in changed if vector[layout.index[key]] != 0.0]
    free = [item for item in fit.free if item.key not in changed]
    free += free_parameters(layout, creeps, vector)
    return levenberg_marquardt(problem, vector, free, iterations=4, known=known, refresh=0)
