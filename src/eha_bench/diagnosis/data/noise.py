"""How noisy a channel is, from its readings alone.

The mean square of third differences (a signal that is smooth over four samples vanishes in them) in
blocks of a hundred samples, of which the median is taken, so that fast events do not count; never
below what the channel's own quantisation makes, sqrt(1/12) of its step. Of shorter signals the
median of absolute differences speaks, and where these come in a few steps of the resolution, mean
squares in shorter blocks: of readings that flicker between two steps most differences are nothing.

Source of the difference estimator: Von Neumann, Kent, Bellinson, Hart, The mean square successive
difference, Ann. Math. Stat. 12 (1941) 153, doi:10.1214/aoms/1177731746.
"""

from __future__ import annotations

import numpy as np

from eha_bench.core.arrays import FloatArray

THIRD = 20.0
"""Mean square of third differences of white noise of 1: the squares of (1, -3, 3, -1) summed."""
FIFTH = 252.0
"""The same of fifth differences: (1, -5, 10, -10, 5, -1)."""
_ROUGH = 0.3
"""Least level by fifth differences, in that by third ones, of what is noise."""
_BLOCK = 100
_SHORTEST_BLOCK = 20
_BLOCKS = 5
"""Least number of blocks."""
_FEW_STEPS = 0.5
"""Step of the resolution, in the noise, from which differences come in a few steps only."""
_CORRELATED = 2.31
"""Third differences that are worth one: of white noise they correlate by -0.75, 0.3, -0.05."""
_SLOW = 3.0
"""Most steps of the resolution from sample to sample of what moves slowly."""
_FEWEST_SLOW = 8
_FEWEST_LEVELS = 3
_MANY_LEVELS = 32
"""Levels from which readings were not set to each of them."""
_RARELY = 0.05
"""Largest share of samples at which what is set jumps."""
_ROUNDING = 2.0**-23
"""Relative rounding of single precision."""
_LEAST = 0.05
"""Quantile of the differences of levels that is a step of one, and no rounding."""
_PARTS = 8
"""Most steps between the nearest levels that come."""
_WHOLE = 0.05
"""What a multiple of a step may be off a whole number."""
_COARSE = 20.0
"""Least size of a step, in roundings: finer ones are those of the digits that were written."""


