"""Stamps that scatter: by how much readings are taken before or after what their stamps say.

A reading taken e before its stamp is off by slope times e, white from reading to reading, and more
the faster a channel moves. All channels of one clock share the scatter s.

It is told from the readings alone. The divided difference of order m of m + 1 neighbours by their
stamps, with factors c that are scaled to sum c^2 = 1, has the variance v = sigma^2 + s^2 g, with g
the sum of (c slope)^2: what is smooth over them vanishes in it, and white noise counts the same at
any order. A line through the squares over g, each weighted by its variance, clipped where it is far
off, has the slope s^2.

What bends is no scatter, and shows in two ways: what is left of it falls with the order, and where
motions are short (an answer to a step within a few samples) some differences are large and others
nothing, so that a low quantile of them says less. The least of two orders is taken, nothing where
a low quantile denies it, and no more than any channel of the clock allows.

Of stamps that are more regular than that no scatter is told: they were written on a grid, and what
grows with a slope may be ripple.

No model is used: what a delay, a lag or friction leaves lasts for many samples, and vanishes in
the differences of readings.

Sources: of the differences, Von Neumann, Kent, Bellinson, Hart, Ann. Math. Stat. 12 (1941) 153,
doi:10.1214/aoms/1177731746; of a line through squares, weighted by their own size: Carroll,
Ruppert, Transformation and Weighting in Regression, 1988, chapter 3.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray
from eha_bench.diagnosis.data.measured import Measured, Scattered
from eha_bench.diagnosis.data.noise import noise_of_step, quantum_of

_ORDER, _HIGHER = 5, 7
_INEFFICIENT = {_ORDER: 5.1, _HIGHER: 6.0}
"""Variance of a clipped square relative to its mean's, 1.76, times what neighbours share: 1 and
twice the sum of squared correlations, 2.9 and 3.4."""
_FAR = 6.25
"""Square of a difference, in its variance, at which it is clipped."""
_CLIPPED = 0.97756
"""Mean square of a normal deviate that is clipped so."""
_LOW, _LOW_NORMAL = 0.25, 0.31864
"""A low quantile of sizes, and what it is of a normal deviate of 1."""
_DENIES = 0.4
"""Part of the variance that a low quantile has to see."""
_CLASSES = 12
"""Of like g, in which that is counted."""
_SHORT = 0.05
"""A step by less than this part of the usual one: readings that differ by no time tell no slope."""
_FEWEST = 120
"""Least number of differences of a channel that moves."""
_MOST = 20_000
"""About how many of them are looked at, of one channel and run."""
_STEPS = 1.0
"""Least way from reading to reading of what moves, in steps of its resolution."""
_BENDS = 3
"""Readings from the one before a jump of an input in which a signal bends by it."""
_GAP = 2.0
"""A step by more than this many usual ones leaves readings out."""
_ROUNDS = 8
_CERTAIN = 4.0
"""Standard errors from which there is scatter."""
_MATTERS = 0.1
"""Least part of a moving reading's noise, squared, that scatter makes."""
_LARGEST = 0.3
"""Largest scatter, in usual steps of the clock: beyond it stamps tell no order of readings."""
_AS_IRREGULAR = 2.0
"""Largest scatter, in what half of the steps are off the usual one: of stamps on a grid, a load
cell's ripple that grows with its slope would be taken for scatter of 0.4 ms."""


class _Differences(NamedTuple):
    """Divided differences of readings, scaled to the noise of one.

    Attributes:
        left: (n,). moves: (n,) sum of (c slope)^2. unsure: (n,) what noise of 1 adds to that.
    """

    left: FloatArray
    moves: FloatArray
    unsure: FloatArray


class _VarianceLine(NamedTuple):
    """A line through squares: at rest, its slope, and the standard error of that.

    Attributes:
        share: of the variance where a channel moves usually, that of its slope in that at rest.
    """

    rest: float
    slope: float
    error: float
    share: float


def with_scatter(measured: Sequence[Measured]) -> tuple[Measured, ...]:
    """Return runs with what scatter of their clocks' stamps makes of readings, where it matters."""
    out = list(measured)
    clocks = dict.fromkeys(_clock(item, name) for item in out for name in item.outputs)
    for clock in clocks:
        found = _scatter_of(measured, clock)
        if found is None:
            continue
        scatter, noise = found
        out = [_scattered(item, clock, scatter, noise) for item in out]
    return tuple(out)


def scattered_like(measured: Measured, others: Sequence[Measured]) -> Measured:
    """Return a run with the scatter of the same clocks in others; without any it is as it was."""
    for clock in dict.fromkeys(_clock(measured, name) for name in measured.outputs):
        noise: dict[str, float] = {}
        own = 0.0
        for other in others:
            for name, item in other.scattered.items():
                if _clock(other, name) == clock:
                    own, noise[name] = item.stamps, item.noise
        if own > 0.0:
            measured = _scattered(measured, clock, own, noise)
    return measured


