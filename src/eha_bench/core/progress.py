"""How long work says what it is doing, without knowing who listens."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

ProgressHook = Callable[[str, float], None]
"""A function that is called with the present stage, in words, and the share done, 0 to 1."""


class Progress(Protocol):
    """Called at the start of every piece of work that comes in a known number of pieces."""

    def __call__(self, done: int, total: int, what: str) -> None:
        """Say that `done` of `total` pieces are done and `what` is next."""


def silent(done: int, total: int, what: str) -> None:
    """Progress without a listener."""
