"""What simulations leave of the readings of many windows, by one call of compiled code.

r = W (measured - simulated) / noise, with W the filter of noise that remembers (`whitening`), and
C^(-1/2) of it (`prepared`): a fit asks for both of hundreds of short windows, thousands of times,
and window by window the interpreter takes longer than the equations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray
from eha_bench.diagnosis.fit.prepared import Prepared
from eha_bench.plants.compiled import njit

_BAD = 1e9
"""Largest weighted residual: a simulation that runs away counts as this much."""
_LONG = 2e-3
"""Time from tick to tick, s, over which a simulation is no longer straight."""


class _Simulations(NamedTuple):
    """Simulations, one behind the other.

    Attributes:
        values: as the sensors read. begins: (n + 1,) where each begins there.
        which: (n,) window of each. ends: (n + 1,) where the residual of each begins.
    """

    values: FloatArray
    begins: IndexArray
    which: IndexArray
    ends: IndexArray


class _BetweenTicks(NamedTuple):
    """What was read between ticks (`instants`), window by window.

    Attributes:
        edges: (windows + 1,) where those of each window begin. rows: within it.
        columns, stamps, clocks: of each reading. tick_edges: where each window's ticks begin.
        ticks: s. firsts: (windows,) tick at which a window begins.
    """

    edges: IndexArray
    rows: IndexArray
    columns: IndexArray
    stamps: FloatArray
    clocks: IndexArray
    tick_edges: IndexArray
    ticks: FloatArray
    firsts: IndexArray


class _Filters(NamedTuple):
    """Filters of noise that remembers, as a sparse matrix keeps its rows.

    Attributes:
        remembers: (windows,) whether a window's does. edges: where the row of each reading begins.
        neighbours: columns, counted within a window. factors: what they are taken times.
    """

    remembers: BoolArray
    edges: IndexArray
    neighbours: IndexArray
    factors: FloatArray


class WindowReadings:
    """The readings of some windows, one window behind the other.

    Args:
        parts: the windows. width: how many outputs the plant has.
    """

    def __init__(self, parts: Sequence[Prepared], width: int) -> None:
        self._width = width
        self._rows = _edges([part.pick.size for part in parts])
        self._places = _joined([part.places for part in parts], np.intp)
        self._target = _joined([part.target for part in parts], np.float64)
        self._scale = _joined([part.scale for part in parts], np.float64)
        self._instants = [part.instants for part in parts]
        self._runs = [part.window.measured.run.name for part in parts]
        self._between = self._between_ticks()
        self._filters = _filters_of(parts)

    def left(
        self,
        simulated: Sequence[FloatArray],
        which: IndexArray,
        lateness: Mapping[str, Mapping[str, float]],
    ) -> FloatArray:
        """Return the weighted residuals of some simulations, one behind the other, (N,).

        Args:
            simulated: (ticks, outputs) of each, as the sensors read. which: (n,) window of each.
            lateness: run -> clock -> s that its stamps are late by.
        """
        ends = _edges(np.diff(self._rows)[which])
        left = np.empty(int(ends[-1]))
        values = np.concatenate([item.ravel() for item in simulated])
        simulations = _Simulations(values, _edges([item.size for item in simulated]), which, ends)
        _left_of_each(
            tuple(simulations), self._width, self._rows, self._places, self._target, self._scale,
            tuple(self._between), self._late(lateness), tuple(self._filters), left,
        )  # fmt: skip
        return left

    def each(self, left: FloatArray, which: IndexArray) -> list[FloatArray]:
        """Return the residual of each simulation, of all as `left` returns them."""
        return np.split(left, _edges(np.diff(self._rows)[which])[1:-1])

    def _late(self, lateness: Mapping[str, Mapping[str, float]]) -> FloatArray:
        """Return how late each window's clocks are, s, (windows, clocks)."""
        names = [() if item is None else item.names for item in self._instants]
        late = np.zeros((len(names), max(map(len, names), default=0)))
        for row, (run, own) in enumerate(zip(self._runs, names, strict=True)):
            for place, name in enumerate(own):
                late[row, place] = lateness[run].get(name, 0.0)
        return late

    def _between_ticks(self) -> _BetweenTicks:
        there = [item for item in self._instants if item is not None]
        return _BetweenTicks(
            _edges([0 if item is None else item.rows.size for item in self._instants]),
            _joined([item.rows for item in there], np.intp),
            _joined([item.columns for item in there], np.intp),
            _joined([item.stamps for item in there], np.float64),
            _joined([item.clocks for item in there], np.intp),
            _edges([0 if item is None else item.ticks.size for item in self._instants]),
            _joined([item.ticks for item in there], np.float64),
            np.array([0 if item is None else item.first for item in self._instants], dtype=np.intp),
        )


