"""What one night's recordings say of every cause: the likelihood's slope and curvature.

The model's parameters are calibrated on the night, from where they were the night before; an effect
that stands out is fitted with them. About that point the log-likelihood is a parabola in what may
have changed,

    l(d) = l(0) + g' d - d' A d / 2,      A = J' J,   g = J' r,

with r the whitened residual and J minus its derivative by the causes, both under the loss of the
fits (`diagnosis.fit`). What a run alone has (an unmeasured load, a log's lateness) is profiled out.
Put back to the machine as it was watched first, A and g of every run are all that later questions
need: a cause alone, several together, runs and nights added up (an extended information filter:
Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, Wiley 2001,
section 7.2).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final

import numpy as np

from eha_bench.causes.cause import Cause
from eha_bench.core.arrays import FloatArray, IndexArray
from eha_bench.core.errors import EhaBenchError
from eha_bench.core.finite import finite_or_none
from eha_bench.diagnosis.data.dataset import Dataset, Run
from eha_bench.diagnosis.fit.baseline import COARSE, gather
from eha_bench.diagnosis.fit.least_squares import free_parameters, jacobian, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem, cost_of, soften

_SHOWS: Final = 30.0
"""Least change of the residual by a cause's difference, in standard deviations of the noise."""
_SHOWN: Final = 100.0
"""The same from which a difference is made smaller: a delay of half a tick is not half of two."""
_SMALLEST: Final = 1e-3
_LARGEST: Final = 10.0
"""Most that a difference is widened by until it shows."""
_BLIND: Final = 1.0
"""Below this change, by the widest difference, a night says nothing of a cause."""
_STANDS_OUT: Final = 100.0
"""Gain (chi square) beyond the parameters' from which an effect is fitted with them."""
_ROUNDS: Final = 4
_MOVED: Final = 1.3
"""Cost over the reference's from which the machine is not where it was the night before."""
_TRIED: Final = 4
"""Causes that are fitted at most where much has changed."""
_NEARLY: Final = 0.5
"""Part of the best effect's gain from which another is fitted as well: slopes cannot tell them."""
_SHARES: Final = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""Of the way that a cause's slope asks for: far off, slopes are good for the direction only."""
_SPOILT: Final = 10.0
"""Cost of a night over the reference's, after its fit, from which nothing of it is believed."""


@dataclass(frozen=True)
class RunEvidence:
    """What one run of a night says.

    Attributes:
        run: its name, the same every night. slope: (p,) g at the reference.
        curvature: (p, p) A; both in steps of the causes, zero where the run is blind to one.
    """

    run: str
    slope: FloatArray
    curvature: FloatArray


@dataclass(frozen=True)
class NightEvidence:
    """What a night says.

    Attributes:
        names: of the causes. parts: of every run that could be compared.
        point: key -> value where the parabola touches, SI: where the next night begins.
        cost: there. size: number of residuals.
        oil_temperature: K, NaN where it was not logged.
        failed: why there is none, "" where there is.
        fitted: name of each effect that was fitted with the parameters -> cost that it left; the
            parabola is about the least.
    """

    names: tuple[str, ...]
    parts: tuple[RunEvidence, ...]
    point: Mapping[str, float]
    cost: float
    size: int
    oil_temperature: float = math.nan
    failed: str = ""
    fitted: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def slope(self) -> FloatArray:
        """Return (p,) g of all runs."""
        return sum((part.slope for part in self.parts), np.zeros(len(self.names)))

    @cached_property
    def curvature(self) -> FloatArray:
        """Return (p, p) A of all runs."""
        count = len(self.names)
        return sum((part.curvature for part in self.parts), np.zeros((count, count)))

    @property
    def runs(self) -> frozenset[str]:
        """Names of its runs."""
        return frozenset(part.run for part in self.parts)

    def of(self, runs: Collection[str]) -> NightEvidence:
        """Return what some of its runs say."""
        parts = tuple(part for part in self.parts if part.run in runs)
        return self if len(parts) == len(self.parts) else replace(self, parts=parts)

    @staticmethod
    def none(names: Sequence[str], why: str, oil: float = math.nan) -> NightEvidence:
        """Return the evidence of a night that has none, and why."""
        return NightEvidence(tuple(names), (), {}, math.nan, 0, oil, why)

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        return {
            "causes": list(self.names),
            "runs": [
                {"run": part.run, "slope": part.slope.tolist(),
                 "curvature": part.curvature.tolist()}
                for part in self.parts
            ],
            "point": dict(self.point),
            "cost": finite_or_none(self.cost),
            "size": self.size,
            "oil_temperature": finite_or_none(self.oil_temperature),
            "failed": self.failed,
            "fitted": dict(self.fitted),
        }  # fmt: skip

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> NightEvidence:
        """Return what `to_dict` gave."""
        count = len(data["causes"])
        oil, cost = data["oil_temperature"], data["cost"]
        return NightEvidence(
            tuple(map(str, data["causes"])),
            tuple(
                RunEvidence(
                    str(part["run"]),
                    np.array(part["slope"], dtype=np.float64).reshape(count),
                    np.array(part["curvature"], dtype=np.float64).reshape(count, count),
                )
                for part in data["runs"]
            ),
            {str(key): float(value) for key, value in data["point"].items()},
            math.nan if cost is None else float(cost),
            int(data["size"]),
            math.nan if oil is None else float(oil),
            str(data["failed"]),
            {str(key): float(value) for key, value in data["fitted"].items()},
        )


