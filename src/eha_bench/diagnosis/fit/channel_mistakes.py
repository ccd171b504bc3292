"""Channels that go against what the model simulates of them, or with what it simulates of another.

A model as declared is wrong in sizes, seldom in directions: a channel that falls where it is
simulated to rise has the opposite sign in its log, or stands in another's column. Only what changes
within a window is compared, as each begins where its sensors say. How alike all channels are to the
model as declared orders what is suspected; whether it is a mistake is told by a calibration without
it (`corrected_map`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations, product
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import InputError
from eha_bench.diagnosis.data.beyond_ends import BEYOND, OFTEN
from eha_bench.diagnosis.data.dataset import Dataset
from eha_bench.diagnosis.data.map_correction import (
    Exchanged,
    MapCorrection,
    Reversed,
    corrected,
)
from eha_bench.diagnosis.fit.baseline import COARSE, Baseline, gather
from eha_bench.diagnosis.fit.problem import Problem

_AGAINST: Final = -0.3
"""Correlation of measured and simulated changes below which a channel goes against its model."""
_WITH: Final = 0.5
"""The same with another channel's simulated changes, from which it may stand in its column."""
_LOUD: Final = 10.0
"""Least standard deviation of a channel that is compared, in its noise."""
_BETTER: Final = 0.1
"""Gain of the mean correlation of all channels from which a correction is worth a calibration, and
how far from the largest gain another one may be."""
_MOST: Final = 3
"""Most corrections that are worth one."""
_LATE: Final = 0.5
"""Longest time that a channel may be late instead, s."""
_LAGS: Final = 50
"""Times that are tried of it."""
_AS_WELL: Final = 0.1
"""Correlation by which a later simulation may be less alike than the reversed one."""
_OVERLAP: Final = 0.3
"""Least share of the readings that still have a simulation so much earlier."""
_ABSOLUTE: Final = ("Pa", "K")
"""Units of what is never below zero."""


@dataclass(frozen=True)
class Suspect:
    """A correction that may be due.

    Attributes:
        correction: of channels. wrong: channel maps that have the mistake.
    """

    correction: MapCorrection
    wrong: frozenset[Path | None]

    def corrects(self, dataset: Dataset) -> Dataset:
        """Return a dataset that is read with the correction."""
        return corrected(dataset, self.correction, self.wrong)

    @property
    def where(self) -> str:
        """The files in which the mistake is."""
        names = sorted(path.name for path in self.wrong if path is not None)
        return ", ".join(names) or "a channel map for these recordings"


def suspects(base: Baseline) -> list[Suspect]:
    """Return the corrections of channels that are most likely due, at most three."""
    if base.dataset.computed:
        return []  # what is computed from a channel would have to be computed anew
    maps = {path: own for path, own in _alike_of(base.dataset).items() if not _computes(path)}
    before = _mean(maps)
    gains: dict[Suspect, float] = {}
    for item in dict.fromkeys(_possible(base, maps)):
        # what the gate refuses is no better reading
        with suppress(InputError):
            after = _alike_of(item.corrects(base.dataset))
            gains[item] = _mean({path: after[path] for path in maps if path in after}) - before
    largest = max(gains.values(), default=0.0)
    likely = [item for item in gains if gains[item] > max(_BETTER, largest - _BETTER)]
    return sorted(likely, key=lambda item: -gains[item])[:_MOST]


def _computes(path: Path | None) -> bool:
    """Whether a channel map computes channels from others, which would have to be anew."""
    # imported here: reading formats pulls in large libraries
    from eha_bench.recordings import load_channel_map

    if path is None:
        return False
    return any(entry.expression for entry in load_channel_map(path).channels.values())


