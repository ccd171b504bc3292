"""What an input was where its message was lost: a guess, and how far that may be off.

A command that was lost in the log still acted. Its neighbours say what it was where it goes
smoothly, and hardly anything where it jumps: a cubic through two messages on either side is the
guess, and what such cubics miss as many messages nearby by is how far it may be off. Where all of
them are the same it is known; where many in a row are lost nothing is guessed. What a value unknown
by so much makes of a simulation counts as noise (`fit.lost_inputs`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray

_SIDE = 2
"""Messages on either side that a cubic goes through."""
_NEARBY = 3
"""Messages on either side that say how well it does."""
_JUMPS = 0.3
"""What cubics miss messages nearby by, as a share of half of what lies between both sides, where a
command jumps."""
_MOST = 10
"""Messages lost in a row that are guessed."""
_ALONE = 3
"""Messages lost in a row that are each unknown by themselves; behind more a window begins anew."""


@dataclass(frozen=True)
class LostValues:
    """An input's values that were not logged.

    Attributes:
        ticks: (k,) where they act from. stops: (k,) where the next message acts.
        spread: (k,) how far the value there may be off, SI.
        held: (k,) what was asked for before, where that may have acted on; None where it may not.
        anew: (j,) where a message acts behind so many lost ones that windows begin anew.
    """

    ticks: IndexArray
    stops: IndexArray
    spread: FloatArray
    held: FloatArray | None = None
    anew: IndexArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))


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
    acting = np.append(np.flatnonzero(lost | np.isfinite(values)), values.size)
    found: list[tuple[int, int, float, float]] = []
    anew: list[int] = []
    if there.size >= 2 * _SIDE:
        t, y = time[there], values[there]
        for row, after in _few_in_a_row(lost & ~np.isfinite(values), there):
            own = row
            near = slice(max(0, after - _SIDE), after + _SIDE)
            if np.ptp(y[near]) == 0.0:
                out[own] = y[near][0]
                continue
            out[own] = [_through(t[near], y[near], float(time[tick])) for tick in own]
            spread = _missed(t, y, after, own.size)
            if may_be_held:
                spread = np.maximum(spread, np.abs(out[own] - y[after - 1]))
            stops = acting[np.searchsorted(acting, own) + 1]
            if own.size > _ALONE:
                # what bends between both sides is missed on one side all along
                own, stops = own[:1], stops[-1:]
                spread = np.sqrt(np.mean(spread**2, keepdims=True))
                anew.append(int(stops[0]))
            held = float(y[after - 1])
            found += [
                (int(tick), int(stop), float(off), held)
                for tick, stop, off in zip(own, stops, spread, strict=True)
                if off > 0.0
            ]
    at, until, off, before = zip(*found, strict=True) if found else ((), (), (), ())
    return out, LostValues(
        np.array(at, dtype=np.intp),
        np.array(until, dtype=np.intp),
        np.array(off),
        np.array(before) if may_be_held else None,
        np.array(anew, dtype=np.intp),
    )


def _few_in_a_row(lost: BoolArray, there: IndexArray) -> Iterator[tuple[IndexArray, int]]:
    """Yield lost messages that follow one another, if they are few, and which one is read next."""
    at = np.flatnonzero(lost)
    place = np.searchsorted(there, at)
    for after in np.unique(place):
        own = at[place == after]
        if own.size <= _MOST and 1 <= after < there.size:
            yield own, int(after)


def _missed(t: FloatArray, y: FloatArray, after: int, count: int) -> FloatArray:
    """Return what cubics miss messages nearby by, where as many in a row are left out, (count,).

    Args:
        t, y: (m,) messages. after: the first behind those that were lost. count: of these.
    """
    first = [*range(after - _NEARBY, after + _NEARBY)]
    if count > 1:
        # across those that were lost twice as many are missing: two of these show a jump
        last = after - _SIDE - count
        before, behind = range(last - _NEARBY + 1, last + 1), range(_SIDE, _SIDE + _NEARBY)
        first = [*before, after - count, after, *(after + k for k in behind)]
    beside = 0.5 * abs(float(y[after] - y[after - 1]))
    missed = [
        [abs(_through(t[sides], y[sides], float(t[j])) - y[j]) for j in range(k, k + count)]
        for k in first
        if k >= _SIDE and k + count + _SIDE <= t.size
        for sides in (np.r_[k - _SIDE : k, k + count : k + count + _SIDE],)
    ]
    spread = np.max(missed, axis=0) if missed else np.full(count, beside)
    # where it jumps here, it was what it is on either side
    return np.where(spread > _JUMPS * beside, np.maximum(spread, beside), spread)


def _through(t: FloatArray, y: FloatArray, at: float) -> float:
    """Return the value of the polynomial through some points."""
    total = 0.0
    for k in range(t.size):
        others = np.delete(t, k)
        total += float(y[k] * np.prod((at - others) / (t[k] - others)))
    return total
