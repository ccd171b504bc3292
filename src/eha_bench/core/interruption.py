"""Ctrl-C as a request: work stops at its next checkpoint, and nothing is torn out of the middle.

A KeyboardInterrupt can be raised anywhere, also inside a finalizer, where Python only reports it
and goes on. While a suite runs or a model is fitted, the first SIGINT (or SIGTERM, as a nightly job
sends it, or SIGHUP, as a terminal sends it that is closed) is therefore only noted; a second one
interrupts at once. Whoever started the command with `nohup` keeps SIGHUP ignored.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from types import FrameType, TracebackType
from typing import Any, Self

_SIGNALS = (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else []))


_ASKED_FOR = (signal.SIGINT, signal.SIGTERM)
"""Signals that are noted even where whoever started the command had them ignored."""


class Interruption:
    """A context in which a first SIGINT, SIGTERM or SIGHUP is noted instead of raised.

    Outside of the main thread signals cannot be caught, and it does nothing.
    """

    def __init__(self) -> None:
        self._requested = False
        self._before: dict[int, Callable[[int, FrameType | None], Any] | int | None] = {}

    def __call__(self) -> bool:
        """Whether a stop was asked for."""
        return self._requested

    def __enter__(self) -> Self:
        """Start noting signals."""
        if threading.current_thread() is threading.main_thread():
            for number in _SIGNALS:
                if number not in _ASKED_FOR and signal.getsignal(number) is signal.SIG_IGN:
                    continue
                self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Give the signals back."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        if self._requested:
            raise KeyboardInterrupt
        self._requested = True


def _never() -> bool:
    return False


_asked: ContextVar[Callable[[], bool]] = ContextVar("asked", default=_never)


@contextmanager
def checkpoints(asked: Callable[[], bool]) -> Iterator[None]:
    """A context in which `checkpoint` interrupts as soon as a stop is asked for."""
    token = _asked.set(asked)
    try:
        yield
    finally:
        _asked.reset(token)


def checkpoint() -> None:
    """Stop here if that was asked for: long work calls it where it can be left.

    Raises:
        KeyboardInterrupt: within `checkpoints`, after a stop was asked for.
    """
    if _asked.get()():
        raise KeyboardInterrupt