def _possible(base: Baseline, maps: Mapping[Path | None, _Alike]) -> Iterator[Suspect]:
    """Yield all corrections that some channel's correlation suggests."""
    units, tied = base.problem.plant.units, tied_channels(base)
    against: dict[tuple[str, ...], list[Path | None]] = {}
    for path, alike in maps.items():
        if own := tuple(name for name, value in alike.own() if value < _AGAINST):
            against.setdefault(own, []).append(path)
    for names, paths in against.items():
        # no pressure and no temperature is below zero
        signed = [name for name in names if units.get(name) not in _ABSOLUTE and name not in tied]
        sets = [signed, *([name] for name in signed if len(signed) > 1)] if signed else []
        inputs = [[name] for name in base.dataset.inputs if units.get(name) not in _ABSOLUTE]
        for chosen in (*sets, *inputs):
            for reversal in _reversals(base, chosen):
                yield from _in_maps(reversal, paths, maps)
    crossed: dict[tuple[str, str], list[Path | None]] = {}
    for path, alike in maps.items():
        for one, two in alike.crossed():
            if units.get(one) == units.get(two):
                crossed.setdefault((one, two), []).append(path)
    for (one, two), paths in crossed.items():
        yield from _in_maps(Exchanged(one, two), paths, maps)


def tied_channels(base: Baseline) -> set[str]:
    """Return a rod's position and its joint's angle, where a log has the one by the other."""
    return {
        name
        for pair in base.problem.plant.rods_behind.items()
        if any(item.read(pair[0]) is not None for item in base.measured)
        for name in pair
    }


def _in_maps(
    correction: MapCorrection, wrong: Iterable[Path | None], maps: Iterable[Path | None]
) -> Iterator[Suspect]:
    """Yield a correction of the maps that show its mistake, and of all: not each may show it."""
    for own in dict.fromkeys((frozenset(wrong), frozenset(maps))):
        yield Suspect(correction, own)


@dataclass(frozen=True)
class _Alike:
    """How alike measured and simulated changes are.

    Attributes:
        names: channels that are loud enough. correlations: (measured, simulated) of them.
    """

    names: tuple[str, ...]
    correlations: FloatArray

    def own(self) -> Iterator[tuple[str, float]]:
        """Yield channels with their correlation with themselves."""
        yield from zip(self.names, np.diag(self.correlations).tolist(), strict=True)

    def crossed(self) -> Iterator[tuple[str, str]]:
        """Yield pairs of which each goes with the other's simulation, more than with its own."""
        c = self.correlations
        for i, j in combinations(range(len(self.names)), 2):
            if min(c[i, j], c[j, i]) > max(_WITH, c[i, i], c[j, j]):
                yield self.names[i], self.names[j]


def _alike_of(dataset: Dataset) -> dict[Path | None, _Alike]:
    """Return how alike changes are that are measured, and simulated as declared, by channel map."""
    _, windows, noise, _ = gather(dataset)
    problem = Problem(dataset.model.plant, windows, noise, COARSE)
    names = tuple(name for name in problem.plant.outputs if name in problem.noise)
    scale = np.array([problem.noise[name] for name in names])
    places = [problem.plant.outputs.index(name) for name in names]
    simulated = problem.corrected_outputs(problem.places.lengthened(dataset.model.vector()))
    pairs: dict[Path | None, list[_ReadAndSimulated]] = {}
    for window, own in zip(problem.windows, simulated, strict=True):
        measured = window.measured
        span = slice(window.first, window.last)
        absent = np.full(window.last - window.first, np.nan)
        columns = [measured.column(name) for name in names]
        read = np.stack([absent if item is None else item[span] for item in columns], axis=1)
        pair = _ReadAndSimulated(read / scale, own[:, places] / scale, measured.tick)
        pairs.setdefault(measured.run.channels, []).append(pair)
    return {path: _correlated(names, items) for path, items in pairs.items()}


class _ReadAndSimulated(NamedTuple):
    """Readings of a window and their simulation, (ticks, channels) in noise, and its tick, s."""

    read: FloatArray
    simulated: FloatArray
    tick: float

    def later(self, lag: float) -> _ReadAndSimulated:
        """Return the same with the simulation later by a time, s, where both are there."""
        rows = min(round(lag / self.tick), len(self.read))
        earlier = self.simulated[: len(self.simulated) - rows]
        return _ReadAndSimulated(self.read[rows:], earlier, self.tick)

    def products(self) -> tuple[FloatArray, ...]:
        """Return sums: products of changes, squares of both, and numbers of samples."""
        return _products(self.read, self.simulated)