def _filters_of(parts: Sequence[Prepared]) -> _Filters:
    own = [part.whitening for part in parts if part.whitening is not None]
    sizes = [
        np.zeros(part.pick.size) if part.whitening is None else np.diff(part.whitening.indptr)
        for part in parts
    ]
    return _Filters(
        np.array([part.whitening is not None for part in parts], dtype=np.bool_),
        _edges(np.concatenate(sizes)),
        _joined([item.indices for item in own], np.intp),
        _joined([item.data for item in own], np.float64),
    )


class StartBases:
    """What starts, inputs' noise and wandering zeros do to some windows, one behind the other.

    Args:
        parts: the windows, prepared.
    """

    def __init__(self, parts: Sequence[Prepared]) -> None:
        self._of = [(part.basis, part.offset) for part in parts]
        self._rows = _edges([part.pick.size for part in parts])
        self._sizes = _edges([part.shrink.size for part in parts])
        self._begins = _edges([part.basis.size for part in parts])
        self._shrink = _joined([part.shrink for part in parts], np.float64)
        self._basis = _joined([part.basis.T.ravel() for part in parts], np.float64)
        zeros = [(k, zero) for k, part in enumerate(parts) for zero in part.zeros]
        self._zeros = (
            _edges([zero.rows.size for _, zero in zeros]),
            _joined([self._rows[k] + zero.rows for k, zero in zeros], np.intp),
            _edges([zero.shrink.size for _, zero in zeros]),
            _edges([zero.basis.size for _, zero in zeros]),
            _joined([zero.basis.T.ravel() for _, zero in zeros], np.float64),
            _joined([zero.shrink for _, zero in zeros], np.float64),
        )
        moved = [(k, part.offset) for k, part in enumerate(parts) if part.offset is not None]
        self._moved = [(slice(self._rows[k], self._rows[k + 1]), offset) for k, offset in moved]
        self._weights = [
            (slice(self._rows[k], self._rows[k + 1]), part.weights)
            for k, part in enumerate(parts)
            if part.weights is not None
        ]

    def are_of(self, parts: Sequence[Prepared]) -> bool:
        """Whether these windows have not been prepared again."""
        return all(
            part.basis is basis and part.offset is offset
            for part, (basis, offset) in zip(parts, self._of, strict=True)
        )

    def white(self, residual: FloatArray) -> FloatArray:
        """Return what is white of the windows' residual, from their measured starts, (N,)."""
        out = residual.copy()
        for rows, offset in self._moved:
            out[rows] -= offset
        for rows, weights in self._weights:
            out[rows] *= weights
        _take_zeros(*self._zeros, out)
        _whiten_each(self._rows, self._sizes, self._begins, self._basis, self._shrink, out)
        return out


def _edges(sizes: Any) -> IndexArray:
    return np.concatenate(([0], np.cumsum(sizes))).astype(np.intp)


def _joined(items: Sequence[Any], kind: Any) -> Any:
    return np.concatenate([np.zeros(0, kind), *items]).astype(kind, copy=False)


