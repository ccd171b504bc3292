"""Channels that go against what the model simulates of them, or with what it simulates of another.

A model as declared is wrong in sizes, seldom in directions: a channel that falls where it is
simulated to rise has the opposite sign in its log, or stands in another's column. Only what changes
within a window is compared, as each begins where its sensors say. How alike all channels are to the
model as declared orders what is suspected; whether it is a mistake is told by a calibration without
it (`corrected_map`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Final

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.correction import Correction, Exchanged, Reversed, corrected
from eha_bench.diagnosis.data.dataset import Dataset
from eha_bench.diagnosis.fit.baseline import COARSE, Baseline, gather
from eha_bench.diagnosis.fit.problem import Problem

_AGAINST: Final = -0.5
"""Correlation of measured and simulated changes below which a channel goes against its model."""
_WITH: Final = 0.5
"""The same with another channel's simulated changes, from which it may stand in its column."""
_LOUD: Final = 10.0
"""Least standard deviation of a channel that is compared, in its noise."""
_BETTER: Final = 0.1
"""Gain of the mean correlation of all channels from which a correction is worth a calibration, and
how far from the largest gain another one may be."""
_MOST: Final = 2
"""Most corrections that are worth one."""


@dataclass(frozen=True)
class Suspect:
    """A correction that may be due.

    Attributes:
        correction: of channels. right: channel maps that are right without it.
    """

    correction: Correction
    right: frozenset[Path | None] = frozenset()

    def corrects(self, dataset: Dataset) -> Dataset:
        """Return a dataset that is read with the correction."""
        return corrected(dataset, self.correction, self.right)

    def where(self, dataset: Dataset) -> str:
        """Return the names of the files in which the mistake is."""
        paths = dict.fromkeys(run.channels for run in dataset.runs)
        names = (path.name for path in paths if path is not None and path not in self.right)
        return ", ".join(names) or "the recordings"


def suspects(base: Baseline) -> list[Suspect]:
    """Return the corrections of channels that are most likely due, at most two."""
    if base.dataset.computed:
        return []  # what is computed from a channel would have to be computed anew
    alike = _alike(base.problem.at_step(COARSE), base.dataset)
    before = _mean(alike)
    gains = {item: _mean(_alike_when(item, base)) - before for item in _possible(base, alike)}
    largest = max(gains.values(), default=0.0)
    likely = [item for item in gains if gains[item] > max(_BETTER, largest - _BETTER)]
    return sorted(likely, key=lambda item: -gains[item])[:_MOST]


def _possible(base: Baseline, maps: Mapping[Path | None, _Alike]) -> Iterator[Suspect]:
    """Yield all corrections that some channel's correlation suggests."""
    against: dict[str, set[Path | None]] = {}
    right: dict[str, set[Path | None]] = {}
    for path, alike in maps.items():
        for name, value in alike.own():
            (against if value < _AGAINST else right).setdefault(name, set()).add(path)
    if against:
        kept = frozenset.intersection(*(frozenset(right.get(name, ())) for name in against))
        yield Suspect(_reversed(base, *against), kept)
        if len(against) > 1:
            for name in against:
                yield Suspect(_reversed(base, name), frozenset(right.get(name, ())))
        for name in base.dataset.inputs:
            if base.problem.plant.units.get(name) != "Pa":
                yield Suspect(_reversed(base, name))
    units = base.problem.plant.units
    pairs = (pair for alike in maps.values() for pair in alike.crossed())
    for one, two in dict.fromkeys(pairs):
        if units.get(one) == units.get(two):
            yield Suspect(Exchanged(one, two))


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


def _alike_when(suspect: Suspect, base: Baseline) -> Mapping[Path | None, _Alike]:
    """Return how alike changes are with a correction, by channel map."""
    dataset = suspect.corrects(base.dataset)
    _, windows, noise, _ = gather(dataset)
    return _alike(Problem(dataset.model.plant, windows, noise, COARSE), dataset)


def _alike(problem: Problem, dataset: Dataset) -> dict[Path | None, _Alike]:
    """Return how alike changes are that are measured, and simulated as declared, by channel map."""
    names = tuple(name for name in problem.plant.outputs if name in problem.noise)
    scale = np.array([problem.noise[name] for name in names])
    places = [problem.plant.outputs.index(name) for name in names]
    simulated = problem.corrected_outputs(problem.places.lengthened(dataset.model.vector()))
    sums: dict[Path | None, list[tuple[FloatArray, ...]]] = {}
    for window, own in zip(problem.windows, simulated, strict=True):
        measured = window.measured
        span = slice(window.first, window.last)
        columns = [measured.column(name) for name in names]
        absent = np.full(window.last - window.first, np.nan)
        read = np.stack([absent if item is None else item[span] for item in columns], axis=1)
        products = _products(read / scale, own[:, places] / scale)
        sums.setdefault(measured.run.channels, []).append(products)
    return {path: _correlated(names, items) for path, items in sums.items()}


def _products(read: FloatArray, own: FloatArray) -> tuple[FloatArray, ...]:
    """Return sums over a window: products of changes, their squares, and the numbers of samples."""
    there = np.isfinite(read + own.sum(axis=1, keepdims=True))
    count = there.sum(axis=0).astype(float)
    least = np.maximum(count, 1.0)
    change = np.where(there, read - np.where(there, read, 0.0).sum(axis=0) / least, 0.0)
    simulated, taken = np.nan_to_num(own), there.T.astype(float)
    # each measured channel has its own samples, over which the simulated ones are centred
    means = taken @ simulated / least[:, None]
    squares = taken @ simulated**2 - least[:, None] * means**2
    return change.T @ simulated, (change**2).sum(axis=0), squares, count


def _correlated(names: Sequence[str], items: Sequence[tuple[FloatArray, ...]]) -> _Alike:
    """Return how alike channels are over all windows, of those that are loud enough."""
    products, of_read, of_own, count = (np.sum(parts, axis=0) for parts in zip(*items, strict=True))
    loud = np.flatnonzero(of_read > _LOUD**2 * np.maximum(count, 1.0)).tolist()
    size = np.sqrt(of_read[:, None] * np.maximum(of_own, 0.0))
    correlations = np.divide(products, size, out=np.zeros_like(size), where=size > 0.0)
    return _Alike(tuple(names[k] for k in loud), correlations[np.ix_(loud, loud)])


def _mean(maps: Mapping[Path | None, _Alike]) -> float:
    """Return the mean correlation of channels with their own simulation."""
    own = [value for alike in maps.values() for _, value in alike.own()]
    return float(np.mean(own)) if own else 0.0


def _reversed(base: Baseline, *names: str) -> Reversed:
    """Return the reversal of channels.

    A position whose readings stay between its ends counts from the other end; where they do not,
    it is its sign.
    """
    ends = base.problem.plant.position_range(base.dataset.model.vector())
    sums = {}
    for name in names:
        low, high = ends.get(name, (0.0, 0.0))
        columns = [column for item in base.measured if (column := item.column(name)) is not None]
        inside = all(low <= np.nanmin(item) and np.nanmax(item) <= high for item in columns)
        sums[name] = low + high if inside and np.isfinite(low + high) else 0.0
    return Reversed(tuple(sums.items()))
