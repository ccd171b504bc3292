"""Samples that are not measurements: spikes, and places without a value.

A spike is a sample that its neighbours contradict while they agree with one another: a parabola
through the three on either side follows these, and misses the sample by far more than the noise.
Jumps, kinks and narrow peaks are not spikes: there the neighbours do not agree.
"""

from __future__ import annotations

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray
from eha_bench.metrics.noise import white_noise

_BEYOND = 8.0  # standard deviations of the white noise
_AGREE = 0.1  # of the spike: what the neighbours may leave of their parabola
_STEEP = (
    1.5  # times the largest step between two neighbours: what moves as fast as it spikes may be
)
_LEAST = 0.01  # of the span: what is less is as well the shape of a response that is free of noise
_HIDDEN = 0.5  # of the span: where less is left without spikes, more are looked for
_NEAR = np.array([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0])
_BESIDE = ((2, 1), (3, 4))  # neighbours on either side, the near and the far one
_MOST = 0.03  # share of samples that may be spikes; more are not exceptions
_REACH = 9  # samples that one is told by, at most
_ROUNDING = 1e-9  # by which two ways to compute the same may differ
_MIDDLE = np.array([-1.0, 4.0, 4.0, -1.0]) / 6.0  # of the cubic through two on either side
LONGEST_FILLED = 3
"""Samples in a row without a value that neighbours may stand for."""


def _parabolas() -> list[tuple[FloatArray, FloatArray, IndexArray]]:
    """Return operator, design and samples of a parabola through all neighbours, or all but one."""
    chosen = [np.arange(6), *(np.delete(np.arange(6), left_out) for left_out in range(6))]
    designs = [np.vander(_NEAR[kept], 3, increasing=True) for kept in chosen]
    return [(np.linalg.pinv(d), d, kept) for d, kept in zip(designs, chosen, strict=True)]


_FITS = _parabolas()


def spikes(time: FloatArray, values: FloatArray, resolution: float) -> IndexArray:
    """Return the places of single samples that are not measurements, in (n,) finite values.

    A sample next to a gap in the (n,) times is never one: its neighbours are too far away to tell.
    """
    found, clean = _spikes(time, values, resolution)
    # beside one that is out by far, others look small
    while found.size and np.ptp(clean) < _HIDDEN * np.ptp(values):
        values = clean
        more, clean = _spikes(time, values, resolution)
        found = np.union1d(found, more)
    return found


def _spikes(
    time: FloatArray, values: FloatArray, resolution: float
) -> tuple[IndexArray, FloatArray]:
    """Return the places of spikes that stand out from the span of (n,) values, and these without.

    One that is found is replaced by what its neighbours say.
    """
    none = np.zeros(0, dtype=np.intp), values
    if values.size < 32:
        return none
    noise = max(white_noise(values), resolution)
    least = max(_BEYOND * noise, _LEAST * float(np.ptp(values)))
    if not least > 0.0:
        return none
    # against the mean of both neighbours: a spike is off by its size, a neighbour of it by half
    bend = np.abs(values[1:-1] - 0.5 * (values[:-2] + values[2:]))
    candidates = np.flatnonzero(bend > 0.7 * least) + 1
    if candidates.size == 0 or candidates.size > 3 * _MOST * values.size:
        return none
    steps = np.diff(time)
    period = float(np.median(steps))
    largest_first = [0, values.size - 1, *candidates[np.argsort(-bend[candidates - 1])].tolist()]
    clean = np.array(values)
    doubtful = np.zeros(values.size, dtype=np.bool_)
    doubtful[[0, values.size - 1]] = True
    doubtful[candidates] = _contradicted(values, candidates, least)
    found: list[int] = []
    for index in largest_first:
        if not doubtful[index]:
            continue
        if np.any(steps[max(index - 3, 0) : index + 3] > 1.5 * period):
            continue
        instead = _instead(clean, index, least)
        if instead is not None:
            found.append(index)
            clean[index] = instead
            doubtful[max(index - _REACH, 0) : index + _REACH + 1] = True  # a neighbour has changed
    if len(found) > _MOST * values.size:
        return none
    return np.array(sorted(found), dtype=np.intp), clean


