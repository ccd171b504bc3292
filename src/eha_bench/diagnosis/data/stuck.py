"""Where a reading stands still while what it reads does not: stuck, latched or clipped."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_STUCK = 40
_COMMON = 0.3
_NEVER = 1e-6
"""Expected number of stretches in a run from which one is none of chance."""
_ABRUPT = 1.5
"""Change from sample to sample, in steps of the resolution, of what does not stand still itself."""
_BESIDE = 5
_LET_GO = 3.0
"""Jump over the usual change from sample to sample by which a latched reading comes back."""


def stuck(raw: FloatArray, resolution: float) -> BoolArray:
    """Return the samples in stretches of equal values that this channel's noise makes impossible.

    Forty are enough where equal neighbours are rare. Fewer are where by chance no stretch of this
    length would come, and the signal itself did not rest: when it was let go it had gone on
    (latched), or it ran into the end of its range (clipped). What reads the same as a stretch
    there is clipped as well.

    Args:
        raw: (n,), NaN where nothing was measured. resolution: of the channel, in its unit.
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
    by_chance = np.log(_NEVER / raw.size) / np.log(max(common, 1.0 / raw.size))
    ends = {float(np.nanmin(raw)), float(np.nanmax(raw))}
    coarse = _ABRUPT * resolution
    for start, length in zip(starts, lengths, strict=True):
        stop = start + length + 1
        at_end = float(raw[start]) in ends
        # a run may begin at rest
        unlikely = length > by_chance and start > 0 and stop < raw.size
        if length >= _STUCK or (unlikely and _went_on(raw, start, stop, coarse, at_end=at_end)):
            mask[start:stop] = True
            if at_end:
                mask |= raw == raw[start]
    return mask


def _went_on(raw: FloatArray, start: int, stop: int, coarse: float, *, at_end: bool) -> bool:
    """Whether a signal moved while its reading stood still from `start` to `stop`."""
    before, after = (
        np.abs(np.diff(side))
        for side in (raw[max(0, start - _BESIDE) : start + 1], raw[stop : stop + _BESIDE + 1])
    )
    beside = [float(np.nanmean(side)) for side in (before, after) if np.isfinite(side).any()]
    if not beside:
        return False
    jump = abs(float(raw[stop]) - float(raw[stop - 1]))
    return (at_end and max(beside) > coarse) or jump > max(_LET_GO * max(beside), coarse)
