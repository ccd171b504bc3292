"""How a long job tells what it is doing, without knowing who listens."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Called at the start of every piece of work."""

    def __call__(self, done: int, total: int, what: str) -> None:
        """Say that `done` of `total` pieces are done and `what` is next."""


def silent(done: int, total: int, what: str) -> None:
    """Progress without a listener."""