def _contradicted(values: FloatArray, places: IndexArray, least: float) -> BoolArray:
    """Return which samples at (k,) places their neighbours may contradict, (k,).

    All at once, for there may be as many as noise has tails; `_instead` has the last word on few.
    """
    found = ~((places >= 3) & (places < values.size - 3))
    inner = np.flatnonzero(~found)
    samples = values[places[inner]]
    around = values[places[inner][:, None] + _NEAR.astype(np.intp)]
    likely = np.zeros(inner.size, dtype=np.bool_)
    for operator, design, kept in _FITS:
        near = around[:, kept]
        parabolas = near @ operator.T
        away = np.abs(samples - parabolas[:, 0]) * (1.0 + _ROUNDING)
        rest = np.max(np.abs(near - parabolas @ design.T), axis=1) * (1.0 - _ROUNDING)
        steps = np.max(_steps(near, kept), axis=1) * (1.0 - _ROUNDING)
        alone = (away > least) & (away > _STEEP * steps)
        likely |= alone & (rest < np.maximum(_AGREE * away, 0.5 * least) * (1.0 + _ROUNDING))
    found[inner] = likely
    return found


def _steps(near: FloatArray, kept: IndexArray) -> FloatArray:
    """Return how steep neighbours (..., k) are on their own side of a sample, per sample.

    Where a neighbour is left out, its side is still as steep as from the one before it.
    """
    beside = _NEAR[kept][1:] * _NEAR[kept][:-1] > 0.0
    return np.asarray((np.abs(np.diff(near)) / np.diff(_NEAR[kept]))[..., beside])


def _instead(values: FloatArray, index: int, least: float) -> float | None:
    """Return what the neighbours of a sample say it was, or None where they do not contradict it.

    One of them may be a spike itself.
    """
    sample = float(values[index])
    if not 3 <= index < values.size - 3:
        start = 0 if index < 3 else values.size - 9
        around = np.delete(values[start : start + 9], index - start)
        middle = float(np.median(around))
        alike = np.sort(np.abs(around - middle))[:-1]
        return middle if abs(sample - middle) > least and alike[-1] < 0.5 * least else None
    around = values[index + _NEAR.astype(np.intp)]
    for operator, design, kept in _FITS:
        parabola = operator @ around[kept]
        away = abs(sample - float(parabola[0]))
        rest = float(np.max(np.abs(around[kept] - design @ parabola)))
        steps = float(np.max(_steps(around[kept], kept)))
        alone = away > least and away > _STEEP * steps
        if alone and rest < max(_AGREE * away, 0.5 * least):
            break
    else:
        return None
    # a kink goes on from one side, or lies between where both sides would go on to; a spike neither
    before, after = (2.0 * float(around[near]) - float(around[far]) for near, far in _BESIDE)
    if min(abs(sample - before), abs(sample - after)) < 0.5 * away:
        return None
    if min(before, after) <= sample <= max(before, after):
        return None
    return float(parabola[0])


def filled(values: FloatArray, missing: BoolArray) -> FloatArray:
    """Return (n,) values with the missing ones taken from their neighbours.

    By the cubic through two on either side; by a straight line where one of these is missing, too.
    """
    result = np.array(values)
    places = np.arange(values.size)
    result[missing] = np.interp(places[missing], places[~missing], values[~missing])
    alone = np.flatnonzero(missing)
    alone = alone[(alone >= 2) & (alone < values.size - 2)]
    beside = alone[:, None] + np.array([-2, -1, 1, 2])
    whole = ~np.any(missing[beside], axis=1)
    result[alone[whole]] = values[beside[whole]] @ _MIDDLE
    return result


def runs(flags: BoolArray) -> list[tuple[int, int]]:
    """Return [start, stop) of every stretch of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
