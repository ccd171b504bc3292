"""Ctrl-C as a request: the run stops at its next tick, and nothing is torn out of the middle.

A KeyboardInterrupt can be raised anywhere, also inside a finalizer, where Python only reports it
and goes on. While a suite runs, the first SIGINT (or SIGTERM, as a nightly job sends it) is
therefore only noted; a second one interrupts at once.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any, Self

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interruption:
    """A context in which a first SIGINT or SIGTERM is noted instead of raised.

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
