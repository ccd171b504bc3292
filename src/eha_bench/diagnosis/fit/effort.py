"""How much time was simulated while something was looked for."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_SIMULATED: ContextVar[list[float] | None] = ContextVar("simulated", default=None)


@contextmanager
def count_simulated_time() -> Iterator[list[float]]:
    """A context in which all simulated times are noted in the list that it gives, s."""
    spent: list[float] = []
    token = _SIMULATED.set(spent)
    try:
        yield spent
    finally:
        _SIMULATED.reset(token)


def note_simulated_time(seconds: float) -> None:
    """Note a simulated time, s; outside of `count_simulated_time` it is dropped."""
    spent = _SIMULATED.get()
    if spent is not None:
        spent.append(seconds)
