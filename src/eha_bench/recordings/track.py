"""The samples of one topic or table in file order, before they meet a common clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

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
    """Arrays that grow together; memory is taken as it is needed and given back at the end."""

    def __init__(self, columns: int, expected: int = 0) -> None:
        self._count = 0
        self._stamps = np.empty(max(expected, 256), dtype=np.int64)
        self._columns = [np.empty(self._stamps.size) for _ in range(columns)]

    def extend(self, count: int) -> tuple[Stamps, list[Column]]:
        """Return the next `count` places of the stamps and of every column, to be written."""
        stop = self._count + count
        if stop > self._stamps.size:
            size = max(stop, self._stamps.size * 3 // 2)
            for array in (self._stamps, *self._columns):
                array.resize(size, refcheck=False)
        place = slice(self._count, stop)
        self._count = stop
        return self._stamps[place], [column[place] for column in self._columns]

    def finish(self) -> tuple[Stamps, list[Column]]:
        """Return the arrays at their final length."""
        for array in (self._stamps, *self._columns):
            array.resize(self._count, refcheck=False)
        return self._stamps, self._columns
