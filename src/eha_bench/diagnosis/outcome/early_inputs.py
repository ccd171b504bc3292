"""Inputs that a log holds a row or two after they acted.

What a drive reads back is written into the row in which it was read, and has acted since the row
before; so has a command that a logger takes after its controller. The model lets an input act from
its row on. Nothing in the machine acts before it is asked to, so where an input that comes earlier
takes away most of what is missing, it is the log that is late.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from eha_bench.core.per_cent import per_cent
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.fit.evidence import excess
from eha_bench.diagnosis.fit.least_squares import levenberg_marquardt
from eha_bench.diagnosis.search.state import Search

_ROWS = (1, 2)
_MOST = 0.5
"""Share of what is missing that has to go."""
_ITERATIONS = 4


class EarlyInput(NamedTuple):
    """An input, by how many rows it acts earlier than it was logged, and what that takes away."""

    name: str
    rows: int
    share: float


def early_input(search: Search) -> EarlyInput | None:
    """Return the input that acts earlier than it was logged, None where none does.

    Args:
        search: finished, with something missing that nothing explains.
    """
    found = max(_tried(search), key=lambda item: item.share, default=None)
    return found if found is not None and found.share > _MOST else None


def note_of_early_input(search: Search) -> list[str]:
    """Say which input acts earlier than it was logged: a sentence, or none."""
    found = early_input(search)
    if found is None:
        return []
    rows = "one row" if found.rows == 1 else f"{found.rows} rows"
    return [
        f"with '{found.name}' {rows} earlier {per_cent(min(found.share, 1.0))} of what is missing "
        "is gone: it may have been logged after it acted (a current that was read back, a command "
        "after its controller); shift that column, or log what was commanded"
    ]


def _tried(search: Search) -> Iterator[EarlyInput]:
    missing = search.excess_left.total
    for name in _acting(search):
        for rows in _ROWS:
            yield EarlyInput(name, rows, 1.0 - _left(search, name, rows) / max(missing, 1.0))


def _acting(search: Search) -> Iterator[str]:
    """Yield the inputs that ask something of a drive or a valve."""
    runs = [window.measured for window in search.problem.windows]
    roles = runs[0].roles
    yield from (name for name in roles.commands if all(name in item.inputs for item in runs))


def _left(search: Search, name: str, rows: int) -> float:
    """Return the excess that is left with an input so many rows earlier, in cost."""

    def earlier(measured: Measured) -> Measured:
        values = measured.inputs[name]
        moved = np.append(values[rows:], np.full(rows, values[-1]))
        return replace(measured, inputs={**measured.inputs, name: moved})

    problem = search.problem.with_measured(earlier)
    problem.prepare(search.fit.vector)
    fit = levenberg_marquardt(
        problem, search.fit.vector, search.fit.free, iterations=_ITERATIONS, refresh=1
    )
    return excess(problem, fit).total