def _products(read: FloatArray, own: FloatArray) -> tuple[FloatArray, ...]:
    there = np.isfinite(read) & np.isfinite(own.sum(axis=1, keepdims=True))
    count = there.sum(axis=0).astype(float)
    least = np.maximum(count, 1.0)
    change = np.where(there, read - np.where(there, read, 0.0).sum(axis=0) / least, 0.0)
    simulated = np.where(np.isfinite(own), own, 0.0)
    taken = there.T.astype(float)
    # each measured channel has its own samples, over which the simulated ones are centred
    means = taken @ simulated / least[:, None]
    squares = taken @ simulated**2 - least[:, None] * means**2
    return change.T @ simulated, (change**2).sum(axis=0), squares, count


def _correlated(names: Sequence[str], pairs: Sequence[_ReadAndSimulated]) -> _Alike:
    """Return how alike channels are over all windows, of those that are loud enough.

    What is against its simulation, and as much with a later one, may be late: it goes against
    nothing.
    """
    at_once, of_read, count = _correlations(pairs)
    loud = np.flatnonzero(of_read > _LOUD**2 * np.maximum(count, 1.0)).tolist()
    own = np.diag(at_once).copy()
    if loud and own[loud].min() < _AGAINST:
        tick = max(pair.tick for pair in pairs)
        for lag in np.arange(tick, _LATE, max(tick, _LATE / _LAGS)):
            later, _, left = _correlations([pair.later(lag) for pair in pairs])
            if left.sum() < _OVERLAP * count.sum():
                break
            as_well = np.diag(later) > np.maximum(_WITH, -own - _AS_WELL)
            own = np.where(as_well, np.maximum(own, 0.0), own)
    np.fill_diagonal(at_once, own)
    return _Alike(tuple(names[k] for k in loud), at_once[np.ix_(loud, loud)])


def _correlations(pairs: Sequence[_ReadAndSimulated]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return correlations (measured, simulated), squares of measured changes, and their number."""
    found = zip(*(pair.products() for pair in pairs), strict=True)
    products, of_read, of_own, count = (np.sum(parts, axis=0) for parts in found)
    size = np.sqrt(of_read[:, None] * np.maximum(of_own, 0.0))
    return np.divide(products, size, out=np.zeros_like(size), where=size > 0.0), of_read, count


def _mean(maps: Mapping[Path | None, _Alike]) -> float:
    """Return the mean correlation of channels with their own simulation."""
    own = [value for alike in maps.values() for _, value in alike.own()]
    return float(np.mean(own)) if own else 0.0


def _reversals(base: Baseline, names: Sequence[str]) -> Iterator[Reversed]:
    """Yield the reversals of channels that are possible.

    A position whose readings stay between its ends may count from the other end, and by its sign
    alone where they would stay there too.
    """
    ends = base.problem.plant.position_range(base.dataset.model.vector())
    possible: list[tuple[float, ...]] = []
    for name in names:
        low, high = ends.get(name, (-np.inf, np.inf))
        columns = [column for item in base.measured if (column := item.column(name)) is not None]
        if not columns or not np.isfinite(high - low):
            possible.append((0.0,))
            continue
        read = np.concatenate(columns)
        totals = dict.fromkeys((0.0, low + high))
        found = tuple(t for t in totals if _share_within(t - read, low, high) > 1.0 - OFTEN)
        possible.append(found or (0.0,))
    for sums in product(*possible):
        yield Reversed(tuple(zip(names, sums, strict=True)))


def _share_within(values: FloatArray, low: float, high: float) -> float:
    """Return the share of finite values between two ends, and a little beyond them."""
    finite = values[np.isfinite(values)]
    room = BEYOND * (high - low)
    return float(np.mean((finite > low - room) & (finite < high + room))) if finite.size else 0.0
