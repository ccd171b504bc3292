"""How long work says what it is doing, without knowing who listens."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final, Protocol

ProgressHook = Callable[[str, float], None]
"""A function that is called with the present stage, in words, and the share done, 0 to 1."""


class Progress(Protocol):
    """Called at the start of every piece of work that comes in a known number of pieces."""

    def __call__(self, done: int, total: int, what: str) -> None:
        """Say that `done` of `total` pieces are done and `what` is next."""


def silent(done: int, total: int, what: str) -> None:
    """Progress without a listener."""


REPEATED_AFTER: Final = 1.0
"""Seconds without a call after which the last one is repeated."""


class LiveProgress:
    """A `ProgressHook` whose last call is repeated as long as work goes on in the same stage.

    Args:
        hook: called by the thread that this was made in, and by no other.
    """

    def __init__(self, hook: ProgressHook) -> None:
        self._hook, self._thread = hook, threading.get_ident()
        self._latest: tuple[str, float] | None = None
        self._at = time.monotonic()

    def __call__(self, stage: str, fraction: float) -> None:
        """Say what is done now."""
        self._latest, self._at = (stage, fraction), time.monotonic()
        self._hook(stage, fraction)

    def repeat_if_due(self) -> None:
        """Say it again if that was last done more than `REPEATED_AFTER` ago."""
        due = time.monotonic() - self._at > REPEATED_AFTER
        if due and self._latest is not None and threading.get_ident() == self._thread:
            self(*self._latest)


_live: ContextVar[LiveProgress | None] = ContextVar("live", default=None)


@contextmanager
def live_progress(hook: ProgressHook) -> Iterator[LiveProgress]:
    """A context in which `still_at_work` repeats the hook's last call every second."""
    live = LiveProgress(hook)
    token = _live.set(live)
    try:
        yield live
    finally:
        _live.reset(token)


def still_at_work() -> None:
    """Show a listener that work goes on, however long the present stage takes."""
    live = _live.get()
    if live is not None:
        live.repeat_if_due()
