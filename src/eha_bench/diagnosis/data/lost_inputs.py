"""What an input was where its message was lost: a guess, and how far that may be off.

A command that was lost in the log still acted. Its neighbours say what it was where it goes
smoothly, and hardly anything where it jumps: a cubic through two messages on either side is the
guess, and what such cubics miss as many messages nearby by is how far it may be off. Where all of
them are the same it is known; where those on both sides are, a cubic would swing beyond a command
that is held. No guess is beyond all that was ever asked for; where many in a row are lost nothing
is guessed. What a value unknown by so much makes of a simulation counts as noise
(`fit.lost_inputs`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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
    gaps: list[_Gap] = []
    if there.size >= 2 * _SIDE:
        messages = _Commands(time[there], values[there])
        acting = np.append(np.flatnonzero(lost | np.isfinite(values)), values.size)
        for own, after in _few_in_a_row(lost & ~np.isfinite(values), there):
            out[own] = messages.guessed(time[own], after)
            spread = messages.spread(out[own], after, may_be_held=may_be_held)
            stops = acting[np.searchsorted(acting, own) + 1]
            gaps.append(_Gap(own, stops, spread, float(values[there[after - 1]])))
    return out, _unknown_in(gaps, may_be_held=may_be_held)


@dataclass(frozen=True)
class _Gap:
    """Messages lost in a row: where each acts, until when, how far it may be off; and the last."""

    ticks: IndexArray
    stops: IndexArray
    spread: FloatArray
    before: float

    @property
    def is_long(self) -> bool:
        """Whether its messages are unknown together."""
        return self.ticks.size > _ALONE

    @property
    def together(self) -> _Gap:
        """A long one as one message, as what bends is missed on one side all along."""
        if not self.is_long:
            return self
        spread = np.sqrt(np.mean(self.spread**2, keepdims=True))
        return _Gap(self.ticks[:1], self.stops[-1:], spread, self.before)


def _unknown_in(gaps: Sequence[_Gap], *, may_be_held: bool) -> LostValues:
    """Return what is unknown in gaps."""
    moving = [gap for gap in gaps if gap.spread.any()]
    parts = [gap.together for gap in moving]
    ticks = np.concatenate([np.zeros(0, dtype=np.intp), *(gap.ticks for gap in parts)])
    stops = np.concatenate([np.zeros(0, dtype=np.intp), *(gap.stops for gap in parts)])
    spread = np.concatenate([np.zeros(0), *(gap.spread for gap in parts)])
    held = np.concatenate([np.zeros(0), *(np.full(gap.ticks.size, gap.before) for gap in parts)])
    known = spread > 0.0
    anew = np.array([int(gap.stops[-1]) for gap in moving if gap.is_long], dtype=np.intp)
    return LostValues(
        ticks[known], stops[known], spread[known], held[known] if may_be_held else None, anew
    )


@dataclass(frozen=True)
class _Commands:
    """The messages of an input that are there: when, s, and what, SI."""

    time: FloatArray
    values: FloatArray

    def guessed(self, at: FloatArray, after: int) -> FloatArray:
        """Return the cubic through the messages round a gap, at some instants.

        Args:
            at: (k,) s. after: the first message behind the gap.
        """
        near, before = self._near(after), self.values[after - 1]
        if before == self.values[after] and np.sum(self.values[near] == before) > _SIDE:
            # held on one side at least, not at the top of a swing
            return np.full(at.size, before)
        found = [_through(self.time[near], self.values[near], float(instant)) for instant in at]
        return np.clip(found, self.values.min(), self.values.max())

    def spread(self, guess: FloatArray, after: int, *, may_be_held: bool) -> FloatArray:
        """Return how far a guess may be off: none where the messages round the gap are the same."""
        if self._rests(after):
            return np.zeros(guess.size)
        missed = _missed(self.time, self.values, after, guess.size)
        before = float(self.values[after - 1])
        return np.maximum(missed, np.abs(guess - before)) if may_be_held else missed

    def _near(self, after: int) -> slice:
        """Return the messages round a gap."""
        return slice(max(0, after - _SIDE), after + _SIDE)

    def _rests(self, after: int) -> bool:
        """Whether the messages round a gap are the same."""
        return float(np.ptp(self.values[self._near(after)])) == 0.0


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
