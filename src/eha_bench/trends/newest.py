"""Whether the newest nights together left the level, from the eighth night on.

A step has to be found while it is news: two nights after it, long before a search over all nights
can place it. The newest nights are compared with all before them as a step of a first-order
autoregression, its scatter and the likeness of its nights averaged out on a grid (Box and Tiao
1973, section 2.4). The nights' own intervals, where there are any, bound the scatter from below,
so that few nights that lie close together by chance raise no alarm. One wild night counts as little
more than its neighbour.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import ndtr

from eha_bench.core.arrays import FloatArray
from eha_bench.trends.influence import Influence

SPANS: Final = {2: 0.75, 4: 0.15, 7: 0.1}
"""Newest nights that are taken together, and the share of the error rate that each uses."""

_FEWEST_BEFORE: Final = 5
_MOST: Final = 120  # nights that tell of the scatter
_FURTHEST: Final = 3.0  # standard deviations to which a night before counts
_APART: Final = 1.5  # standard deviations by which one of the newest may exceed the least of them
_TO_SIGMA: Final = 1.4826
_LAST_DIGIT: Final = 1e-9
_OWN: Final = 0.8  # of the own interval's standard deviation that the scatter is at least
_ALONE: Final = 0.5  # belief that nights scatter by their own intervals alone
_OWN_SPREAD: Final = 0.2  # and how well those are believed, in the logarithm
_ALIKE: Final = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.85])
_BELIEFS: Final = np.array([0.5, 0.08, 0.09, 0.09, 0.09, 0.08, 0.07])
_SCALES: Final = 41


@dataclass(frozen=True)
class Newest:
    """What the newest nights together are: how many, and the p-value that they are as before."""

    span: int
    p_value: float
    shift: float


def newest_of(residuals: FloatArray, own: float, influence: Influence | None = None) -> Newest:
    """Return the newest nights that left the level most surely, whether they did or not.

    Args:
        residuals: (n,) from the level of the nights before, in order.
        own: standard deviation of a night by its own interval; NaN where unknown.
        influence: what else acts on the nights; nothing if None.
    """
    acting = influence if influence is not None else Influence.none(residuals.size)
    acting = acting.since(max(0, residuals.size - _MOST))
    found = []
    for span, share in SPANS.items():
        nights, left = residuals[-_MOST:], acting
        if nights.size - span < max(_FEWEST_BEFORE, span + 1):
            continue
        if acting.count:
            strengths = _strengths(nights[:-span], own, acting)
            nights, left = nights - acting.columns @ strengths, acting.without(strengths)
        chance = min(1.0, _chance(nights, span, own, left) / share)
        found.append(Newest(span, chance, float(nights[-span:].mean())))
    return min(found, key=lambda one: one.p_value, default=Newest(1, 1.0, 0.0))


def _strengths(before: FloatArray, own: float, influence: Influence) -> FloatArray:
    """Return the influences' strengths as the nights before the newest say."""
    sigma = spread_of(before, own)
    if sigma <= 0.0:
        return np.zeros(influence.count)
    acting = Influence(influence.columns[: before.size] / sigma, influence.centre)
    matrix = acting.beside(np.ones((before.size, 1)), 1.0)
    middle = float(np.median(before))
    clipped = np.clip((before - middle) / sigma, -_FURTHEST, _FURTHEST)
    sizes = np.linalg.lstsq(matrix, acting.with_beliefs(clipped, 1.0), rcond=None)[0]
    return np.asarray(sizes[1:], dtype=np.float64)


def spread_of(residuals: FloatArray, own: float) -> float:
    """Return the standard deviation of a night, robust and by the nights' own intervals.

    Args:
        residuals: (n,) from the level.
        own: standard deviation of a night by its own interval; NaN where unknown.
    """
    middle = float(np.median(residuals))
    sigma = _TO_SIGMA * float(np.median(np.abs(residuals - middle)))
    if sigma <= _LAST_DIGIT * float(np.abs(residuals).max()):
        sigma = float(residuals.std())  # most are equal: counts, rounded values
    return max(sigma, own) if math.isfinite(own) else sigma


def _chance(nights: FloatArray, span: int, own: float, influence: Influence) -> float:
    before, newest = nights[:-span], nights[-span:]
    middle, sigma = float(np.median(before)), spread_of(before, own)
    side = newest - middle
    if sigma <= 0.0:
        return 0.0 if np.all(side > 0.0) or np.all(side < 0.0) else 1.0
    if not (np.all(side > 0.0) or np.all(side < 0.0)):
        return 1.0
    least = float(np.abs(side).min())
    moved = np.sign(side) * np.minimum(np.abs(side), least + _APART * sigma)
    known = np.clip(before - middle, -_FURTHEST * sigma, _FURTHEST * sigma)
    values = np.concatenate((known, moved)) / sigma
    return _step(values, span, own / sigma, influence.scaled(sigma))


def _step(values: FloatArray, span: int, own: float, influence: Influence) -> float:
    """Return the two-sided p-value of a step of the last nights, scatter and likeness unknown."""
    design = np.ones((2, values.size))
    design[1, :-span] = 0.0
    design = np.concatenate((design, influence.columns.T))
    # a belief counts as a row of its own; it is as good in units of any scatter
    beliefs = np.zeros((design.shape[0], influence.count))
    beliefs[2:] = np.eye(influence.count)
    scales = np.geomspace(0.3, 4.0, _SCALES)
    flat = np.full(_SCALES, 1.0 / _SCALES)
    if not math.isfinite(own):
        parts = [(alike, belief * flat) for alike, belief in zip(_ALIKE, _BELIEFS, strict=True)]
    else:
        # either the nights scatter by their own intervals alone, which says that they are
        # independent, or by anything more
        flat = np.where(scales >= _OWN * own, flat, 0.0)
        alone = np.exp(-0.5 * (np.log(scales / own) / _OWN_SPREAD) ** 2)
        parts = [
            (alike, (1.0 - _ALONE) * belief * flat / flat.sum())
            for alike, belief in zip(_ALIKE, _BELIEFS, strict=True)
        ]
        parts.append((0.0, _ALONE * alone / alone.sum()))
    degrees = values.size - 2
    chance, weight = 0.0, 0.0
    for alike, belief in parts:
        columns = np.concatenate((_whitened(design, alike), beliefs), axis=1)
        white = np.concatenate((_whitened(values[None], alike)[0], influence.centre))
        inverse = np.linalg.inv(columns @ columns.T)
        sizes = inverse @ (columns @ white)
        squares = float(np.sum((white - sizes @ columns) ** 2))
        volume = 0.5 * (values.size - 1) * math.log1p(-(alike**2))
        volume -= 0.5 * math.log(float(np.linalg.det(inverse)))
        logarithm = -degrees * np.log(scales) - 0.5 * squares / scales**2 - volume
        likely = belief * np.exp(logarithm)
        distance = abs(float(sizes[1])) / (scales * math.sqrt(float(inverse[1, 1])))
        chance += float(likely @ ndtr(-distance))
        weight += float(likely.sum())
    return min(1.0, 2.0 * chance / weight) if weight > 0.0 else 1.0


def _whitened(rows: FloatArray, alike: float) -> FloatArray:
    white = rows.copy()
    white[:, 1:] = (rows[:, 1:] - alike * rows[:, :-1]) / math.sqrt(1.0 - alike**2)
    return white