# Plain tuples: compiled code that is kept on disk names no class of this file.
@njit(cache=True, nogil=True)
def _left_of_each(
    simulations: tuple[Any, ...],
    width: int,
    rows: IndexArray,
    places: IndexArray,
    target: FloatArray,
    scale: FloatArray,
    between: tuple[Any, ...],
    late: FloatArray,
    filters: tuple[Any, ...],
    left: FloatArray,
) -> None:
    """Write the weighted residuals of simulations to `left`.

    Args:
        simulations: `_Simulations`. width: how many outputs a tick has.
        rows: (windows + 1,) where each window's readings begin. places: in a simulation.
        target, scale: of readings. between: `_BetweenTicks`. late: (windows, clocks) s.
        filters: `_Filters`. left: (N,) written.
    """
    values, begins, which, ends = simulations
    edges, between_rows, columns, stamps, clocks, tick_edges, ticks, firsts = between
    remembers, filter_edges, neighbours, factors = filters
    own = np.empty(np.max(np.diff(ends)))
    for n in range(which.size):
        w, begin = which[n], begins[n]
        first, count = rows[w], rows[w + 1] - rows[w]
        for r in range(count):
            own[r] = values[begin + places[first + r]]
        here, there = tick_edges[w], tick_edges[w + 1]
        for k in range(edges[w], edges[w + 1]):
            instant = stamps[k] - late[w, clocks[k]]
            after = np.searchsorted(ticks[here:there], instant)
            after = min(max(after, firsts[w] + 1), max(there - here - 1, 1))
            earlier = ticks[here + after - 1]
            share = (instant - earlier) / (ticks[here + after] - earlier)
            at = begin + (after - 1) * width + columns[k]
            own[between_rows[k]] = values[at] + share * (values[at + width] - values[at])
            long = ticks[here + after] - earlier
            if long > _LONG and here + after + 1 < there and 0.0 <= share <= 1.0:
                # of slow ticks a simulation bends from one to the next: a parabola through three
                next_ = ticks[here + after + 1] - ticks[here + after]
                bend = (values[at + 2 * width] - values[at + width]) / next_
                bend = (bend - (values[at + width] - values[at]) / long) / (long + next_)
                own[between_rows[k]] += bend * (instant - earlier) * (instant - ticks[here + after])
        for r in range(count):
            difference = target[first + r] - own[r] / scale[first + r]
            if not abs(difference) <= _BAD:
                difference = -_BAD if difference < 0.0 else _BAD
            own[r] = difference
        out = left[ends[n] : ends[n + 1]]
        if remembers[w]:
            for r in range(count):
                out[r] = 0.0
                for k in range(filter_edges[first + r], filter_edges[first + r + 1]):
                    out[r] += factors[k] * own[neighbours[k]]
        else:
            out[:] = own[:count]


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _whiten_each(
    rows: IndexArray,
    sizes: IndexArray,
    begins: IndexArray,
    basis: FloatArray,
    shrink: FloatArray,
    out: FloatArray,
) -> None:
    """Take U (s U' r) from the residual r of every window.

    Args:
        rows: (windows + 1,) where each window's residual begins. sizes: where its `shrink` does.
        begins: where its U does. basis: U of all, column by column. shrink: s of all.
        out: (N,) changed.
    """
    for w in range(rows.size - 1):
        _take(
            basis[begins[w] : begins[w + 1]],
            shrink[sizes[w] : sizes[w + 1]],
            out[rows[w] : rows[w + 1]],
        )


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _take_zeros(
    edges: IndexArray,
    rows: IndexArray,
    sizes: IndexArray,
    begins: IndexArray,
    basis: FloatArray,
    shrink: FloatArray,
    out: FloatArray,
) -> None:
    """Take what sensors' zeros do from the residual of their own readings.

    Args:
        edges: (zeros + 1,) where each one's `rows` begin. rows: places in `out`.
        sizes: where its `shrink` begins. begins: where its basis does. basis: column by column.
        shrink: of all. out: (N,) changed.
    """
    for z in range(edges.size - 1):
        places = rows[edges[z] : edges[z + 1]]
        own = out[places]
        _take(basis[begins[z] : begins[z + 1]], shrink[sizes[z] : sizes[z + 1]], own)
        out[places] = own


@njit(fastmath={"reassoc", "contract"})
def _take(basis: FloatArray, shrink: FloatArray, residual: FloatArray) -> None:
    """Take U (s U' r) from a residual r.

    Args:
        basis: U, column by column. shrink: (k,) s. residual: (n,) changed.
    """
    count = residual.size
    shares = np.empty(shrink.size)
    for j in range(shrink.size):
        column = basis[j * count : (j + 1) * count]
        along = 0.0
        for r in range(count):
            along += column[r] * residual[r]
        shares[j] = along * shrink[j]
    for j in range(shrink.size):
        column = basis[j * count : (j + 1) * count]
        for r in range(count):
            residual[r] -= shares[j] * column[r]
