"""Curves of one variable: hats over its range, or for the time also a wave of any period."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.slopes import in_words
from eha_bench.diagnosis.fit.evidence import SOFT_MEAN, compare, groups_of
from eha_bench.diagnosis.fit.least_squares import Fit, Free
from eha_bench.diagnosis.fit.problem import Problem, soften
from eha_bench.diagnosis.fit.short_windows import WINDOW
from eha_bench.diagnosis.unknown.free_input import KNOTS
from eha_bench.diagnosis.unknown.places import SuspectPlace, Template, variables_of
from eha_bench.plants.effects.learned import KNOTS as CURVE_KNOTS

_HATS = 6
_TREND = 4
_MORE = 0.02
_NOISY = 0.1
"""Largest part of noise in the variance of a position's slope: by as much a law of it comes out too
flat (Fuller, Measurement Error Models, Wiley 1987, section 1.1)."""


@dataclass(frozen=True)
class LocatedCurve:
    """A curve at one place with what it explains.

    Attributes:
        template: equation, form, place, variable.
        share: part of the short windows' excess that it explains on runs left out.
        knots: (k,) values of the variable; values: (k,) the curve there.
        period: of the variable, 0 where not periodic.
        position: channel whose derivative the variable is; "" where it is read itself.
    """

    template: Template
    share: float
    knots: FloatArray
    values: FloatArray
    period: float = 0.0
    position: str = ""

    @property
    def follows(self) -> str:
        """The variable, and of which channel it is the derivative."""
        return in_words(self.template.variable, self.position)


class Curves:
    """What curves explain of a residual over short windows, to first order.

    Args:
        short: windows that begin at multiples of `period` in s. fit: with its Jacobian there.
    """

    def __init__(self, short: Problem, period: float, fit: Fit) -> None:
        self.short, self.period, self.fit = short, period, fit
        self.groups = groups_of(short)
        runs = len({window.measured.run.name for window in short.windows})
        # within a run, what repeats in the command repeats in time
        self.whole_runs = groups_of(short, most=runs) if runs > 1 else self.groups
        self.before = self._fit_with_columns(np.zeros((fit.residual.size, 0)))[0]
        self.excess = max(self.before.cost - SOFT_MEAN * short.size, 1.0)
        self.values = self._values()
        self.span = {
            name: (float(rows.min()), float(rows.max())) for name, rows in self.values.items()
        }

    def _values(self) -> dict[str, FloatArray]:
        """Return each variable at the instants of all windows at which an input is free, (W, m)."""
        instants = np.linspace(0.0, CURVE_KNOTS - 2.0, KNOTS) * self.period / CURVE_KNOTS
        found: dict[str, list[FloatArray]] = {}
        for window in self.short.windows:
            time = window.measured.time
            for name, values in variables_of(window.measured).items():
                good = np.isfinite(values)
                at = np.interp(time[window.first] + instants, time[good], values[good])
                found.setdefault(name, []).append(at)
        everywhere = len(self.short.windows)
        whole = {name: np.array(rows) for name, rows in found.items() if len(rows) == everywhere}
        return {name: rows for name, rows in whole.items() if self._is_told(name, rows)}

    def _is_told(self, variable: str, rows: FloatArray) -> bool:
        """Whether a variable is not noise for the most part where it is a position's slope.

        Args:
            variable: its name. rows: (W, m) its values.
        """
        slopes = [window.measured.slopes.get(variable) for window in self.short.windows]
        noise = float(np.mean([slope.noise**2 if slope else 0.0 for slope in slopes]))
        return float(np.var(rows)) * _NOISY >= noise

    def _position(self, variable: str) -> str:
        """Return the channel whose slope a variable is in some run, "" for none."""
        slopes = (window.measured.slopes.get(variable) for window in self.short.windows)
        return next((slope.of for slope in slopes if slope is not None), "")

    def varies(self, variable: str) -> bool:
        """Whether a curve of a variable has any range in all windows."""
        low, high = self.span.get(variable, (0.0, 0.0))
        return high > low

    def knots(self, variable: str) -> FloatArray:
        """Return a curve's knots, (k,) in the variable's unit."""
        return np.linspace(*self.span[variable], _TREND if variable == "time" else _HATS)

    def columns(self, influence: FloatArray, variable: str) -> FloatArray:
        """Return the change of the residual by each hat of a curve, (N, k), by superposition.

        Args:
            influence: (N, m) change by each instant's value. variable: what the curve depends on.
        """
        knots = self.knots(variable)
        hats = np.stack(
            [np.interp(self.values[variable], knots, unit) for unit in np.eye(knots.size)], axis=-1
        )
        columns = np.empty((influence.shape[0], knots.size))
        for piece, weights in zip(self.short.pieces, hats, strict=True):
            columns[piece.rows] = influence[piece.rows] @ weights
        return columns

    def best_curve(
        self, place: SuspectPlace, variable: str, influence: FloatArray, size: float
    ) -> LocatedCurve:
        """Return the best curve of a variable at a place.

        Args:
            place, variable: where, of what. influence: of one unit of `size` in SI there.
        """
        template = Template(place.equation, place.form, place.at, variable)
        share, amplitudes = self._share(self.columns(influence, variable), variable)
        located = LocatedCurve(
            template,
            share,
            self.knots(variable),
            amplitudes * size,
            position=self._position(variable),
        )
        return self._periodic(located, influence, size) if variable == "time" else located

    def _periodic(self, trend: LocatedCurve, influence: FloatArray, size: float) -> LocatedCurve:
        """Return a wave of any period instead of a trend, where it explains more.

        The input is taken as constant over each window there.
        """
        change = influence.sum(axis=1)
        centre = [
            window.measured.time[window.first : window.last].mean() for window in self.short.windows
        ]
        time = np.zeros(self.short.size)
        for piece in self.short.pieces:
            time[piece.rows] = centre[piece.window]
        longest = max(centre)
        best = trend
        sums = self._by_window(change, np.array(centre))
        step = 0.1 / longest
        frequencies = np.arange(1.5 / longest, 0.5 / WINDOW, step)
        rough = sorted(((_wave_gain(*sums, f, 1), float(f)) for f in frequencies), reverse=True)
        for _, frequency in rough[:2]:
            near = np.linspace(frequency - step, frequency + step, 21)
            # what the parameters can do as well counts in the end
            costs = [self._fit_with_columns(_waves(change, time, f, 2))[0].cost for f in near]
            found = float(near[int(np.argmin(costs))])
            share, amplitudes = self._share(_waves(change, time, found, 2), "time")
            if share > best.share + _MORE:
                period = 1.0 / found
                knots = np.linspace(0.0, period, CURVE_KNOTS, endpoint=False)
                curve = _series(knots / period, amplitudes) * size
                best = LocatedCurve(trend.template, share, knots, curve, period)
        return best

    def _by_window(
        self, change: FloatArray, centre: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return each window's time, product of change and residual, and square of the change."""
        soft, weight = soften(self.before.residual, self.short.soft)
        column = change * weight
        product = [float(column[piece.rows] @ soft[piece.rows]) for piece in self.short.pieces]
        square = [float(column[piece.rows] @ column[piece.rows]) for piece in self.short.pieces]
        return centre, np.array(product), np.array(square)

    def _share(self, columns: FloatArray, variable: str) -> tuple[float, FloatArray]:
        """Return the share of the excess that columns explain on runs left out, and amplitudes.

        Args:
            columns: (N, k) of a curve. variable: what it depends on.
        """
        after, amplitudes = self._fit_with_columns(columns)
        groups = self.whole_runs if variable == "time" else self.groups
        found = compare(self.before, after, groups, self.excess)
        return found.share_out, amplitudes

    def _fit_with_columns(self, columns: FloatArray) -> tuple[Fit, FloatArray]:
        """Return the fit to first order with some columns besides the parameters' own."""
        extra = tuple(
            Free(f"curve[{k}]", -1, -np.inf, np.inf, 1.0) for k in range(columns.shape[1])
        )
        matrix = np.hstack([self.fit.jacobian, columns])
        soft, weight = soften(self.fit.residual, self.short.soft)
        weighted = matrix * weight[:, None]
        normal = weighted.T @ weighted
        ridge = 1e-6 * np.diag(np.diag(normal)) + 1e-9 * np.eye(normal.shape[0])
        answer = -np.linalg.lstsq(normal + ridge, weighted.T @ soft, rcond=1e-12)[0]
        residual = self.fit.residual + matrix @ answer
        soft, _ = soften(residual, self.short.soft)
        fit = replace(
            self.fit,
            free=(*self.fit.free, *extra),
            residual=residual,
            jacobian=matrix,
            cost=float(soft @ soft),
        )
        return fit, np.asarray(answer[len(self.fit.free) :], dtype=np.float64)


def _waves(change: FloatArray, time: FloatArray, frequency: float, harmonics: int) -> FloatArray:
    columns = [change]
    for k in range(1, harmonics + 1):
        angle = 2.0 * np.pi * k * frequency * time
        columns += [change * np.cos(angle), change * np.sin(angle)]
    return np.column_stack(columns)


def _wave_gain(
    time: FloatArray, product: FloatArray, square: FloatArray, frequency: float, harmonics: int
) -> float:
    """Predicted fall of the squared residual for a wave, from sums over windows."""
    waves = _waves(np.ones(time.size), time, frequency, harmonics)
    normal = (waves * square[:, None]).T @ waves
    right = waves.T @ product
    return float(right @ np.linalg.lstsq(normal, right, rcond=1e-9)[0])


def _series(phase: FloatArray, amplitudes: FloatArray) -> FloatArray:
    total = np.full(phase.size, amplitudes[0])
    for k in range(1, (amplitudes.size + 1) // 2):
        angle = 2.0 * np.pi * k * phase
        total = total + amplitudes[2 * k - 1] * np.cos(angle) + amplitudes[2 * k] * np.sin(angle)
    return total
