"""Settling time of a response whose noise hides the band: by a decaying pair of modes.

Where averaging over as long as the response itself takes still leaves too much noise, nothing but
a model of the tail can tell when it settles. The simplest one is taken, two poles and a level,

    y(t) - 1 = c + exp(-s t) (a C(t) + b S(t)),    C = cos(w t), S = sin(w t) / w,

fitted to the whole hold from 90 % of the step on (cosh and sinh for two real poles; variable
projection: G. Golub, V. Pereyra, Inverse Problems 19, 2003, doi:10.1088/0266-5611/19/2/201). It
counts only where it leaves no more than the noise; its interval is that of its parameters.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from eha_bench.core.arrays import FloatArray
from eha_bench.core.note import Note
from eha_bench.metrics.metric import NotScored
from eha_bench.metrics.noise import Noise
from eha_bench.metrics.step_response import StepResponse

_DRAWN = 4  # of the linear parameters, for each pair of poles
_GRID = 600
_FEWEST = 40  # samples of the tail
_MISFIT = 5.0  # standard deviations of chi^2 that the smoothed rest may lie above the noise
_DAMPINGS = (0.15, 0.3, 0.5, 0.7, 0.9, 1.3)
_BOX = np.array([[-3.0, -9.0], [1.5, 9.0]])
"""Logarithm of s and w^2, times the transit and its square: what is looked at first."""
_LATTICE = 17
_ZOOMS = 12
_ENOUGH = 60
_FARTHEST = 16.0
_NEAREST = 4
_SPEEDS = (0.4, 0.6, 0.9, 1.3, 2.0)  # natural frequency times the transit


@dataclass(frozen=True)
class SettlingTail:
    """The two modes.

    Attributes:
        start: s since the edge.
        parameters: log of s (1/s), w^2 (1/s^2, negative for two real poles), a, b, c.
    """

    start: float
    parameters: FloatArray


def settling_time_by_model(
    step: StepResponse, band: float, latest: float
) -> tuple[float, Callable[[], tuple[float, float]]]:
    """Return settling time in s since the edge, and what gives its 95 % interval.

    Args:
        step: with known noise.
        band: half-width around the final level, as a share of the step.
        latest: s since the edge after which it does not count as settled.

    Raises:
        NotScored: the tail is not a decaying pair of modes, or not settled.
    """
    tail = _fit(step)
    end = float(step.time[-1])
    grid = np.linspace(0.0, end - tail.start, _GRID)
    value = tail.start + _settling_times(tail.parameters[None, :], grid, band)[0]
    if not value < latest:
        raise NotScored(
            Note("not settled: by a decaying pair of modes {time:.4g} s after the edge", time=value)
        )

    def interval() -> tuple[float, float]:
        low, high = _interval(step, tail, grid, band)
        return min(low, value), max(high, value)

    return value, interval


def _modes(
    logs: FloatArray, squares: FloatArray, time: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return exp(-s t) C(t) and exp(-s t) S(t), each (k, n), for k pairs of poles."""
    decay = np.exp(np.clip(logs, -50.0, 50.0))[:, None]
    safe = np.maximum(np.sqrt(np.abs(squares)), 1e-9)[:, None]
    fall = np.minimum(decay * time[None, :], 300.0)
    angle = safe * time[None, :]
    two = squares > 0.0
    if two.all():
        c, s = _ringing(fall, angle)
    elif not two.any():
        c, s = _creeping(fall, angle)
    else:
        c, s = np.empty_like(angle), np.empty_like(angle)
        c[two], s[two] = _ringing(fall[two], angle[two])
        c[~two], s[~two] = _creeping(fall[~two], angle[~two])
    return c, s / safe


