"""The samples of one topic or table in file order, before they meet a common clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Stamps = NDArray[np.int64]
Column = NDArray[np.float64]


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

    def rows(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> Track:
        """Return some of the samples."""
        columns = {name: column[index] for name, column in self.columns.items()}
        return Track(self.name, self.stamps[index], columns, self.kinds)


class Growing:
    """An array that grows; memory is taken as it is needed, and given back at the end."""

    def __init__(self, kind: type[np.float64 | np.int64], expected: int = 0) -> None:
        self._count = 0
        self._array: NDArray[Any] = np.empty(max(expected, 256), dtype=kind)

    def extend(self, count: int) -> NDArray[Any]:
        """Return the next `count` places, to be written."""
        stop = self._count + count
        if stop > self._array.size:
            self._array.resize(max(stop, self._array.size * 3 // 2), refcheck=False)
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
        if self._count != self._array.size:
            self._array.resize(self._count, refcheck=False)
        return self._array


class StampColumn:
    """A topic's stamps; those of topics that tick together are kept in memory only once."""

    def __init__(self, expected: int = 0, leader: StampColumn | None = None) -> None:
        self._leader = leader
        self._own = Growing(np.int64, expected) if leader is None else None
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
            self._own = Growing(np.int64, stop)
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
