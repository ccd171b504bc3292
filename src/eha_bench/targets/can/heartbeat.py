"""A count in a page of memory that two processes share: one beats, the other sees whether it does.

Nothing is sent and nothing can block: neither side waits for the other, whatever holds it up.
"""

from __future__ import annotations

import mmap
import os
import tempfile
from typing import Final, Self

BEAT_EVERY: Final = 0.01
"""Seconds after which an end that has nothing to do beats again."""
_DOUBTED: Final = 0.075
"""Seconds without a beat after which it is doubted; a stall is noticed within 0.1 s."""
_GRACE: Final = 0.01
_FEWEST_LOOKS: Final = 5
"""Seconds and looks that it is given then: who looks may have been held up as well."""


class Heartbeat:
    """One end of the count.

    Attributes:
        descriptor: of the page, for the other process to inherit.
    """

    def __init__(self, descriptor: int) -> None:
        """Join the page behind a descriptor, which is this end's own from now on."""
        self.descriptor = descriptor
        self._page = mmap.mmap(descriptor, mmap.PAGESIZE)
        self._count = memoryview(self._page).cast("Q")

    @classmethod
    def make(cls) -> Self:
        """Make a page with a count of 0.

        Raises:
            OSError: there is no room for a page.
        """
        if hasattr(os, "memfd_create"):
            descriptor = os.memfd_create("eha-bench-heartbeat")
        else:  # outside Linux
            with tempfile.TemporaryFile(buffering=0) as file:
                descriptor = os.dup(file.fileno())
        os.write(descriptor, bytes(mmap.PAGESIZE))
        return cls(descriptor)

    def beat(self) -> None:
        """Count one more."""
        self._count[0] = (self._count[0] + 1) & 0xFFFFFFFF

    @property
    def count(self) -> int:
        """How often the other end has beaten."""
        return self._count[0]

    def close(self) -> None:
        """Leave the page."""
        self._count.release()
        self._page.close()
        os.close(self.descriptor)


class Silence:
    """Tells from counts that are looked at every few milliseconds when the other end has stalled.

    A stall is noticed within 0.1 s where looks are at most 3 ms apart.
    """

    def __init__(self, now: float) -> None:
        """Begin at a time in s."""
        self._count = -1
        self._beat_at = now
        self._doubts = 0
        self._doubted_at = now

    def of(self, count: int, now: float) -> float:
        """Return for how many seconds nothing was heard of an end that has stalled, else 0."""
        silent = now - self._beat_at
        if count != self._count:
            self._count, self._beat_at, self._doubts = count, now, 0
            return 0.0
        if silent <= _DOUBTED:
            return 0.0
        if not self._doubts:
            self._doubted_at = now
        self._doubts += 1
        sure = self._doubts >= _FEWEST_LOOKS and now - self._doubted_at >= _GRACE
        return silent if sure else 0.0
