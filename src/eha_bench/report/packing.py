"""Curves packed for a page: envelopes where nothing happens, every sample around events.

A curve is 16-bit levels of its range, stored as differences, the low bytes before the high
ones, deflated and in base64; `charts.js` unpacks it. The shared clock is a list of stretches.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.arrays import FloatArray, IndexArray

FULL: Final = 8192
"""Samples of a recording that are stored one by one, at most."""
STRETCHES: Final = 1000
"""Pairs of smallest and largest value that stand for the rest, about."""

_GAP: Final = -32768  # the level that says: nothing was measured
_TOP: Final = 32767
_UNEVEN: Final = 0.02  # of a period: time stamps closer to even ones are taken as even


@dataclass(frozen=True)
class Stretch:
    """Consecutive samples [start, stop), stored in groups of `group` (1: every sample).

    Of a group larger than one its smallest and its largest value are stored.
    """

    start: int
    stop: int
    group: int

    @property
    def groups(self) -> int:
        """How many groups there are; the last one takes what is left over."""
        return max(1, (self.stop - self.start) // self.group)

    def starts(self) -> IndexArray:
        """Index of the first sample of each group."""
        return self.start + self.group * np.arange(self.groups, dtype=np.intp)

    def times(self, time: FloatArray) -> FloatArray:
        """Where the stored values are drawn, s: a group's two at a quarter and three quarters."""
        if self.group == 1:
            return time[self.start : self.stop]
        first = time[self.starts()]
        # The last group is longer; drawn as wide as the others, the spacing stays even.
        width = np.diff(first)
        width = np.append(width, width[-1] if width.size else time[self.stop - 1] - first[-1])
        return np.column_stack((first + 0.25 * width, first + 0.75 * width)).ravel()

    def values(self, values: FloatArray) -> FloatArray:
        """What is stored of a channel."""
        if self.group == 1:
            return values[self.start : self.stop]
        part, starts = values[self.start : self.stop], self.starts() - self.start
        return np.column_stack(
            (np.fmin.reduceat(part, starts), np.fmax.reduceat(part, starts))
        ).ravel()


def stretches(time: FloatArray, events: Iterable[float]) -> tuple[Stretch, ...]:
    """Return how a recording is parted: every sample around events, as far as `FULL` allows.

    Args:
        time: (n,) s, increasing.
        events: instants in s that are looked at closely.
    """
    count = time.size
    if count <= FULL:
        return (Stretch(0, count, 1),) if count else ()
    places = np.unique(np.searchsorted(time, sorted(events)))
    places = places[(places > 0) & (places < count)]
    group = max(2, count // STRETCHES)
    windows = _windows(places, count, FULL)
    parts: list[Stretch] = []
    at = 0
    for start, stop in [*windows, (count, count)]:
        if start > at:
            parts.append(Stretch(at, start, min(group, start - at)))
        if stop > start:
            parts.append(Stretch(start, stop, 1))
        at = max(at, stop)
    return tuple(parts)


def _windows(places: IndexArray, count: int, budget: int) -> list[tuple[int, int]]:
    """Windows around events, an eighth before and the rest after, merged where they meet."""
    if places.size == 0:
        return []
    length = max(64, budget // places.size)
    merged: list[tuple[int, int]] = []
    for place in places[: budget // 64]:
        start, stop = max(0, int(place) - length // 8), min(count, int(place) + length * 7 // 8)
        if merged and start <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(stop, merged[-1][1]))
        else:
            merged.append((start, stop))
    return merged


def packed_clock(time: FloatArray, parts: Sequence[Stretch]) -> list[dict[str, Any]]:
    """Return the stored instants of each stretch: start, period and count, or packed if uneven."""
    clock: list[dict[str, Any]] = []
    for part in parts:
        times = part.times(time)
        entry: dict[str, Any] = {"n": int(times.size), "envelope": part.group > 1}
        start, period = float(times[0]), 0.0
        if times.size > 1:
            period = float((times[-1] - times[0]) / (times.size - 1))
        even = start + period * np.arange(times.size)
        if np.max(np.abs(times - even)) <= _UNEVEN * period or times.size <= 2:
            entry |= {"start": _short(start), "period": _short(period)}
        else:
            span = float(times[-1] - times[0])
            ticks = np.round((times - times[0]) / span * 0xFFFFFFFF).astype(np.uint64)
            steps = np.diff(ticks, prepend=np.uint64(0)).astype("<u4")
            entry |= {"start": _short(start), "span": span, "packed": _packed(steps)}
        clock.append(entry)
    return clock


def packed_curve(values: FloatArray, parts: Sequence[Stretch]) -> dict[str, Any]:
    """Return a channel as `{low, step, data}`: value = low + step * level."""
    stored = np.concatenate([part.values(values) for part in parts])
    finite = np.isfinite(stored)
    low = float(np.min(stored[finite])) if finite.any() else 0.0
    high = float(np.max(stored[finite])) if finite.any() else 0.0
    middle, step = low / 2.0 + high / 2.0, (high / 2.0 - low / 2.0) / _TOP
    levels = np.full(stored.size, _GAP, dtype=np.int64)
    levels[finite] = (
        np.round((stored[finite] - middle) / step).astype(np.int64) if step > 0.0 else 0
    )
    steps = np.diff(levels, prepend=0).astype(np.int16).astype("<u2")
    return {"middle": middle, "step": step, "data": _packed(steps)}


def _packed(numbers: NDArray[Any]) -> str:
    """Deflate little-endian numbers byte plane by byte plane; base64."""
    planes = numbers.view(np.uint8).reshape(-1, numbers.dtype.itemsize).T
    squeezed = zlib.compress(np.ascontiguousarray(planes).tobytes(), 9)
    return base64.b64encode(squeezed).decode("ascii")


def _short(value: float) -> float:
    return float(f"{value:.12g}")