def _ringing(fall: FloatArray, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return both modes of two conjugate poles, the second times its frequency."""
    envelope = np.exp(-fall)
    return envelope * np.cos(angle), envelope * np.sin(angle)


def _creeping(fall: FloatArray, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return both modes of two real poles, no faster growth than decay."""
    real = np.minimum(angle, fall)
    up, down = np.exp(real - fall), np.exp(-real - fall)
    return 0.5 * (up + down), 0.5 * (up - down)


def _settling_times(parameters: FloatArray, grid: FloatArray, band: float) -> FloatArray:
    """Return when each of (k, 5) parameter sets is last outside of the band, s since the start."""
    c, s = _modes(parameters[:, 0], parameters[:, 1], grid)
    return _last_outside(c, s, parameters[:, 2:], grid, band)


def _last_outside(
    c: FloatArray, s: FloatArray, linear: FloatArray, grid: FloatArray, band: float
) -> FloatArray:
    """Return when each of (k, n) modes, by linear parameters (k, 3), is last outside."""
    away = np.abs(linear[:, :1] * c + linear[:, 1:2] * s)
    outside = away > band
    last = np.where(outside.any(axis=1), grid.size - 1 - np.argmax(outside[:, ::-1], axis=1), 0)
    after = np.minimum(last + 1, grid.size - 1)
    rows = np.arange(last.size)
    here, there = away[rows, last], away[rows, after]
    gap = np.where(here > there, here - there, 1.0)
    share = np.clip(np.where(here > band, (here - band) / gap, 0.0), 0.0, 1.0)
    found: FloatArray = grid[last] + share * (grid[after] - grid[last])
    return found


def _fit(step: StepResponse) -> SettlingTail:
    start = step.crossing(0.9).time
    chosen = step.time >= start
    time, values = step.time[chosen] - start, step.rise[chosen] - 1.0
    if time.size < _FEWEST:
        raise NotScored(f"{time.size} samples after 90 % of the step")
    width = step.transit * float(step.time[-1] - step.time[0]) / (step.time.size - 1)

    def design(logs: float, square: float) -> FloatArray:
        c, s = _modes(np.array([logs]), np.array([square]), time)
        matrix = np.ones((time.size, 3))
        matrix[:, 0] = c[0]
        np.divide(s[0], width, out=matrix[:, 1])
        return matrix

    def rest(x: FloatArray) -> FloatArray:
        matrix = design(x[0] - math.log(width), x[1] / width**2)
        found: FloatArray = matrix @ np.linalg.lstsq(matrix, values, rcond=1e-10)[0] - values
        return found

    starts = [
        np.array([math.log(damping * speed), speed**2 * (1.0 - damping**2)])
        for damping in _DAMPINGS
        for speed in _SPEEDS
    ]
    costs = [float(np.sum(rest(x) ** 2)) for x in starts]
    best = least_squares(rest, starts[int(np.argmin(costs))], x_scale=[0.2, 0.5], max_nfev=60)
    logs, square = float(best.x[0]) - math.log(width), float(best.x[1]) / width**2
    matrix = design(logs, square)
    linear = np.linalg.lstsq(matrix, values, rcond=1e-10)[0]
    _require_explained(values - matrix @ linear, step)
    parameters = np.array([logs, square, linear[0], linear[1] / width, linear[2]])
    return SettlingTail(start, parameters)


def _require_explained(rest: FloatArray, step: StepResponse) -> None:
    """Raise NotScored if more is left, over the length of the transit, than the noise leaves."""
    from scipy.signal import savgol_coeffs, savgol_filter  # slow to import

    half = max(2, min(step.transit, (rest.size - 1) // 4))
    weights = savgol_coeffs(2 * half + 1, 2)
    expected = step.noise.variance(weights)
    found = float(np.mean(savgol_filter(rest, 2 * half + 1, 2) ** 2))
    independent = max(rest.size / (2 * half + 1), 2.0)
    if found > expected * (1.0 + _MISFIT * math.sqrt(2.0 / independent)):
        raise NotScored("its tail is not that of two decaying modes")


def _interval(
    step: StepResponse, tail: SettlingTail, grid: FloatArray, band: float
) -> tuple[float, float]:
    """Return where 95 % of the modes that explain the tail settle, s since the edge.

    Two poles are looked at all over a box, ever closer around those that are likely: one more
    excursion out of the band or one less makes them several islands, which no covariance describes.
    Each counts by its likelihood, its linear parameters the best (as much of them is supposed
    beforehand as the data tell: Zellner's prior, which makes the marginal likelihood that).
    """
    chosen = step.time >= tail.start
    time, values = step.time[chosen] - tail.start, step.rise[chosen] - 1.0
    variance = step.noise.sd**2 * _slower(step, tail, time, grid, band)
    poles = _likely(time, values, tail.parameters, step, variance)
    rng = np.random.default_rng(0)  # the same recording has the same interval
    drawn = rng.normal(size=(_DRAWN, poles.left.size, 3))
    # Student's distribution, as the noise is estimated
    freedom = step.noise.freedom
    drawn *= np.sqrt(freedom / rng.chisquare(freedom, (_DRAWN, poles.left.size, 1)))
    linear = poles.linear + np.einsum("kij,dkj->dki", poles.roots, drawn) * math.sqrt(variance)
    c, s = _modes(poles.logs, poles.squares, grid)
    times = np.concatenate([_last_outside(c, s, one, grid, band) for one in linear])
    rest = (poles.left - poles.left.min()) / variance
    weights = np.tile((1.0 + rest / freedom) ** (-0.5 * (freedom + 2.0)), _DRAWN)
    order = np.argsort(times)
    share = np.cumsum(weights[order]) / float(weights.sum())
    low, high = np.interp((0.025, 0.975), share, times[order])
    return tail.start + float(low), tail.start + float(high)


@dataclass(frozen=True)
class _Poles:
    """Pairs of poles, with the linear parameters that are the best for each.

    Attributes:
        logs, squares: (k,).
        linear: (k, 3) a, b, c.
        roots: (k, 3, 3) of their covariance, for noise of variance 1.
        left: (k,) sum of squares.
    """

    logs: FloatArray
    squares: FloatArray
    linear: FloatArray
    roots: FloatArray
    left: FloatArray


def _likely(
    time: FloatArray, values: FloatArray, best: FloatArray, step: StepResponse, variance: float
) -> _Poles:
    """Return a lattice over the poles that leave no more than the best and 16 variances do."""
    width = step.transit * float(step.time[-1] - step.time[0]) / (step.time.size - 1)
    place = np.array([best[0] + math.log(width), best[1] * width**2])
    low, high = np.minimum(_BOX[0], place - 0.5), np.maximum(_BOX[1], place + 0.5)
    least = float(_fit_poles(time, values, best[:1], best[1:2], width).left[0])
    for _ in range(_ZOOMS):
        axes = [np.linspace(*ends, _LATTICE) for ends in zip(low, high, strict=True)]
        logs, squares = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
        found = _fit_poles(time, values, logs - math.log(width), squares / width**2, width)
        rest = (found.left - min(least, float(found.left.min()))) / variance
        near = rest <= _FARTHEST
        if np.count_nonzero(near) >= _ENOUGH:
            break
        # a lattice that is too coarse misses the best, which stays within
        kept = near | (rest <= np.partition(rest, _NEAREST)[_NEAREST])
        cell = (high - low) / (_LATTICE - 1)
        places = np.column_stack((logs, squares))[kept]
        low = np.maximum(low, np.minimum(places.min(axis=0), place) - cell)
        high = np.minimum(high, np.maximum(places.max(axis=0), place) + cell)
    return _Poles(
        found.logs[near], found.squares[near], found.linear[near], found.roots[near],
        found.left[near],
    )  # fmt: skip


def _fit_poles(
    time: FloatArray, values: FloatArray, logs: FloatArray, squares: FloatArray, width: float
) -> _Poles:
    """Fit (n,) values by each of (k,) pairs of poles."""
    c, s = _modes(logs, squares, time)
    design = np.stack((c, s / width, np.ones_like(c)), axis=-1)
    normal = np.swapaxes(design, 1, 2) @ design
    # a pole that has decayed after a sample leaves them singular
    diagonal = np.einsum("kii->ki", normal)
    diagonal += 1e-9 * diagonal.max(axis=1, keepdims=True)
    inverse = np.linalg.inv(normal)
    linear = (inverse @ (np.swapaxes(design, 1, 2) @ values)[..., None])[..., 0]
    left = np.sum((values - (design @ linear[..., None])[..., 0]) ** 2, axis=1)
    scale = np.array([1.0, 1.0 / width, 1.0])
    roots = np.linalg.cholesky(0.5 * (inverse + np.swapaxes(inverse, 1, 2)))
    return _Poles(logs, squares, linear * scale, roots * scale[:, None], left)


def _slower(
    step: StepResponse, tail: SettlingTail, time: FloatArray, grid: FloatArray, band: float
) -> float:
    """Return how much more the settling time varies than in white noise, 1 or more times."""
    if step.noise.autocovariance.size == 1:
        return 1.0
    total, white = _covariances(tail.parameters, time, step.noise)
    sizes = 0.1 * np.sqrt(np.maximum(np.diag(white), 1e-300))
    moved = np.concatenate([tail.parameters + np.diag(sizes), tail.parameters - np.diag(sizes)])
    times = _settling_times(moved, grid, band)
    slopes = (times[:5] - times[5:]) / (2.0 * sizes)
    return max(float(slopes @ total @ slopes) / max(float(slopes @ white @ slopes), 1e-300), 1.0)


def _covariances(
    parameters: FloatArray, time: FloatArray, noise: Noise
) -> tuple[FloatArray, FloatArray]:
    """Return the covariance of the parameters under correlated noise, and if white, (5, 5)."""

    def curve(x: FloatArray) -> FloatArray:
        c, s = _modes(x[:1], x[1:2], time)
        found: FloatArray = x[2] * c[0] + x[3] * s[0] + x[4]
        return found

    sizes = np.array(
        [1.0, max(abs(parameters[1]), 1.0), 1.0, 1.0 / max(float(time[-1]), 1e-9), 1.0]
    )
    columns = []
    for k, size in enumerate(sizes):
        shift = np.zeros(5)
        shift[k] = 1e-5 * size
        columns.append((curve(parameters + shift) - curve(parameters - shift)) / (2.0 * shift[k]))
    operator = np.linalg.pinv(np.column_stack(columns), rcond=1e-12)
    spread = noise.spread(operator)
    return spread.total, spread.white
