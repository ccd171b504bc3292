"""Which files a piece of work reads, so that it writes over none of them.

A dataset.yaml names a model, which names a plant, and so on: who writes results does not know all
of these names. So whatever reads a file notes it, and who loads something asks for the notes.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

_READ: ContextVar[list[Path] | None] = ContextVar("files_read", default=None)


@contextmanager
def noting_inputs() -> Iterator[list[Path]]:
    """Yield a list that every file which is read within is added to.

    Example:
        >>> with noting_inputs() as read:
        ...     note_input(Path("model.yaml"))
        >>> [path.name for path in read]
        ['model.yaml']
    """
    read: list[Path] = []
    outer = _READ.get()
    token = _READ.set(read)
    try:
        yield read
    finally:
        _READ.reset(token)
        if outer is not None:
            outer.extend(read)


def note_input(path: Path) -> None:
    """Note a file that is read, where anybody asked for it."""
    read = _READ.get()
    if read is not None:
        read.append(path)
