"""Where a reading stands still while what it reads does not: stuck, latched or clipped."""

from __future__ import annotations

from collections import Counter

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray

_STUCK = 40
_COMMON = 0.3
_NEVER = 1e-6
"""Expected number of stretches in a run from which one is none of chance."""
FLICKERS = 0.5
"""Noise, in steps of the resolution, up to which a reading may rest."""
_CREEPS = 0.8
"""The same of one that stood still at several levels: what creeps by single steps has 0.66."""
_RESTS = 3
"""Levels from which standing still is what a machine does that moves from rest to rest."""
_BENDS = 0.3
"""Share of the steepest step next to an end that its nearest steps have where it is cut."""
_ABRUPT = 1.5
"""Change from sample to sample, in steps of the resolution, of what does not stand still itself."""
_BESIDE = 5
_LET_GO = 3.0
"""Jump over the usual change from sample to sample by which a latched reading comes back."""


def stuck(raw: FloatArray, resolution: float, noise: float = np.inf) -> BoolArray:
    """Return the samples in stretches of equal values that this channel's noise makes impossible.

    Forty are enough where noise would have moved the reading; where it is finer than the
    resolution, a machine that stalls, rests at a stop, or moves from rest to rest, reads the same
    for as long as it does.
    Fewer are where by chance no stretch of this length would come, and the signal itself did not
    rest: when it was let go it had gone on (latched), or it ran into the same end of its range and
    left it as it came (clipped), at least twice or for long; all that reads this end is clipped
    then. A signal that bends into an end is flat, and none of these.

    Args:
        raw: (n,), NaN where nothing was measured. resolution: of the channel, in its unit.
        noise: its standard deviation, in its unit (default: enough to move the reading).
    """
    mask = np.zeros(raw.size, dtype=np.bool_)
    same = np.diff(raw) == 0.0
    if not same.any():
        return mask
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
    starts, lengths = edges[::2], edges[1::2] - edges[::2]
    long = lengths >= _STUCK
    outside = int(same.sum() - lengths[long].sum())
    others = int(same.size - lengths[long].sum())
    # where equal neighbours are common (a coarse encoder at rest), standing still proves nothing
    common = outside / others if others else 1.0
    if others < _STUCK or common > _COMMON:
        return mask
    levels = np.unique(raw[starts[long]]).size
    may_rest = noise <= (_CREEPS if levels >= _RESTS else FLICKERS) * resolution
    by_chance = np.log(_NEVER / raw.size) / np.log(max(common, 1.0 / raw.size))
    ends = {float(np.nanmin(raw)), float(np.nanmax(raw))}
    coarse = _ABRUPT * resolution
    clipped: Counter[float] = Counter()
    for start, length in zip(starts, lengths, strict=True):
        stop = start + length + 1
        if length >= _STUCK and not may_rest:
            mask[start:stop] = True
        # a run may begin at rest
        if length > by_chance and start > 0 and stop < raw.size:
            change = _change_beside(raw, start, stop)
            if _was_latched(raw, start, stop, max(_LET_GO * max(change), coarse)):
                mask[start:stop] = True
            elif float(raw[start]) in ends and min(change) > coarse and _is_cut(raw, start, stop):
                clipped[float(raw[start])] += 2 if length >= _STUCK else 1
    for value, times in clipped.items():
        # a play or a reversal may hold a reading as well, but hardly twice at the same value
        if times > 1:
            mask |= raw == value
    return mask


def _is_cut(raw: FloatArray, start: int, stop: int) -> bool:
    """Whether a signal runs into an end and out of it as steeply as it does before and after.

    One that saturates by itself bends: its last step is a small part of those before it.
    """
    before = np.abs(np.diff(raw[max(0, start - _BESIDE) : start + 1]))
    after = np.abs(np.diff(raw[stop - 1 : stop + _BESIDE]))
    if before.size < 3 or after.size < 3:
        return True
    sides = (before[-3:], after[:3])
    wholes = (before, after)
    return all(
        float(np.nanmedian(near)) > _BENDS * float(np.nanmax(whole))
        for near, whole in zip(sides, wholes, strict=True)
    )


def _change_beside(raw: FloatArray, start: int, stop: int) -> tuple[float, float]:
    """Return the mean change from sample to sample before and after a stretch."""
    sides = (raw[max(0, start - _BESIDE) : start + 1], raw[stop : stop + _BESIDE + 1])
    changes = [np.abs(np.diff(side)) for side in sides]
    before, after = (float(np.nanmean(c)) if np.isfinite(c).any() else 0.0 for c in changes)
    return before, after


def _was_latched(raw: FloatArray, start: int, stop: int, least: float) -> bool:
    """Whether a reading jumps when it is let go; one of nothing must have jumped there as well."""
    came = abs(float(raw[start]) - float(raw[start - 1]))
    went = abs(float(raw[stop]) - float(raw[stop - 1]))
    return went > least and (float(raw[start]) != 0.0 or came > least)
