"""Fits and simulations that do not depend on each other, at the same time, one a processor.

Windows are simulated by several threads anyway (`problem`), but between two simulations a fit is
Python and small matrices, and most of one processor waits. Where candidates are tried in a row,
each is therefore fitted on its own thread, and its windows one after the other: the same
numbers in the same order, so the results are those of one thread to the last bit. Other processes
and machines do the same where workers were asked for.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, closing, contextmanager
from contextvars import ContextVar, copy_context
from dataclasses import dataclass
from functools import cache
from typing import Generic, TypeVar

from threadpoolctl import threadpool_limits

from eha_bench.core.interruption import checkpoint, result_at_checkpoints
from eha_bench.core.processors import usable_processors
from eha_bench.core.workers import IN_PROCESS, Workers
from eha_bench.diagnosis.fit.effort import count_simulated_time, note_simulated_time

Item = TypeVar("Item")
Value = TypeVar("Value")

PROCESSORS = min(4, usable_processors())
"""How many threads work; one where several diagnoses run at once."""

_ONE_OF_SEVERAL: ContextVar[bool] = ContextVar("one_of_several", default=False)


def is_one_of_several() -> bool:
    """Whether this thread does one of several items: others keep the other processors busy."""
    return _ONE_OF_SEVERAL.get()


def one_thread_of_algebra() -> AbstractContextManager[object]:
    """A context that keeps the linear algebra to one thread.

    Fits run side by side: more would be in their way, and sum in another order on another machine.
    """
    limits: AbstractContextManager[object] = threadpool_limits(limits=1, user_api="blas")
    return limits


class Way(ABC):
    """A way of doing many of the same; none changes a result."""

    @abstractmethod
    def each(self, function: Callable[[Item], Value], items: Sequence[Item]) -> list[Value]:
        """Return a function of each item, in the order of the items."""


class OnThreads(Way):
    """Threads of this process."""

    def each(self, function: Callable[[Item], Value], items: Sequence[Item]) -> list[Value]:
        """Return a function of each item; with one processor, one after the other."""
        if PROCESSORS == 1:
            return [function(item) for item in items]

        def alone(item: Item) -> Value:
            _ONE_OF_SEVERAL.set(True)
            return function(item)

        # a context each: who counts simulations or asks for a stop here does so there as well
        started = [_pool(PROCESSORS).submit(copy_context().run, alone, item) for item in items]
        try:
            return [result_at_checkpoints(future) for future in started]
        finally:
            for future in started:
                future.cancel()


@dataclass(frozen=True)
class ByWorkers(Way):
    """Other processes, of this machine or of a cluster."""

    workers: Workers

    def each(self, function: Callable[[Item], Value], items: Sequence[Item]) -> list[Value]:
        """Return a function of each item; what was simulated there is counted here.

        Raises:
            WorkError: an item could not be done anywhere.
        """
        found = []
        with closing(self.workers.ordered(_Elsewhere(function), items)) as outcomes:
            for outcome in outcomes:
                value, spent = outcome.get()
                for seconds in spent:
                    note_simulated_time(seconds)
                checkpoint()
                found.append(value)
        return found


@dataclass(frozen=True)
class _Elsewhere(Generic[Item, Value]):
    """A function as a worker does it: alone, and counted."""

    function: Callable[[Item], Value]

    def __call__(self, item: Item) -> tuple[Value, list[float]]:
        return copy_context().run(self._alone, item)

    def _alone(self, item: Item) -> tuple[Value, list[float]]:
        _ONE_OF_SEVERAL.set(True)
        with one_thread_of_algebra(), count_simulated_time() as spent:
            return self.function(item), spent


_ON_THREADS = OnThreads()
_WAY: ContextVar[Way] = ContextVar("way", default=_ON_THREADS)


@contextmanager
def fits_by(workers: Workers) -> Iterator[None]:
    """A context in which workers do what is independent; `IN_PROCESS` does it on threads."""
    token = _WAY.set(_ON_THREADS if workers == IN_PROCESS else ByWorkers(workers))
    try:
        yield
    finally:
        _WAY.reset(token)


def side_by_side(function: Callable[[Item], Value], items: Sequence[Item]) -> list[Value]:
    """Return a function of each item, in the order of the items.

    Args:
        function: of one item; changes nothing that another call looks at.
        items: what to do.
    """
    if len(items) < 2 or is_one_of_several():
        return [function(item) for item in items]
    return _WAY.get().each(function, items)


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="fit")
