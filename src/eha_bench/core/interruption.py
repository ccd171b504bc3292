"""Ctrl-C as a request: work stops at its next checkpoint, and nothing is torn out of the middle.

A KeyboardInterrupt can be raised anywhere, also inside a finalizer, where Python only reports it
and goes on. While a suite runs or a model is fitted, the first SIGINT (or SIGTERM, as a nightly job
sends it, or SIGHUP, as a terminal sends it that is closed) is therefore only noted; a second one
interrupts at once. Whoever started the command with `nohup` keeps SIGHUP ignored.

A signal is not lost by being noted: a program that calls one long function after the other is
meant as a whole. What the Python face offers therefore raises it again when what was found is
written (`signals_raised_after`); the commands, which end by themselves, do not
(`signals_noted_only`).
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from contextlib import contextmanager
from contextvars import ContextVar
from types import FrameType, TracebackType
from typing import Any, Self, TypeVar

from eha_bench.core.progress import REPEATED_AFTER, still_at_work

Value = TypeVar("Value")

_SIGNALS = (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else []))


_ASKED_FOR = (signal.SIGINT, signal.SIGTERM)
"""Signals that are noted even where whoever started the command had them ignored."""


class Interruption:
    """A context in which a first SIGINT, SIGTERM or SIGHUP is noted instead of raised.

    Outside of the main thread signals cannot be caught, and it does nothing.
    """

    def __init__(self) -> None:
        self._noted: int | None = None
        self._before: dict[int, Callable[[int, FrameType | None], Any] | int | None] = {}

    def __call__(self) -> bool:
        """Whether a stop was asked for."""
        return self._noted is not None

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
        """Give the signals back, and say which one was noted."""
        for number, handler in self._before.items():
            signal.signal(number, handler)
        heard = _heard.get()
        if self._noted is not None and heard is not None:
            heard.append(self._noted)

    def _note(self, number: int, frame: FrameType | None) -> None:
        del frame
        if self._noted is not None:
            raise KeyboardInterrupt
        self._noted = number


_heard: ContextVar[list[int] | None] = ContextVar("heard", default=None)
"""Signals that were noted within the innermost `signals_raised_after` or `signals_noted_only`."""


@contextmanager
def signals_raised_after(*, kept: bool = True) -> Iterator[None]:
    """A context at whose end a signal that was noted within is raised again.

    Within another one that is left to the outer; also usable as a decorator.

    Args:
        kept: whether what was found is on disk then. Where it is only returned, Ctrl-C does not
            take it away again.

    Raises:
        KeyboardInterrupt: the signal is ignored outside, or that is what its handler does.
    """
    outer = _heard.get()
    with _hearing() as heard:
        try:
            yield
        finally:
            if outer is not None:
                outer.extend(heard)
            elif heard and (kept or heard[0] != signal.SIGINT):
                _raise_again(heard[0])


def _raise_again(number: int) -> None:
    if signal.getsignal(number) is signal.SIG_IGN:  # it was noted all the same
        raise KeyboardInterrupt
    signal.raise_signal(number)


@contextmanager
def signals_noted_only() -> Iterator[None]:
    """A context in which no signal is raised again: the caller looks at what it gets, and ends."""
    with _hearing():
        yield


@contextmanager
def _hearing() -> Iterator[list[int]]:
    heard: list[int] = []
    token = _heard.set(heard)
    try:
        yield heard
    finally:
        _heard.reset(token)


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

    A listener hears there that work goes on (`still_at_work`).

    Raises:
        KeyboardInterrupt: within `checkpoints`, after a stop was asked for.
    """
    if _asked.get()():
        raise KeyboardInterrupt
    still_at_work()


def result_at_checkpoints(future: Future[Value]) -> Value:
    """Return a future's result; until it is there, and with it, this thread is at a checkpoint.

    Raises:
        KeyboardInterrupt: as `checkpoint` does.
    """
    while True:
        done = wait([future], timeout=REPEATED_AFTER).done
        checkpoint()
        if done:
            return future.result()
