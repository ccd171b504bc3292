"""What an input was where its message was lost: a guess, and how far that may be off.

A command that was lost in the log still acted. Its neighbours say what it was where it goes
smoothly, and hardly anything where it jumps: a cubic through two messages on either side is the
guess, and what such cubics miss the messages nearby by is how far it may be off. Where all of them
are the same it is known; where many in a row are lost nothing is guessed. What a value unknown by
so much makes of a simulation counts as noise (`fit.lost_inputs`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray

_SIDE = 2
"""Messages on either side that a cubic goes through."""
_NEARBY = 3
"""Messages on either side that say how well it does."""
_JUMPS = 0.3
"""What cubics miss messages nearby by, as a share of half of what lies between both sides, where a
command jumps."""
_MOST = 3
"""Messages lost in a row that are guessed."""


@dataclass(frozen=True)
class LostValues:
    """An input's values that were not logged.

    Attributes:
        ticks: (k,) where they act from. stops: (k,) where the next message acts.
        spread: (k,) how far the value there may be off, SI.
        held: (k,) what was asked for before, where that may have acted on; None where it may not.
    """

    ticks: IndexArray
    stops: IndexArray
    spread: FloatArray
    held: FloatArray | None = None


def guess_lost(
    time: FloatArray, values: FloatArray, lost: BoolArray, *, may_be_held: bool = False
) -> tuple[FloatArray, LostValues]:
    """Return an input with guesses where its messages were lost, and how far they may be off.

    Args:
        time: (n,) s. values: (n,), NaN wherever there is no message. lost: (n,) lost messages.
        may_be_held: whether the message before may have acted on.
    """
    out = values.copy()
    there = np.flatnonzero(np.isfinite(values))
    at = _few_in_a_row(lost & ~np.isfinite(values), np.isfinite(values))
    if there.size < 2 * _SIDE:
        none = np.zeros(0, dtype=np.intp)
        return out, LostValues(none, none, np.zeros(0))
    t, y = time[there], values[there]
    place = np.searchsorted(there, at)
    inside = (place >= 1) & (place < there.size)
    at, place = at[inside], place[inside]
    spread = np.zeros(at.size)
    for k, (tick, after) in enumerate(zip(at, place, strict=True)):
        near = slice(max(0, after - _SIDE), after + _SIDE)
        if np.ptp(y[near]) == 0.0:
            out[tick] = y[near][0]
            continue
        out[tick] = _through(t[near], y[near], float(time[tick]))
        missed = [
            _through(np.delete(t[own], _SIDE), np.delete(y[own], _SIDE), float(t[j])) - y[j]
            for j in range(after - _NEARBY, after + _NEARBY)
            if _SIDE <= j < there.size - _SIDE
            for own in (slice(j - _SIDE, j + _SIDE + 1),)
        ]
        beside = 0.5 * abs(float(y[after] - y[after - 1]))
        spread[k] = max((abs(value) for value in missed), default=beside)
        if spread[k] > _JUMPS * beside:
            # it jumps here, and was what it is on either side
            spread[k] = max(spread[k], beside)
        if may_be_held:
            spread[k] = max(spread[k], abs(float(out[tick] - y[after - 1])))
    acting = np.append(np.flatnonzero(lost | np.isfinite(values)), values.size)
    stops = acting[np.searchsorted(acting, at) + 1]
    moves = spread > 0.0
    held = y[place - 1][moves] if may_be_held else None
    return out, LostValues(at[moves], stops[moves], spread[moves], held)


def _few_in_a_row(lost: BoolArray, there: BoolArray) -> IndexArray:
    """Return the lost messages of which few follow one another."""
    at = np.flatnonzero(lost)
    before = np.cumsum(there)[at]
    _, own, count = np.unique(before, return_inverse=True, return_counts=True)
    return at[count[own] <= _MOST]


def _through(t: FloatArray, y: FloatArray, at: float) -> float:
    """Return the value of the polynomial through some points."""
    total = 0.0
    for k in range(t.size):
        others = np.delete(t, k)
        total += float(y[k] * np.prod((at - others) / (t[k] - others)))
    return total