@dataclass(frozen=True)
class Reference:
    """The machine as it was when it was watched first.

    Attributes:
        vector: (layout.size,) SI, calibrated on the first nights.
        noise: channel -> standard deviation, SI. soft: scale of the loss.
        level: cost over number of residuals.
        differences: cause -> difference that shows it, in its steps; 1 where unsaid.
    """

    vector: FloatArray
    noise: Mapping[str, float]
    soft: float
    level: float
    differences: Mapping[str, float] = field(default_factory=dict)


def evidence_of(
    dataset: Dataset,
    reference: Reference,
    causes: Sequence[Cause],
    before: Mapping[str, float] | None = None,
) -> NightEvidence:
    """Return what the training runs of a dataset, one night's, say of the causes.

    Args:
        dataset: a night's runs and the model. reference: what changes are counted from.
        causes: what is followed.
        before: the night before's `NightEvidence.point`.
    """
    names = tuple(cause.name for cause in causes)
    oil = _oil_temperature(dataset.training)
    try:
        _, windows, noise, _ = gather(dataset)
    except EhaBenchError as error:
        return NightEvidence.none(names, str(error), oil)
    known = {name: reference.noise.get(name, level) for name, level in noise.items()}
    problem = Problem(dataset.model.plant, windows, known, COARSE)
    problem.soft = reference.soft
    found = _Night(problem, reference, causes, before or {}).evidence(oil)
    level = found.cost / max(1, found.size)
    if math.isfinite(level) and level <= _SPOILT * max(1.0, reference.level):
        return found
    why = (
        "its calibration does not converge: the model stays "
        f"{math.sqrt(level):.3g} standard deviations of the noise away"
    )
    return NightEvidence.none(names, why, oil)


def differences_of(
    problem: Problem, reference: Reference, causes: Sequence[Cause]
) -> dict[str, float]:
    """Return by how many of its steps each cause has to change until it shows."""
    return _Night(problem, reference, causes, {}).differences()


def _oil_temperature(runs: Sequence[Run]) -> float:
    """Return the mean logged oil temperature of runs, K; NaN where it was not logged."""
    found = []
    for run in runs:
        try:
            logged = run.read().values.get("oil_temperature")
        except EhaBenchError:
            continue
        if logged is not None and np.isfinite(logged).any():
            found.append(float(np.nanmean(logged)))
    return float(np.mean(found)) if found else math.nan