def _clock(measured: Measured, name: str) -> str:
    return measured.topic_of.get(name, "")


def _scattered(
    measured: Measured, clock: str, scatter: float, noise: Mapping[str, float]
) -> Measured:
    """Return a run with what scatter of one clock, in s, makes of its readings."""
    found = dict(measured.scattered)
    for name in measured.outputs:
        if _clock(measured, name) != clock:
            continue
        ticks, time, values = _readings(measured, name)
        if ticks.size < 3:
            continue
        level = noise.get(name, noise_of_step(quantum_of(values)))
        square, unsure = _slopes(time, values)
        moved = np.zeros(measured.time.size)
        moved[ticks] = scatter * np.sqrt(np.maximum(square - level**2 * unsure, 0.0))
        found[name] = Scattered(scatter, noise.get(name, float("nan")), moved)
    return replace(measured, scattered=found)


def _scatter_of(measured: Sequence[Measured], clock: str) -> tuple[float, dict[str, float]] | None:
    """Return a clock's scatter, s, and its channels' noise without it; None where there is none."""
    lines: dict[str, _VarianceLine] = {}
    higher: list[_VarianceLine] = []
    low: list[_VarianceLine] = []
    steps, irregular = [0.0], 0.0
    for name in dict.fromkeys(name for item in measured for name in item.outputs):
        runs = [item for item in measured if name in item.outputs and _clock(item, name) == clock]
        if not runs:
            continue
        least = max(noise_of_step(_step(item, name)) for item in runs) ** 2
        found = _differences_of(runs, name, _ORDER)
        line = _line(found, least, _ORDER)
        if line is None:
            continue
        lines[name] = line
        if (own := _low_line(found, line, least)) is not None:
            low.append(own)
        if (own := _line(_differences_of(runs, name, _HIGHER), least, _HIGHER)) is not None:
            higher.append(own)
        for item in runs:
            between = np.diff(_readings(item, name)[1])
            usual = float(np.median(between))
            steps.append(usual)
            irregular = max(irregular, float(np.median(np.abs(between - usual))))
    if not lines or not higher or not low:
        return None
    square, error = _together([*lines.values()])
    if square < _CERTAIN * error:
        return None
    square = min(square, _together(higher)[0])
    square = min(square, *(line.slope + 2.0 * line.error for line in lines.values()))
    if square < _CERTAIN * error or _together(low)[0] < _DENIES * square:
        return None
    if square > min(_LARGEST * max(steps), _AS_IRREGULAR * irregular) ** 2:
        return None
    if max(line.share * square / line.slope for line in lines.values() if line.slope) < _MATTERS:
        return None
    return float(np.sqrt(square)), {name: line.rest**0.5 for name, line in lines.items()}


def _together(lines: Sequence[_VarianceLine]) -> tuple[float, float]:
    """Return the slope that several lines share, and its standard error."""
    weights = np.array([line.error**-2 for line in lines])
    slopes = np.array([line.slope for line in lines])
    return float(weights @ slopes / weights.sum()), float(weights.sum() ** -0.5)


def _step(measured: Measured, name: str) -> float:
    return measured.steps.get(name, 0.0)


def _readings(measured: Measured, name: str) -> tuple[IndexArray, FloatArray, FloatArray]:
    """Return the ticks at which a channel was read, when that was, s, and what."""
    ticks = np.flatnonzero(measured.valid[:, measured.outputs.index(name)])
    time = measured.at(name, slice(None))[ticks]
    return ticks, time, measured.values[ticks, measured.outputs.index(name)]


