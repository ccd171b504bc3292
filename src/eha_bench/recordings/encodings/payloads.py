"""Messages of one channel that lie in one buffer and have the same size: read as columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.arrays import Bytes, IndexArray

Offsets = NDArray[np.int64]


@dataclass(frozen=True)
class Payloads:
    """Equal-size messages inside one buffer.

    Attributes:
        buffer: (m,) the bytes that hold them.
        starts: (n,) where each payload starts, or None if they lie at equal distances.
        first: start of the first payload where `starts` is None.
        step: distance in bytes where `starts` is None.
        count: number of messages.
        size: bytes of each payload.
    """

    buffer: Bytes
    count: int
    size: int
    first: int = 0
    step: int = 0
    starts: Offsets | None = None

    def column(self, delta: int, code: str) -> NDArray[Any]:
        """Return the numbers of NumPy type `code`, `delta` bytes after each start, shape (n,).

        `delta` may be negative: a record's stamps stand before its payload. The result may be a
        view of the buffer. The caller makes sure that the bytes lie inside the buffer.
        """
        kind = np.dtype(code)
        if self.starts is None:
            return np.ndarray(
                (self.count,), kind, self.buffer.data, self.first + delta, (self.step,)
            )
        windows: NDArray[Any] = np.ndarray(
            (max(self.buffer.size - kind.itemsize + 1, 0),), kind, self.buffer.data, 0, (1,)
        )
        return windows[self.starts + delta]

    def start(self, row: int) -> int:
        """Return where the payload of a row starts."""
        return int(self.starts[row]) if self.starts is not None else self.first + row * self.step

    def payload(self, row: int) -> memoryview:
        """Return the bytes of one message."""
        start = self.start(row)
        return self.buffer.data[start : start + self.size]

    def rows(self, index: IndexArray) -> Payloads:
        """Return some of the messages."""
        starts = (
            self.starts[index] if self.starts is not None else self.first + index * self.step
        ).astype(np.int64)
        return Payloads(self.buffer, int(index.size), self.size, starts=starts)