def noise_of(values: FloatArray, step: float | None = None) -> float:
    """Return the standard deviation of a channel's noise, in its unit (NaN if it has no samples).

    Args:
        values: (n,), NaN where nothing was measured. step: of the resolution, where the values do
            not show it themselves (what a model leaves of a reading).
    """
    good = np.isfinite(values)
    third = np.diff(values, 3)
    third = third[np.isfinite(third)]
    if third.size < 8:
        return float("nan")
    if step is None:
        step = quantum_of(values[good])
    block = min(_BLOCK, third.size // _BLOCKS)
    spread = _in_blocks(third, block) if block == _BLOCK else _usual(third)
    if _SHORTEST_BLOCK <= block < _BLOCK and step > _FEW_STEPS * spread:
        spread = _in_blocks(third, block)
    return max(spread, noise_of_step(step))


def noise_of_step(step: float) -> float:
    """Return the standard deviation that a resolution alone makes, step / sqrt(12)."""
    return step / float(np.sqrt(12.0))


def _in_blocks(third: FloatArray, block: int) -> float:
    """Return the noise's standard deviation by the median of mean squares of blocks."""
    whole = third[: third.size // block * block].reshape(-1, block)
    middle = float(np.median(np.mean(whole**2, axis=1)))
    return float(np.sqrt(middle / _median_of(block / _CORRELATED) / THIRD))


def sharp_noise_of(values: FloatArray) -> float:
    """Return what a channel's readings flicker by, in its unit, without what its step may hide.

    The median of absolute third differences over stretches that move at all: 0 where readings
    stand still for as long as nothing moves. Where a step shows, over those that move by few of
    them, if there are any: what a servo moves by within 20 ms does not vanish in differences.

    Args:
        values: (n,), NaN where nothing was measured.
    """
    third, moves = np.diff(values, 3), np.abs(np.diff(values))
    known = np.isfinite(third)
    own = np.stack([moves[:-2], moves[1:-1], moves[2:]])[:, known]
    third, most = third[known], own.max(axis=0, initial=0.0)
    slow = (most > 0.0) & (most <= _SLOW * quantum_of(values))
    if np.count_nonzero(slow) >= _FEWEST_SLOW:
        third = third[slow]
    elif own.any():
        third = third[own[1] > 0.0]
    return _usual(third) if third.size else 0.0


def noise_of_input(values: FloatArray) -> float:
    """Return the standard deviation of a measured input's noise, in its unit (NaN: no samples).

    An input may jump in every block of a hundred samples, but hardly at every fourth of them. One
    that rests at a few levels was set to them: what lies between these is no resolution.

    Args:
        values: (n,), NaN where nothing was measured.
    """
    third = np.diff(values, 3)
    third = third[np.isfinite(third)]
    if third.size < 8:
        return float("nan")
    good = values[np.isfinite(values)]
    step = 0.0 if _is_set(good) else quantum_of(good)
    return max(_usual(third), noise_of_step(step))


def is_rough(values: FloatArray) -> bool:
    """Whether an input's differences show noise: those of what is smooth vanish order by order.

    The fifth differences of white noise have a mean square of 252, the third ones of 20.
    """
    third, fifth = (np.diff(values, order) for order in (3, 5))
    third, fifth = third[np.isfinite(third)], fifth[np.isfinite(fifth)]
    if fifth.size < 8:
        return False
    levels = [float(np.median(np.abs(own))) for own in (third, fifth)]
    return levels[1] > _ROUGH * levels[0] * float(np.sqrt(FIFTH / THIRD))


def _is_set(values: FloatArray) -> bool:
    """Whether readings are levels that something was set to: few ones, at which they rest.

    Readings of what moves, in steps of a resolution, flicker from one step to the next.
    """
    jumps = np.count_nonzero(np.diff(values))
    return bool(np.unique(values).size < _MANY_LEVELS and jumps < _RARELY * values.size)


def _median_of(freedom: float) -> float:
    """Return the median of chi-square, as a share of its mean (Wilson, Hilferty, PNAS 17, 684)."""
    return float((1.0 - 2.0 / (9.0 * freedom)) ** 3)


def _usual(third: FloatArray) -> float:
    """Return the noise's standard deviation that most third differences speak for."""
    return float(1.4826 * np.median(np.abs(third - np.median(third))) / np.sqrt(THIRD))


def quantum_of(values: FloatArray) -> float:
    """Return the step in which a channel is quantised (0 where no step shows).

    Levels that differ by no more than rounding to single precision are one. A step shows if all
    levels are multiples of it: what jumps from rest to rest comes by few of the levels between, and
    a fine encoder that moves on hardly comes twice by one. Where levels come twice for another
    reason (a channel that is held between its samples), it is what they differ by in the median.
    """
    levels = np.unique(values[np.isfinite(values)])
    if levels.size < _FEWEST_LEVELS:
        return 0.0
    steps = np.diff(levels)
    rounding = _ROUNDING * max(1e-300, float(np.abs(levels).max()))
    steps = steps[steps > rounding]
    if steps.size < _FEWEST_LEVELS - 1:
        return 0.0
    least = float(np.quantile(steps, _LEAST))
    for part in range(1, _PARTS + 1):
        step = least / part
        beside = np.abs(steps / step - np.rint(steps / step))
        if step > _COARSE * rounding and float(np.quantile(beside, 0.9)) < _WHOLE:
            return step
    return float(np.median(steps)) if steps.size < values.size / 2 else 0.0
