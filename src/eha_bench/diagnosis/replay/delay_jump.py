"""Runs whose readings come later, or earlier, from some moment on.

A bus that falls behind, a log whose clock is set anew, or a buffer that fills shifts everything
that is read by one and the same time, which no physics does. With the model's whole replay s(t), a
run's readings y(t) and shifts k_1 before and k_2 after a moment m,

    cost(m, k_1, k_2) = sum over t < m of (y(t) - s(t - k_1))^2 / floor^2
                      + sum over t >= m of (y(t) - s(t - k_2))^2 / floor^2

is least somewhere. It is a jump where each part, and what lies next to the moment on either side,
needs its own shift: with the other part's the error is at least 1.7 times as large, in every
channel that shows an error at all, and where a second model shows the same. A lag that grows
slowly, as friction's or a frequency sweep's, prefers neither next to the moment; an offset of a
slow ramp, which looks like a shift, is left out with the means over a second.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter1d

from eha_bench.core.arrays import FloatArray, IndexArray
from eha_bench.diagnosis.replay.replay import Columns, Replay

_LONGEST: Final = 0.25
"""Longest shift that is looked for, s."""
_LEAST: Final = 2
_LEAST_TIME: Final = 0.01
"""Samples, and s, by which the two shifts differ at least: a model's own lag may change by less."""
_SHORTEST: Final = 1.0
_PART: Final = 0.05
"""Least time before the jump, and after it: s, and as a part of the run."""
_HEAD: Final = 2
"""Multiple of that before the jump: what lies next to it must not be a run's start from rest."""
_TAIL_PARTS: Final = 4
"""Equal parts of what follows the jump, each of which has to show it: one event is no delay."""
_SLOW: Final = 1.0
"""Means over so many s are left out: on a slow ramp an offset looks like a shift."""
_LESS: Final = 0.6
"""What its own shift leaves of the error of a part, at most. A real arm's jump, by models that lack
its friction and weight, leaves 0.2 to 0.6; what is no jump leaves 0.95 or more of some part."""
_AGREES: Final = 0.8
"""The same by another model, which has to agree: the phase of a sweep that passes a resonance where
one model has none looks like a jump of 30 ms."""
_SEEN: Final = 3.0
"""That error in noise floors, at least."""
_SHIFTS: Final = 18
"""Shifts of each sign, denser where they are short."""
_MODELS: Final = 2
"""The last model shows a jump best; where it is far off, the one before may. Both have to agree."""


@dataclass(frozen=True)
class DelayJump:
    """A moment from which on readings come later.

    Attributes:
        time: s from the run's first sample. later: s, below 0 where they come earlier.
        channel: that it shows in most. error: of that channel after the moment, SI.
        shifted: what is left of it where the simulation is shifted.
    """

    time: float
    later: float
    channel: str
    error: float
    shifted: float


@dataclass(frozen=True)
class _Split:
    """A moment, as a sample, and the shift before and after it, as rows of `_Squares`."""

    moment: int
    first: int
    second: int


@dataclass(frozen=True)
class _Squares:
    """Squared differences of one run and one model's shifted replays.

    Attributes:
        shifts: (k,) samples. by_channel: channel -> (k, n). total: their sum in noise floors.
    """

    shifts: IndexArray
    by_channel: Mapping[str, FloatArray]
    total: FloatArray

    def best_split(self, least: int) -> _Split:
        """Return where one shift before and another after cost least.

        Args:
            least: samples after it, and half of those before.
        """
        before = np.cumsum(self.total, axis=1)
        after = before[:, -1:] - before
        last = np.arange(_HEAD * least - 1, self.total.shape[1] - least)
        costs = before[:, last].min(axis=0) + after[:, last].min(axis=0)
        place = int(last[int(costs.argmin())])
        return _Split(place + 1, int(before[:, place].argmin()), int(after[:, place].argmin()))

    def is_least(self, split: _Split) -> bool:
        """Whether both shifts lie within those that were looked at: at an end is no minimum."""
        return all(0 < row < self.shifts.size - 1 for row in (split.first, split.second))

    def is_sharp(self, split: _Split, least: int, less: float) -> bool:
        """Whether each part needs its own shift, next to the moment too, and to the very end.

        Args:
            split: where. least: samples next to the moment. less: what the own shift leaves of a
                part's error at most.
        """
        moment, first, second = split.moment, split.first, split.second
        edges = np.linspace(moment, self.total.shape[1], _TAIL_PARTS + 1).astype(int)
        later = [slice(moment, moment + least), *(slice(*ends) for ends in pairwise(edges))]
        earlier = [slice(moment), slice(moment - least, moment)]
        return all(self._prefers(part, first, second, less) for part in earlier) and all(
            self._prefers(part, second, first, less) for part in later
        )

    def _prefers(self, part: slice, own: int, other: int, less: float) -> bool:
        rows = self.total[:, part].sum(axis=1)
        return bool(rows[own] < less**2 * rows[other])


def delay_jump(item: Replay, floors: Mapping[str, float]) -> DelayJump | None:
    """Return the moment from which on a run's readings follow the models later, if any.

    A replay over which small errors add up keeps no time to a few milliseconds, and tells nothing.

    Args:
        item: a run as measured and replayed. floors: channel -> noise floor, SI.
    """
    if not item.is_bounded:
        return None
    models = reversed(item.simulated[-_MODELS:])
    seen = [_compared(item, simulated, floors) for simulated in models]
    clear = (one for one in seen if one is not None and one.is_jump(_LESS))
    first = next(clear, None)
    if first is None or not all(one is not None and one.agrees(first) for one in seen):
        return None
    return first.jump(floors)