def _slopes(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the square of the slope at each reading, and what noise of 1 adds to it, (n,).

    The mean of those on both sides: where a signal bends, a line through more readings says less
    of it. Its noise is taken off in the mean, and counts only where stamps would scatter by more
    than a part of a step.

    Args:
        time: (n,) s, n of 2 at least. values: (n,).
    """
    steps = np.diff(time)
    steps = np.maximum(steps, _SHORT * float(np.median(steps)))
    sides = np.stack([(np.diff(values) / steps) ** 2, 2.0 / steps**2])
    before = np.concatenate([sides[:, :1], sides], axis=1)
    behind = np.concatenate([sides, sides[:, -1:]], axis=1)
    square, unsure = 0.5 * (before + behind)
    return square, unsure


def _differences_of(runs: Sequence[Measured], name: str, order: int) -> _Differences:
    """Return the differences of a channel over runs, where it moves and no input jumps."""
    found = []
    for item in runs:
        ticks, time, values = _readings(item, name)
        bends = np.zeros(ticks.size, dtype=np.bool_)
        for k in np.searchsorted(ticks, item.jumps):
            bends[max(0, k - 1) : k - 1 + _BENDS] = True
        if ticks.size > order + 1:
            found.append(_differences(time, values, bends, order, _step(item, name)))
    parts = zip(*found, strict=True) if found else ([np.zeros(0)],) * 3
    return _Differences(*(np.concatenate([*part]) for part in parts))


def _differences(
    time: FloatArray, values: FloatArray, bends: BoolArray, order: int, step: float
) -> _Differences:
    """Return the differences of one run's readings.

    Args:
        time: (n,) s. values, bends: (n,). order: of the differences. step: of the resolution.
    """
    width = order + 1
    square, unsure = _slopes(time, values)
    steps = np.diff(time)
    usual = float(np.median(steps))
    every = max(1, (time.size - order) // _MOST)

    def views(column: FloatArray | BoolArray, count: int = width) -> FloatArray:
        return np.asarray(sliding_window_view(column, count)[::every])

    near = np.sqrt(square) * usual >= _STEPS * step
    # not only the usual ones: what is written twice at one instant has no difference
    whole = (views(steps, order).max(axis=1) < _GAP * usual) & (
        views(steps, order).min(axis=1) > _SHORT * usual
    )
    whole &= views(near & ~bends).all(axis=1)
    times, own = views(time)[whole], views(values)[whole]
    apart = (times - times[:, :1]) / usual
    factors = np.ones_like(times)
    for one in range(width):
        for other in range(width):
            if one != other:
                factors[:, one] /= apart[:, one] - apart[:, other]
    factors /= np.sqrt(np.einsum("ij,ij->i", factors, factors))[:, None]
    left = np.einsum("ij,ij->i", factors, own - own[:, :1])
    squares = factors**2
    return _Differences(
        left,
        np.einsum("ij,ij->i", squares, views(square)[whole]),
        np.einsum("ij,ij->i", squares, views(unsure)[whole]),
    )


def _line(found: _Differences, least: float, order: int) -> _VarianceLine | None:
    """Return the line through squares of differences, None of too few.

    Args:
        found: differences. least: variance that a resolution makes. order: of the differences.
    """
    if found.left.size < _FEWEST:
        return None
    squares = found.left**2
    rest = max(float(np.median(squares)) / 0.4549, least, 1e-300)
    line = _VarianceLine(rest, 0.0, np.inf, 0.0)
    for _ in range(_ROUNDS):
        moves = np.maximum(found.moves - line.rest * found.unsure, 0.0)
        expected = line.rest + max(line.slope, 0.0) * moves
        own = np.minimum(squares, _FAR * expected) / _CLIPPED
        weight = 1.0 / (_INEFFICIENT[order] * expected**2)
        if (fitted := _fitted(moves, own, weight, least)) is None:
            return None
        line = fitted
    return line


def _fitted(
    moves: FloatArray, squares: FloatArray, weight: FloatArray, least: float
) -> _VarianceLine | None:
    """Return the weighted line through squares, not below what a resolution makes at rest."""
    scale = float(moves.max())
    if not scale > 0.0:
        return None
    place = moves / scale
    total, first, second = (float(np.sum(weight * place**power)) for power in range(3))
    volume = total * second - first**2
    if not volume > 1e-9 * total * second:
        return None
    by_rest, by_slope = float(weight @ squares), float(weight @ (place * squares))
    rest = (second * by_rest - first * by_slope) / volume
    slope, variance = (total * by_slope - first * by_rest) / volume, total / volume
    if rest < least or rest <= 0.0:
        rest = max(least, 1e-300)
        slope, variance = (by_slope - rest * first) / second, 1.0 / second
    share = slope * float(np.mean(place)) / rest
    return _VarianceLine(rest, slope / scale, float(np.sqrt(variance)) / scale, share)


def _low_line(found: _Differences, line: _VarianceLine, least: float) -> _VarianceLine | None:
    """Return the line through low quantiles of differences in classes of like g."""
    moves = np.maximum(found.moves - line.rest * found.unsure, 0.0)
    classes = np.array_split(np.argsort(moves, kind="stable"), _CLASSES)
    means = np.array([float(np.mean(moves[own])) for own in classes])
    sizes = [float(np.quantile(np.abs(found.left[own]), _LOW)) / _LOW_NORMAL for own in classes]
    expected = line.rest + max(line.slope, 0.0) * means
    return _fitted(means, np.array(sizes) ** 2, expected**-2.0, least)


def scatter_notes(measured: Sequence[Measured]) -> Iterator[str]:
    """Say which readings' stamps scatter, and what that makes of them."""
    clocks: dict[str, dict[str, None]] = {}
    scatter: dict[str, float] = {}
    for item in measured:
        for name, own in item.scattered.items():
            clock = _clock(item, name)
            clocks.setdefault(clock, {})[name] = None
            scatter[clock] = own.stamps
    for clock, names in clocks.items():
        yield (
            f"readings of {', '.join(names)} are stamped up to {2e3 * scatter[clock]:.2g} ms off "
            f"at random ({1e3 * scatter[clock]:.2g} ms rms): counted as noise of each reading "
            "where it moves"
        )
