"""Levenberg-Marquardt with bounds on the simulation error.

Finite differences of 1 % or more (stick events make smaller ones noise), soft-L1 at 5 sigma, steps
cut at the bounds by a few active-set passes. A Jacobian costs one simulation a parameter, so it is
updated by Broyden's rule while that works, and computed again only where it does not.

Sources: Moré, The Levenberg-Marquardt algorithm: implementation and theory (1978),
doi:10.1007/BFb0067700; Broyden, Math. Comp. 19 (1965) 577, doi:10.1090/S0025-5718-1965-0198670-6.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.own_parameters import Places
from eha_bench.diagnosis.fit.problem import SLOPES, Problem, soften
from eha_bench.diagnosis.fit.side_by_side import side_by_side
from eha_bench.plants.layout import Layout

_DIFFERENCE = 0.01
_LARGEST_DIFFERENCE = 1.0
_SMALLEST_DIFFERENCE = 1e-18
_FINER = 0.01
_ABSURD = 1e4
"""Multiple of the least size of a change from which a difference says nothing of a slope."""
_SHOWS = 10.0
"""Least size of the change of the residual by a difference, in standard deviations of the noise."""
_STANDS_OUT = 60.0
"""The same for what may be hardly there."""
_TELLS = 5.0
"""Least size of a step's change of the residual from which the Jacobian learns."""
_WORTH = 0.002
"""Share of what is unexplained that a step gains at least, of a fit that goes on."""
_STALLED = 5.0
"""Multiple of that from which a Jacobian that was updated is good enough."""
_PROMISING = 30.0
"""Fall of the cost that a step promises from which shorter ones are tried, if it leads nowhere."""
_SHORT = 0.3
"""Damping of the first of these."""
_AT_BOUND = 1e-9
"""Distance from a bound, in a change that matters, that is a rounding."""
_NONSENSE = 10.0
"""Size of that change, in residuals, from which it does not."""


@dataclass(frozen=True)
class Free:
    """One number that a fit may move.

    Attributes:
        key: `name` of the plant's parameter or `effect.name`; `name in run` for a run's own.
        at: place in the vector.
        low, high: bounds, SI.
        scale: a change that matters, SI.
        of_effect: whether it is an effect's, which may be hardly there.
        run: the run that it belongs to, which alone determines it; "" for all runs.
        of_log: whether it is the log's (how late stamps are), and not the machine's.
    """

    key: str
    at: int
    low: float
    high: float
    scale: float
    of_effect: bool = False
    run: str = ""
    of_log: bool = False


@dataclass(frozen=True)
class Fit:
    """The end of a fit.

    Attributes:
        vector: parameters.
        free: what moved.
        residual: (N,) whitened residual there, that of beliefs at its end.
        jacobian: (N, p) its derivative by scaled parameters (last one computed).
        cost: sum of soft-L1 losses of the residual.
        steps: accepted steps.
        soft: scale of the soft-L1 loss.
        beliefs: how many rows are not readings but beliefs.
    """

    vector: FloatArray
    free: tuple[Free, ...]
    residual: FloatArray
    jacobian: FloatArray
    cost: float
    steps: int = 0
    soft: float = 1.0
    beliefs: int = 0

    @property
    def columns(self) -> dict[str, FloatArray]:
        """Return the Jacobian's columns by key."""
        return {item.key: self.jacobian[:, k] for k, item in enumerate(self.free)}

    def values(self) -> dict[str, float]:
        """Return the fitted values by key."""
        return {item.key: float(self.vector[item.at]) for item in self.free}