class _Night:
    """One night's residuals, calibrated from the night before."""

    def __init__(
        self,
        problem: Problem,
        reference: Reference,
        causes: Sequence[Cause],
        before: Mapping[str, float],
    ) -> None:
        self._problem, self._causes = problem, tuple(causes)
        self._index = problem.places.index
        self._reference = problem.places.lengthened(reference.vector)
        self._own_keys = [item.key for item in problem.places.behind]
        self._parameters = [k for k, cause in enumerate(causes) if cause.is_calibrated]
        self._level = max(1.0, reference.level)
        self._differences = dict(reference.differences)
        self._extra: int | None = None
        self._fitted: dict[str, float] = {}
        vector = self._reference.copy()
        for k in self._parameters:
            cause = self._causes[k]
            if cause.key in before:
                vector = cause.apply(vector, before[cause.key])
        # the night before may have been a strange one
        starts = [vector, self._reference]
        costs = []
        for start in starts:
            self._begin_at(start)
            costs.append(self._cost)
        self._vector = starts[int(np.argmin(costs))].copy()

    def evidence(self, oil: float) -> NightEvidence:
        """Return what the night says."""
        columns: list[FloatArray] = [np.zeros(0)] * len(self._causes)
        self._calibrate(self._with_one_cause_moved())
        for k, cause in enumerate(self._causes):
            columns[k] = self._slope(cause)
        further = self._best(self._outstanding(columns)) if self._extra is None else None
        if further is not None:
            place = self._causes[further].place
            for k, other in enumerate(self._causes):
                if other.place != place or k == further:
                    columns[k] = self._slope(other)
        extra = self._extra
        matrix = np.column_stack([self._profiled(column) for column in columns])
        rest = self._profiled(self._soft)
        moved = np.array([
            (self._vector[cause.place] - self._reference[cause.place]) / cause.step
            if cause.is_calibrated or k == extra
            else 0.0
            for k, cause in enumerate(self._causes)
        ])  # fmt: skip
        keys = [self._causes[k].key for k in self._parameters]
        point = {key: float(self._vector[self._index[key]]) for key in keys}
        if extra is not None:
            point[self._causes[extra].name] = float(self._vector[self._causes[extra].place])
        parts = []
        for run, rows in self._rows_by_run().items():
            own = matrix[rows]
            curvature = own.T @ own
            parts.append(RunEvidence(run, curvature @ moved - own.T @ rest[rows], curvature))
        return NightEvidence(
            tuple(cause.name for cause in self._causes), tuple(parts), point, self._cost,
            self._residual.size, oil, fitted=self._fitted,
        )  # fmt: skip

    def differences(self) -> dict[str, float]:
        """Return by how many of its steps each cause has to change until it shows."""
        self._begin_at(self._vector)
        for cause in self._causes:
            self._slope(cause)
        return self._differences

    def _rows_by_run(self) -> dict[str, IndexArray]:
        rows: dict[str, list[IndexArray]] = {}
        for piece in self._problem.pieces:
            run = self._problem.windows[piece.window].measured.run.name
            rows.setdefault(run, []).append(np.arange(piece.rows.start, piece.rows.stop))
        return {run: np.concatenate(found) for run, found in rows.items()}

    def _with_one_cause_moved(self) -> Cause | None:
        """Move to where the cause that explains most alone has its minimum, if much moved.

        Far off, all parameters together find another minimum, which says nothing. Returns
        the cause where it is an effect.
        """
        self._begin_at(self._vector)
        if self._cost <= _MOVED * self._level * self._residual.size:
            return None
        columns = [self._slope(cause) for cause in self._causes]
        squares = np.array([float(column @ column) for column in columns])
        slopes = np.array([-float(column @ self._soft) for column in columns])
        known = squares > 0.0
        gains = np.where(known, slopes**2 / np.where(known, squares, 1.0), 0.0)
        best, start = self._cost, self._vector
        which: Cause | None = None
        for k in np.argsort(-gains)[:_TRIED]:
            if gains[k] <= 0.0:
                continue
            cause, move = self._causes[k], float(slopes[k] / squares[k])
            vector, cost = self._alone(cause, move * cause.step)
            if cost < best:
                best, start, which = cost, vector, cause
        self._vector = start
        if which is None or which.is_calibrated:
            return None
        self._begin = float(start[which.place])
        return which

    def _begin_at(self, vector: FloatArray) -> None:
        self._problem.prepare(vector)
        self._residual = self._problem.residual(vector)
        self._soft, self._weight = soften(self._residual, self._problem.soft)
        self._cost = float(self._soft @ self._soft)
        self._own: FloatArray | None = None

    def _alone(self, cause: Cause, move: float) -> tuple[FloatArray, float]:
        """Return the minimum along one cause, and its cost."""
        here = float(self._vector[cause.place])
        tried = [cause.apply(self._vector, here + share * move) for share in _SHARES]
        costs = [cost_of(self._problem, vector) for vector in tried]
        vector = tried[int(np.argmin(costs))]
        free = free_parameters(self._problem.places, [cause.key], vector)
        fit = levenberg_marquardt(self._problem, vector, free, iterations=_ROUNDS)
        return fit.vector, fit.cost

    def _calibrate(self, extra: Cause | None) -> None:
        """Fit the parameters (and one effect) from where they are; say so of what it left."""
        problem = self._problem
        keys = [self._causes[k].key for k in self._parameters]
        if extra is not None:
            self._vector = extra.apply(self._vector, self._begin)
            keys.append(extra.key)
            self._extra = self._causes.index(extra)
        problem.prepare(self._vector)
        free = free_parameters(problem.places, [*keys, *self._own_keys], self._vector)
        fit = levenberg_marquardt(problem, self._vector, free, iterations=_ROUNDS, refresh=1)
        self._vector = fit.vector
        self._residual = fit.residual
        self._soft, self._weight = soften(fit.residual, problem.soft)
        self._cost = fit.cost
        own = free_parameters(problem.places, self._own_keys, self._vector)
        # the runs' own parameters are profiled out: only what is not theirs counts
        self._own = None
        if own:
            beside = jacobian(problem, self._vector, own, self._residual)
            self._own = np.linalg.qr(beside * self._weight[:, None])[0]

    def _profiled(self, column: FloatArray) -> FloatArray:
        if self._own is None:
            return column
        return np.asarray(column - self._own @ (self._own.T @ column))

    def _best(self, effects: Mapping[int, float]) -> int | None:
        """Fit each of some effects with the parameters, from a value; return and keep the best."""
        kept: tuple[float, int] | None = None
        start, state = self._vector, None
        for k, value in effects.items():
            self._vector, self._begin = start.copy(), value
            self._calibrate(self._causes[k])
            self._fitted[self._causes[k].name] = self._cost
            if kept is None or self._cost < kept[0]:
                kept = self._cost, k
                state = self._vector, self._residual, self._soft, self._weight, self._own
        if kept is None or state is None:
            return None
        self._cost, self._extra = kept
        self._vector, self._residual, self._soft, self._weight, self._own = state
        self._problem.prepare(self._vector)
        return self._extra

    def _outstanding(self, columns: Sequence[FloatArray]) -> dict[int, float]:
        """Return the effects that explain most of what the parameters leave, with their values.

        None where that is not much.
        """
        base = np.column_stack([*(columns[k] for k in self._parameters), np.zeros_like(self._soft)])
        if self._own is not None:
            base = np.column_stack([base, self._own])
        left, sizes, _ = np.linalg.svd(base, full_matrices=False)
        left = left[:, sizes > 1e-9 * max(float(sizes.max(initial=0.0)), 1e-300)]
        rest = self._soft - left @ (left.T @ self._soft)
        found: dict[int, tuple[float, float]] = {}
        for k, cause in enumerate(self._causes):
            if cause.is_calibrated:
                continue
            column = columns[k] - left @ (left.T @ columns[k])
            square = float(column @ column)
            if square < _BLIND**2 or square < 1e-8 * float(columns[k] @ columns[k]):
                continue
            move = -float(column @ rest) / square
            value = float(self._reference[cause.place]) + move * cause.step
            gain = move * move * square
            if gain > _STANDS_OUT and cause.low <= value <= cause.high:
                found[k] = gain, value
        order = sorted(found, key=lambda k: -found[k][0])[:_TRIED]
        return {k: found[k][1] for k in order if found[k][0] >= _NEARLY * found[order[0]][0]}

    def _slope(self, cause: Cause) -> FloatArray:
        """Return the softened residual's derivative by steps of a cause, zero where it is blind."""
        share = self._differences.get(cause.name, 1.0)
        here = float(self._vector[cause.place])
        enough, plenty = _SHOWS * self._problem.soft, _SHOWN * self._problem.soft
        while True:
            if here + share * cause.step > cause.high:
                share = -share
            value = here + share * cause.step
            moved = self._problem.residual(cause.apply(self._vector, value)) - self._residual
            size = float(np.linalg.norm(moved))
            if cause.name not in self._differences and size > plenty and share > _SMALLEST:
                share = max(_SMALLEST, share * max(0.1, 0.7 * plenty / size))
                continue
            if size >= enough or abs(share) >= _LARGEST:
                break
            share *= min(_LARGEST / abs(share), max(2.0, enough / max(size, 1e-12)))
        self._differences.setdefault(cause.name, abs(share))
        if size < _BLIND or not math.isfinite(size):
            return np.zeros_like(moved)
        return moved * self._weight / share
