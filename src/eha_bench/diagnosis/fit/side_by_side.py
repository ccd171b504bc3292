"""Fits and simulations that do not depend on each other, at the same time, one a processor.

Windows are simulated by several threads anyway (`problem`), but between two simulations a fit is
Python and small matrices, and most of one processor waits. Where candidates are tried in a row,
each is therefore fitted on a thread of its own, and its windows one after the other: the same
numbers in the same order, so the results are those of one thread to the last bit.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import ContextVar, copy_context
from functools import cache
from typing import TypeVar

Item = TypeVar("Item")
Value = TypeVar("Value")

PROCESSORS = max(1, min(4, os.cpu_count() or 1))
"""How many threads work; one where several diagnoses run at once."""

_ONE_OF_SEVERAL: ContextVar[bool] = ContextVar("one_of_several", default=False)


def is_one_of_several() -> bool:
    """Whether this thread does one of several items: others keep the other processors busy."""
    return _ONE_OF_SEVERAL.get()


def side_by_side(function: Callable[[Item], Value], items: Sequence[Item]) -> list[Value]:
    """Return a function of each item, in the order of the items.

    Args:
        function: of one item; changes nothing that another call looks at.
        items: what to do.
    """
    if len(items) < 2 or PROCESSORS == 1 or is_one_of_several():
        return [function(item) for item in items]

    def alone(item: Item) -> Value:
        _ONE_OF_SEVERAL.set(True)
        return function(item)

    # a context each: who counts simulations or asks for a stop here does so there as well
    started = [_pool(PROCESSORS).submit(copy_context().run, alone, item) for item in items]
    try:
        return [future.result() for future in started]
    finally:
        for future in started:
            future.cancel()


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="fit")
