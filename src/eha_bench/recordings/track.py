"""The samples of one topic or table in file order, before they meet a common clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray
from eha_bench.recordings.naming import printable

Stamps = NDArray[np.int64]
Column = FloatArray


@dataclass
class Track:
    """Samples of one topic.

    Attributes:
        name: the topic, or the file for a table.
        stamps: (n,) nanoseconds by the wanted clock.
        columns: field path or column name -> (n,) raw values; NaN where a message lacks the field.
        kinds: field path or column name -> NumPy type of the raw values, where it is known.
    """

    name: str
    stamps: Stamps
    columns: dict[str, Column] = field(default_factory=dict)
    kinds: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        """Number of samples."""
        return int(self.stamps.size)

    def rows(self, index: IndexArray | BoolArray) -> Track:
        """Return some of the samples."""
        columns = {name: column[index] for name, column in self.columns.items()}
        return Track(self.name, self.stamps[index], columns, self.kinds)


class Arena:
    """One block of memory for many columns: the system hands out large blocks much faster."""

    def __init__(self, size: int = 0) -> None:
        self._block = np.empty(size)
        self._used = 0

    def take(self, count: int) -> FloatArray:
        """Return memory for `count` numbers; a new block once the arena is used up."""
        start = self._used
        if start + count > self._block.size:
            return np.empty(count)
        self._used = start + count
        return self._block[start : start + count]


_ENOUGH = 0.9
"""A column of an arena that is so full is not copied to give the rest back."""


class GrowingArray:
    """An array that grows; what was not needed is given back at the end."""

    def __init__(self, memory: NDArray[Any]) -> None:
        self._array = memory
        self._count = 0

    def extend(self, count: int) -> NDArray[Any]:
        """Return the next `count` places, to be written."""
        stop = self._count + count
        if stop > self._array.size:
            self._resize(max(stop, self._array.size * 3 // 2, 256))
        place = self._array[self._count : stop]
        self._count = stop
        return place

    def part(self, start: int, stop: int) -> NDArray[Any]:
        """Return what was written at some places; gone with the next `extend`."""
        return self._array[start:stop]

    def __len__(self) -> int:
        """Number of places handed out."""
        return self._count

    def finish(self) -> NDArray[Any]:
        """Return the array at its final length."""
        if self._array.base is not None and self._count > _ENOUGH * self._array.size:
            return self._array[: self._count]
        if self._count != self._array.size:
            self._resize(self._count)
        return self._array

    def _resize(self, size: int) -> None:
        if self._array.base is None:
            self._array.resize(size, refcheck=False)
            return
        larger = np.empty(size, dtype=self._array.dtype)
        kept = min(size, self._count)
        larger[:kept] = self._array[:kept]
        self._array = larger


def freeze(array: NDArray[Any]) -> None:
    """Make an array read-only, and the memory that it is a part of."""
    inner: Any = array
    while isinstance(inner, np.ndarray):
        inner.setflags(write=False)
        inner = inner.base


class StampColumn:
    """A topic's stamps; those of topics that tick together are kept in memory only once."""

    def __init__(self, expected: int = 0, leader: StampColumn | None = None) -> None:
        self._leader = leader
        own = np.empty(max(expected, 256), dtype=np.int64) if leader is None else None
        self._own = None if own is None else GrowingArray(own)
        self._count = 0

    def __len__(self) -> int:
        """Number of stamps."""
        return self._count

    def extend(self, stamps: Stamps) -> None:
        """Add stamps, shape (m,)."""
        stop = self._count + stamps.size
        if self._own is None:
            leader = self._leader
            if (
                leader is not None
                and len(leader) >= stop
                and np.array_equal(leader.part(self._count, stop), stamps)
            ):
                self._count = stop
                return
            self._own = GrowingArray(np.empty(stop, dtype=np.int64))
            if leader is not None and self._count:
                self._own.extend(self._count)[:] = leader.part(0, self._count)
        self._own.extend(stamps.size)[:] = stamps
        self._count = stop

    def part(self, start: int, stop: int) -> Stamps:
        """Return some of the stamps; gone with the next `extend`."""
        if self._own is None:
            assert self._leader is not None
            return self._leader.part(start, stop)
        return self._own.part(start, stop)

    def finish(self) -> Stamps:
        """Return the stamps; the same array for topics that have the same."""
        if self._own is not None:
            return self._own.finish()
        assert self._leader is not None
        stamps = self._leader.finish()
        return stamps if stamps.size == self._count else stamps[: self._count]


def beyond_range(topic: str, stamps: Stamps) -> str:
    """Return a note on stamps that no clock gives, of 2^63 ns and more; empty if there are none."""
    if not stamps.size or stamps.min() >= 0:  # takes no memory, other than a comparison
        return ""
    count = int(np.count_nonzero(stamps < 0))
    return (
        f"topic '{printable([topic])}': {count} of {stamps.size} messages have a time out of range"
    )
