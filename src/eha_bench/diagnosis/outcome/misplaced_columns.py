"""Columns of a log that stand a row or two beside where the model takes them to be.

A model lets a command act from its row on, and takes a current for what flows just before. What a
drive reads back is written into the row in which it was read, and has acted since the row before;
so has a command that a logger takes after its controller. A drive that logs a command together with
the current that it has led to is the other way round. Nothing in a machine acts before it is asked
to, so where a moved column takes away most of what is missing, it is the log.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray
from eha_bench.core.per_cent import per_cent
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.fit.evidence import excess
from eha_bench.diagnosis.fit.least_squares import levenberg_marquardt
from eha_bench.diagnosis.fit.problem import cost_of
from eha_bench.diagnosis.search.state import Search

_ROWS = (1, 2)
_MOST = 0.5
"""Share of what is missing that has to go."""
_ITERATIONS = 4
_Column = TypeVar("_Column", FloatArray, BoolArray)


class MisplacedColumn(NamedTuple):
    """A column with how many rows later it belongs (below 0: earlier), and what that takes away."""

    name: str
    rows: int
    share: float

    @property
    def note(self) -> str:
        """What to do about it, in a sentence."""
        count = abs(self.rows)
        rows = "one row" if count == 1 else f"{count} rows"
        why = (
            "later {share} of what is missing is gone: it may be what the command of its own row "
            "has led to"
            if self.rows > 0
            else "earlier {share} of what is missing is gone: it may have been logged after it "
            "acted (a current that was read back, a command after its controller)"
        )
        gone = why.format(share=per_cent(min(self.share, 1.0)))
        return f"with '{self.name}' {rows} {gone}; move that column in the log"


def misplaced_column(search: Search) -> MisplacedColumn | None:
    """Return the column that is most clearly beside its place, None where none is.

    Args:
        search: finished; where nothing is missing no column is asked for.
    """
    if not search.is_unexplained:
        return None
    missing = search.excess_left.total
    tried = (
        MisplacedColumn(name, rows, 1.0 - _left(search, name, rows) / missing)
        for name, rows in _candidates(search)
    )
    found = max(tried, key=lambda item: item.share, default=None)
    return found if found is not None and found.share > _MOST else None


def _candidates(search: Search) -> Iterator[tuple[str, int]]:
    """Yield commands, which may belong earlier, and currents, which may belong later."""
    runs = [window.measured for window in search.problem.windows]
    roles = runs[0].roles
    for name in (*roles.commands, *roles.read_back):
        if all(name in item.inputs for item in runs):
            yield from ((name, -rows) for rows in _ROWS)
    yield from ((name, 1) for name in roles.acting if name in search.problem.noise)


def _left(search: Search, name: str, rows: int) -> float:
    """Return the excess that is left with a column so many rows later, in cost."""

    def moved(measured: Measured) -> Measured:
        if name in measured.inputs:
            shifted = _shifted(measured.inputs[name], rows)
            return replace(measured, inputs={**measured.inputs, name: shifted})
        if name not in measured.outputs:
            return measured
        at = measured.outputs.index(name)
        values, valid = measured.values.copy(), measured.valid.copy()
        values[:, at] = _shifted(values[:, at], rows)
        valid[:, at] = _shifted(valid[:, at], rows)
        return replace(measured, values=values, valid=valid)

    problem = search.problem.with_measured(moved)
    problem.prepare(search.fit.vector)
    if cost_of(problem, search.fit.vector) > search.fit.cost:
        # what belongs there errs less at once, before anything is fitted again
        return search.excess_left.total
    fit = levenberg_marquardt(
        problem, search.fit.vector, search.fit.free, iterations=_ITERATIONS, refresh=1
    )
    return excess(problem, fit).total


def _shifted(values: _Column, rows: int) -> _Column:
    """Return a column so many rows later, its end repeated, (n,)."""
    if rows > 0:
        return np.concatenate([np.full(rows, values[0]), values[:-rows]])
    return np.concatenate([values[-rows:], np.full(-rows, values[-1])])