def calibrated_directions(
    fit: Fit, soft: float, least: float = 1e-6
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the softened residual, its weights, both (N,), and what parameters can do, (N, k).

    Args:
        fit: with its slopes. soft: scale of the loss. least: size of a slope, in the largest one's,
            from which it is a direction; they are orthonormal.
    """
    residual, weight = soften(fit.residual, soft)
    matrix = fit.jacobian * weight[:, None]
    norms = np.linalg.norm(matrix, axis=0)
    basis = np.linalg.qr(matrix[:, norms > least * norms.max(initial=1e-300)])[0]
    return residual, weight, basis


def free_parameters(
    layout: Layout | Places,
    keys: Sequence[str],
    vector: FloatArray,
    spans: Mapping[str, float] | None = None,
) -> tuple[Free, ...]:
    """Return parameters of a layout as free numbers.

    Args:
        layout: of the plant, or with the runs' own parameters.
        keys: `name` or `effect.name`; one that holds several numbers gives as many.
        vector: where the fit starts; the scale of a parameter is its size there, or its default's,
            or what is usual.
        spans: key -> scale, where neither says one.
    """
    found = []
    places = layout if isinstance(layout, Places) else Places(layout)
    plants_own = {parameter.name for parameter in places.layout.parameters}
    logs = {item.key for item in places.late}
    for key in keys:
        parameter = layout.by_key[key]
        run = places.runs.get(key, "")
        of_effect = not run and key not in plants_own and key not in logs
        for k in range(parameter.size):
            at = layout.index[key] + k
            scale = max(abs(vector[at]), 0.1 * abs(parameter.default))
            if spans and key in spans:
                scale = spans[key]
            scale = scale or parameter.usual
            if scale == 0.0:
                width = parameter.high - parameter.low
                scale = 0.1 * width if np.isfinite(width) else 1.0
            name = key if parameter.size == 1 else f"{key}[{k}]"
            low, high = places.bounds(key, vector)
            bounds = max(parameter.low, low), min(parameter.high, high)
            found.append(Free(name, at, *bounds, float(scale), of_effect, run, key in logs))
    return tuple(found)


def jacobian(
    problem: Problem,
    vector: FloatArray,
    free: Sequence[Free],
    base: FloatArray,
    known: Mapping[str, FloatArray] | None = None,
) -> FloatArray:
    """Return d residual / d (parameter / scale), (N, p), by one-sided differences.

    A slope needs no fine step of integration: both ends are off by the same.
    """
    known = known or {}
    if problem.step < SLOPES and any(item.key not in known for item in free):
        problem = problem.at_step(SLOPES)
        base = problem.residual(vector)
    asked = [item for item in free if item.key not in known]
    slopes = side_by_side(lambda item: _slope_of(problem, vector, item, base), asked)
    found = dict(zip((item.key for item in asked), slopes, strict=True))
    columns = [known[item.key] if item.key in known else found[item.key] for item in free]
    # column by column in memory: a hundred thousand rows are multiplied and updated that way
    return np.array(columns).T if columns else np.zeros((base.size, 0))


def _slope_of(problem: Problem, vector: FloatArray, item: Free, base: FloatArray) -> FloatArray:
    """Return one column; what belongs to one run takes only that run's simulation."""
    if not item.run:
        return _slope(problem, vector, item, base)
    part, rows = problem.of_run(item.run)
    column = np.zeros(base.size)
    if rows.size:
        column[rows] = _slope(part, vector, item, base[rows])
    return column


def _slope(problem: Problem, vector: FloatArray, item: Free, base: FloatArray) -> FloatArray:
    """Return one column, by a difference large enough to stand out.

    Every instant of sticking that a difference shifts from one integration step to another adds
    noise. Where a parameter does little, that noise would pass for its effect, and the parameter
    for well determined. That threatens effects, which may be hardly there at all.
    """
    enough = problem.soft * (_STANDS_OUT if item.of_effect else _SHOWS)
    relative, absurd = _DIFFERENCE, np.inf
    while True:
        step = _within(relative * item.scale, vector[item.at], item)
        if step == 0.0:
            return np.zeros(base.size)
        moved = vector.copy()
        moved[item.at] += step
        change = problem.residual(moved) - base
        size = float(np.linalg.norm(change))
        if vector[item.at] == 0.0 and size > _ABSURD * enough and relative > _SMALLEST_DIFFERENCE:
            # nothing was declared: its scale is a guess
            absurd, relative = relative, relative * _FINER
            continue
        wider = min(_LARGEST_DIFFERENCE, relative * max(enough / max(size, 1e-300), 2.0))
        if size >= enough or relative >= _LARGEST_DIFFERENCE or wider >= absurd:
            return np.asarray(change * (item.scale / step), dtype=np.float64)
        relative = wider


def _within(step: float, value: float, item: Free) -> float:
    """Return a difference as large as the bounds let it be, down where there is no room upwards."""
    if value + step <= item.high:
        return step
    above, below = item.high - value, value - item.low
    return above if above >= below else -min(step, below)


def levenberg_marquardt(
    problem: Problem,
    vector: FloatArray,
    free: Sequence[Free],
    *,
    iterations: int = 12,
    tolerance: float = 1.0,
    known: Mapping[str, FloatArray] | None = None,
    refresh: int = 2,
    tries: int = 4,
    share: float = _WORTH,
    watch: Callable[[FloatArray], None] | None = None,
) -> Fit:
    """Minimise the soft-L1 cost of a problem over the free parameters.

    Args:
        problem: residuals.
        vector: start.
        free: what may move.
        iterations: most steps.
        tolerance: fall of the cost in one step that ends it (a cost of 1 is one sigma).
        known: columns of a Jacobian from nearby, by key, to start with.
        refresh: how often the Jacobian may be computed again.
        tries: of a step from a Jacobian that is, each ten times shorter: far from the minimum a
            slope holds only nearby. Twice as many where much is promised: what hardly shows (the
            angle of a weight that is still small) asks for steps that lead nowhere.
        share: of what is unexplained that a step has to gain as well: where much is, the last
            digits of the parameters do not matter; 0 for a fit to the bottom.
        watch: given every vector that is better than all before.
    """
    at = _Descent(problem, vector.copy(), tuple(free), known)
    if not at.free:
        return at.fit_after(0)
    taken = 0
    for _ in range(iterations):
        before = at.cost
        if at.improve(tries):
            taken += 1
            if watch:
                watch(at.vector)
        gain = before - at.cost
        stalled = gain < max(tolerance, _STALLED * share * (at.cost - problem.size))
        enough = max(tolerance, share * (at.cost - problem.size))
        if gain < enough and at.fresh:
            break
        if stalled and not at.fresh:
            if refresh <= 0:
                break
            at.refresh()
            refresh -= 1
        elif gain:
            at.fresh = False
    return at.fit_after(taken)


class _Descent:
    """Where a fit is: the parameters, the residual there, and its slopes.

    Attributes:
        vector: parameters. cost: there. fresh: whether the slopes are computed and not updated.
    """

    def __init__(
        self,
        problem: Problem,
        vector: FloatArray,
        free: tuple[Free, ...],
        known: Mapping[str, FloatArray] | None,
    ) -> None:
        self.problem, self.vector, self.free = problem, vector, free
        self._scales = np.array([item.scale for item in free])
        self._take(vector, problem.residual(vector))
        self._matrix = np.zeros((self._residual.size, 0))
        if free:
            self._matrix = jacobian(problem, vector, free, self._residual, known)
        self._weighted = np.empty_like(self._matrix)
        self.fresh = not known
        self._damping = 1e-3

    def _take(self, vector: FloatArray, residual: FloatArray) -> None:
        self.vector, self._residual = vector, residual
        self._soft, self._weight = soften(residual, self.problem.soft)
        self.cost = float(self._soft @ self._soft)

    def refresh(self) -> None:
        """Compute the slopes again."""
        self._matrix = jacobian(self.problem, self.vector, self.free, self._residual)
        self.fresh, self._damping = True, 1e-3

    def fit_after(self, taken: int) -> Fit:
        """Return the fit as it is after some steps."""
        return Fit(self.vector, self.free, self._residual, self._matrix, self.cost, taken,
                   self.problem.soft, len(self.problem.beliefs))  # fmt: skip

    def improve(self, tries: int) -> bool:
        """Take a step that lowers the cost, and return whether there was one."""
        learnt: list[tuple[FloatArray, FloatArray]] = []
        promised = 0.0
        for attempt in range(2 * tries if self.fresh else 2):
            if attempt == tries:
                if promised < _PROMISING:
                    break
                # what led nowhere has spoilt the slopes: shorter steps, by those that are
                for unforeseen, shares in learnt:
                    self._update(unforeseen, -shares)
                self._damping = _SHORT
            np.multiply(self._matrix, self._weight[:, None], out=self._weighted)
            normal, gradient = self._weighted.T @ self._weighted, self._weighted.T @ self._soft
            step = _bounded_step(normal, gradient, self._damping, self.vector, self.free)
            if attempt < tries:
                # cut at its bounds, the longest step may promise nothing where shorter ones do
                promised = max(promised, -float(step @ (2.0 * gradient + normal @ step)))
            trial = _vector_after(self.vector, self.free, step)
            done = np.array([trial[item.at] - self.vector[item.at] for item in self.free])
            done = done / self._scales
            length = float(done @ done)
            if length == 0.0:
                break
            residual = self.problem.residual(trial)
            soft, _ = soften(residual, self.problem.soft)
            better = float(soft @ soft) < self.cost
            change = residual - self._residual
            if self._tells(change) and (attempt < tries or better):
                learnt.append((change - self._matrix @ done, done / length))
                self._update(*learnt[-1])
            if better:
                self._take(trial, residual)
                self._damping = max(self._damping / 5.0, 1e-9)
                return True
            self._damping = max(self._damping * 10.0, 1e-4)
        return False

    def _tells(self, change: FloatArray) -> bool:
        """Whether a change of the residual tells something of the slopes.

        A smaller one is the noise of sticking as much as it is the parameters', and a step into
        nonsense tells nothing of the slopes here.
        """
        size, most = float(change @ change), float(self._residual @ self._residual)
        return (_TELLS * self.problem.soft) ** 2 < size < _NONSENSE**2 * most

    def _update(self, unforeseen: FloatArray, shares: FloatArray) -> None:
        """Add to each column its share of what a step changed beyond what was foreseen."""
        for k in np.flatnonzero(shares):
            self._matrix[:, k] += unforeseen * shares[k]


def _vector_after(vector: FloatArray, free: Sequence[Free], step: FloatArray) -> FloatArray:
    """Return a vector after a step, inside its bounds and at those that it has come to.

    A step to a bound misses it by a rounding; steps from there have no size, and slopes no meaning.
    """
    trial = vector.copy()
    for item, move in zip(free, step, strict=True):
        value, near = trial[item.at] + move * item.scale, _AT_BOUND * item.scale
        if value <= item.low + near:
            value = item.low
        elif value >= item.high - near:
            value = item.high
        trial[item.at] = value
    return trial


def _bounded_step(
    normal: FloatArray,
    gradient: FloatArray,
    damping: float,
    vector: FloatArray,
    free: Sequence[Free],
) -> FloatArray:
    """Solve the damped normal equations, holding what would leave its bounds at them."""
    size = len(free)
    step = np.zeros(size)
    active = np.ones(size, dtype=np.bool_)
    diagonal = np.diag(normal) + 1e-12 * max(float(np.trace(normal)), 1e-300)
    low = np.array([(item.low - vector[item.at]) / item.scale for item in free])
    high = np.array([(item.high - vector[item.at]) / item.scale for item in free])
    for _ in range(size):
        rows = np.flatnonzero(active)
        if not rows.size:
            break
        matrix = normal[np.ix_(rows, rows)] + damping * np.diag(diagonal[rows])
        fixed = np.flatnonzero(~active)
        right = -gradient[rows] - normal[np.ix_(rows, fixed)] @ step[fixed]
        step[rows] = np.linalg.lstsq(matrix, right, rcond=1e-12)[0]
        over = active & ((step < low - 1e-12) | (step > high + 1e-12))
        if not over.any():
            break
        step[over] = np.clip(step[over], low[over], high[over])
        active &= ~over
    return np.clip(step, low, high)