@dataclass(frozen=True)
class _Compared:
    """One run and one model's replay at the best split.

    Attributes:
        item: the run. squares: of all shifts. split: the best. longest: shift, samples.
        least: samples of a part at least.
    """

    item: Replay
    squares: _Squares
    split: _Split
    longest: int
    least: int

    @property
    def time(self) -> float:
        """Moment of the split, s."""
        return float(self.item.time[self.longest + self.split.moment])

    @property
    def later(self) -> float:
        """By how much readings come later from there on, s."""
        shifts = self.squares.shifts
        return int(shifts[self.split.second] - shifts[self.split.first]) * self.item.tick

    def is_jump(self, less: float) -> bool:
        """Whether it is far enough, a minimum, and sharp; own shifts leave `less` at most."""
        far = abs(self.later) >= max(_LEAST * self.item.tick, _LEAST_TIME) * (1.0 - 1e-9)
        inside = far and self.squares.is_least(self.split)
        return inside and self.squares.is_sharp(self.split, self.least, less)

    def agrees(self, other: _Compared) -> bool:
        """Whether it shows what another model shows, if less clearly."""
        near = abs(self.time - other.time) <= _SHORTEST and self.later * other.later > 0.0
        return near and self.is_jump(_AGREES)

    def jump(self, floors: Mapping[str, float]) -> DelayJump | None:
        """Return the jump, if every channel that shows an error shows it."""
        seen = []
        for name, squares in self.squares.by_channel.items():
            rest = squares[:, self.split.moment :]
            error, shifted = (
                float(np.sqrt(rest[k].mean())) for k in (self.split.first, self.split.second)
            )
            if error > _SEEN * floors[name]:
                seen.append((error / floors[name], name, error, shifted))
        if not seen or any(shifted > _LESS * error for _, _, error, shifted in seen):
            return None
        _, name, error, shifted = max(seen)
        return DelayJump(self.time, self.later, name, error, shifted)


def _compared(item: Replay, simulated: Columns, floors: Mapping[str, float]) -> _Compared | None:
    """Return a run and one model's replay at the best split; None where it is too short."""
    names = [name for name in item.measured if floors.get(name, 0.0) > 0.0]
    if not names or item.time.size < 2:
        return None
    tick = item.tick
    longest = round(_LONGEST / tick)
    least = max(round(_SHORTEST / tick), round(_PART * item.time.size))
    if longest < _LEAST or item.time.size - 2 * longest < (_HEAD + 1) * least:
        return None
    pairs = {
        name: (_quick(item.measured[name], tick), _quick(simulated[name], tick)) for name in names
    }
    squares = _squares(pairs, floors, longest)
    return _Compared(item, squares, squares.best_split(least), longest, least)


def _quick(values: FloatArray, tick: float) -> FloatArray:
    """Return values (n,) less their running mean; NaN stays."""
    there = np.isfinite(values)
    if not there.any():
        return values
    places = np.arange(values.size)
    filled = np.interp(places, places[there], values[there])
    slow = uniform_filter1d(filled, max(1, round(_SLOW / tick)), mode="nearest")
    return np.where(there, filled - slow, np.nan)


def _squares(
    pairs: Mapping[str, tuple[FloatArray, FloatArray]], floors: Mapping[str, float], longest: int
) -> _Squares:
    """Return squares of measured less shifted simulation, 0 where nothing was read.

    Args:
        pairs: channel -> measured and simulated, (n,) each. floors: channel -> noise floor, SI.
        longest: shift in samples; as many at each end of a run are left out.
    """
    ends = np.unique(np.round(np.geomspace(1, longest, _SHIFTS)).astype(int))
    shifts = np.concatenate([-ends[::-1], [0], ends])
    squares = {}
    for name, (measured, simulated) in pairs.items():
        inner = slice(longest, measured.size - longest)
        rows = np.stack([measured[inner] - np.roll(simulated, k)[inner] for k in shifts])
        rows *= rows
        rows[:, ~np.isfinite(rows).all(axis=0)] = 0.0
        squares[name] = rows
    total = np.sum([rows / floors[name] ** 2 for name, rows in squares.items()], axis=0)
    return _Squares(shifts, squares, total)


def ended_at_jumps(
    replays: Sequence[Replay], floors: Mapping[str, float]
) -> tuple[tuple[Replay, ...], tuple[str, ...]]:
    """Return replays that are compared up to a jump of their delay, and a sentence on each jump.

    Args:
        replays: of all runs. floors: channel -> noise floor, SI.
    """
    found, notes = [], []
    for item in replays:
        jump = delay_jump(item, floors)
        if jump is not None:
            notes.append(jump_note(item, jump, "its errors are counted"))
        found.append(item if jump is None else replace(item, until=jump.time))
    return tuple(found), tuple(notes)


def jump_note(item: Replay, jump: DelayJump, what: str) -> str:
    """Say where a run's delay jumps, by how much, and what happens up to there."""
    unit = item.unit(jump.channel)
    word = "later" if jump.later > 0.0 else "earlier"
    return (
        f"{item.run}: from {jump.time:.4g} s on the readings follow the model "
        f"{1e3 * abs(jump.later):.3g} ms {word} than before (shifted by that, '{jump.channel}' "
        f"errs by {jump.shifted:.3g} {unit} instead of {jump.error:.3g}): {what} up to there; "
        "look at the bus and the log's clock"
    )
