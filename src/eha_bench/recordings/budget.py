"""What reading one recording may take of memory and time, so that no small file can hang a bench.

The defaults grow with the file: 128 MiB and 64 times its size, 3 s and 2 s a megabyte of processor
time. A recording of a rig takes a small part of that; what takes more is refused.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path

from eha_bench.core.errors import Place, RecordingError

_MEMORY = 128 << 20
_MEMORY_PER_BYTE = 64
_SECONDS = 3.0
_SECONDS_PER_BYTE = 2e-6
_LOOK_EVERY = 0.01


class OverBudget(RecordingError):
    """Reading the recording would take more than it may."""


class OutOfTime(OverBudget):
    """There is no time left for any part of it."""


@dataclass(frozen=True)
class ReadingLimits:
    """What a user allows a file, whatever its size; None for the default.

    Attributes:
        memory: bytes.
        seconds: of processor time.
    """

    memory: int | None = None
    seconds: float | None = None


_limits: ContextVar[ReadingLimits] = ContextVar("limits")
_current: ContextVar[ReadingBudget] = ContextVar("budget")


class ReadingBudget:
    """What is allowed to the reading of one recording."""

    def __init__(self, path: str, size: int, limits: ReadingLimits) -> None:
        self._where = Place(file=path)
        self.memory = limits.memory or _MEMORY + _MEMORY_PER_BYTE * size
        self.seconds = limits.seconds or _SECONDS + _SECONDS_PER_BYTE * size
        self._end = time.process_time() + self.seconds
        self._next_look = 0.0

    def hold(self, count: int, what: str) -> None:
        """Check that so many bytes may be in memory at one time.

        Raises:
            OverBudget: they may not.
        """
        if count > self.memory:
            raise OverBudget(
                f"{what} would take {_size_text(count)} of memory, more than the "
                f"{_size_text(self.memory)} that a file of this size may take",
                where=self._where,
                hint="if you trust the file, allow more with --max-memory",
            )

    def tick(self) -> None:
        """Check that there is time left; called from every loop whose length a file decides.

        Raises:
            OutOfTime: there is none.
        """
        now = time.monotonic()
        if now < self._next_look:
            return
        # asking for the processor's time may take a hundred times as long as a look at the clock
        self._next_look = now + _LOOK_EVERY
        if time.process_time() > self._end:
            raise OutOfTime(
                f"it takes more than the {self.seconds:.3g} s that a file of this size may take",
                where=self._where,
                hint="if you trust the file, allow more with --max-time",
            )


def budget() -> ReadingBudget:
    """Return the budget of the recording that is being read."""
    found = _current.get(None)
    return found if found is not None else ReadingBudget("", 0, _limits.get(ReadingLimits()))


@contextmanager
def reading_budget(memory: int | None = None, seconds: float | None = None) -> Iterator[None]:
    """Allow every recording read in this context so much instead of the default."""
    token = _limits.set(ReadingLimits(memory, seconds))
    try:
        yield
    finally:
        _limits.reset(token)


@contextmanager
def spending(path: Path) -> Iterator[ReadingBudget]:
    """Open the budget of a recording; one inside another's is part of it."""
    outer = _current.get(None)
    if outer is not None:
        yield outer
        return
    found = ReadingBudget(str(path), _size(path), _limits.get(ReadingLimits()))
    token = _current.set(found)
    try:
        yield found
    except MemoryError as error:
        raise OverBudget(
            "there is not enough memory to read it", where=Place(file=str(path))
        ) from error
    finally:
        _current.reset(token)


def _size(path: Path) -> int:
    try:
        if path.is_dir():
            return sum(inner.stat().st_size for inner in path.iterdir() if inner.is_file())
        return path.stat().st_size
    except (OSError, ValueError):
        return 0  # whoever opens it says what is wrong


def _size_text(count: int) -> str:
    return f"{count / 1e9:.3g} GB" if count >= 1e9 else f"{count / 1e6:.3g} MB"
