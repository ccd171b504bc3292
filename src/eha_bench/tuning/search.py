"""Searches over gains, in shares of their ranges: one for the basins, one within them.

The first goes by what is predicted from all that was tried (`surrogate`): with few candidates,
evolution ended in the wrong basin on several machines. The second, over draws of machines, is
differential evolution.

Storn, Price, J. Global Optimization 11 (1997) 341, doi:10.1023/A:1008202821328, as SciPy has it.
All of a generation is tried at once, so that it can be spread over workers. A candidate is raced
against the one whose place it would take: it is tried on the hardest machines first, and on the
others only if it can still win. The outcome is the same as without.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.sweeps.space import Point, Space
from eha_bench.tuning.aim import Aim, least
from eha_bench.tuning.surrogate import next_places
from eha_bench.tuning.trying import GainTrials, Machine


@dataclass(frozen=True)
class TriedGains:
    """Gains that were tried.

    Attributes:
        shares: places in the ranges, (gains,). point: the gains, SI. worth: by the aim; the most
            that it can be where it lost its race. margins: (machines, limits); of fewer machines
            where it lost its race.
    """

    shares: tuple[float, ...]
    point: Point
    worth: float
    margins: FloatArray


_FIRST = 0.3
"""Share of the machines, the hardest, that a candidate is tried on first."""


@dataclass
class GainSearch:
    """One search: what is aimed at, on which machines, and everything that was tried.

    Attributes:
        trying: runs candidates. machines: that they are tried on. aim: what is made large.
        stop: whether it was asked to stop. tell: called with each generation.
    """

    trying: GainTrials
    machines: Sequence[Machine]
    aim: Aim
    stop: Callable[[], bool]
    tell: Callable[[GainSearch], None]
    tried: list[TriedGains] = field(default_factory=list)
    _standing: FloatArray | None = None

    @property
    def best(self) -> TriedGains:
        """The candidate of most worth, the first of equals."""
        return max(self.tried, key=lambda item: item.worth)

    @property
    def whole(self) -> list[TriedGains]:
        """Those that were tried on all machines."""
        return [item for item in self.tried if len(item.margins) == len(self.machines)]

    def explore(
        self,
        start: FloatArray,
        candidates: int,
        batch: int,
        seed: int,
        until: float = math.inf,
    ) -> None:
        """Try first places, (n, gains) of shares, and batches of those that promise most.

        Args:
            start: first places. candidates: how many are tried, with these. batch: at once.
            seed: of places that are looked at. until: worth of which one is enough.
        """
        if self.stop():
            return
        self._worths(start.T)
        generator = np.random.default_rng(seed)
        for done in range(len(start), candidates, batch):
            if self.stop() or self.best.worth >= until:
                return
            shares = np.array([item.shares for item in self.tried])
            margins = np.array([item.margins.min(axis=0) for item in self.tried])
            count = min(batch, candidates - done)
            self._worths(next_places(shares, margins, count, generator).T)

    def run(self, start: FloatArray, generations: int, seed: int) -> None:
        """Try a first population, (n, gains) of shares, and generations bred from it."""
        from scipy import optimize

        if self.stop():
            return
        # the stubs know neither the vectorized form nor the callback that gets all
        evolve: Any = optimize.differential_evolution
        self._standing = None
        evolve(
            self._worths,
            [(0.0, 1.0)] * start.shape[1],
            init=start,
            maxiter=generations,
            polish=False,
            vectorized=True,
            updating="deferred",
            tol=0.0,
            rng=np.random.default_rng(seed),
            callback=self._stopped,
        )

    def _stopped(self, intermediate_result: Any) -> bool:
        """Tell SciPy, which looks for the argument's name, whether to stop."""
        self._standing = -np.asarray(intermediate_result.population_energies, dtype=np.float64)
        return self.stop()

    def _worths(self, shares: FloatArray) -> FloatArray:
        """Return the cost of candidates, (n,), of (gains, n) or (gains,) shares.

        Raises:
            KeyboardInterrupt: stopped among them; those that were done are in `tried`.
        """
        columns = np.atleast_2d(shares.T)
        if self.stop():
            return np.full(len(columns), np.inf)
        points = [at(self.trying.space, column) for column in columns]
        margins = self._race(points)
        # fewer than were asked for where it was stopped among them
        for column, point, found in zip(columns, points, margins, strict=False):
            place = tuple(float(share) for share in column)
            worth = self.aim.most(found, len(self.machines))
            self.tried.append(TriedGains(place, point, worth, found))
        if len(margins) < len(points):
            raise KeyboardInterrupt
        self.tell(self)
        return np.array([-item.worth for item in self.tried[-len(columns) :]])

    def _race(self, points: Sequence[Point]) -> list[FloatArray]:
        """Return margins of candidates, each (machines, limits): of all machines if it can win."""
        first = math.ceil(_FIRST * len(self.machines))
        standing = self._standing
        if standing is None or len(standing) != len(points) or first == len(self.machines):
            return self.trying.margins(points, self.machines, self.stop)
        order = self._hardest_first()
        early = self.trying.margins(
            points, [self.machines[place] for place in order[:first]], self.stop
        )
        if len(early) < len(points):
            return []
        on = [
            place
            for place, found in enumerate(early)
            if self.aim.most(found, len(self.machines)) > standing[place]
        ]
        late = self.trying.margins(
            [points[place] for place in on],
            [self.machines[place] for place in order[first:]],
            self.stop,
        )
        if len(late) < len(on):
            return []
        found = list(early)
        for place, rest in zip(on, late, strict=True):
            found[place] = np.concatenate([early[place], rest])[np.argsort(order)]
        return found

    def _hardest_first(self) -> list[int]:
        """Return the machines' places, those first on which candidates had the least margin."""
        means = np.mean([least(item.margins) for item in self.whole], axis=0)
        return [int(place) for place in np.argsort(means, kind="stable")]


def at(space: Space, shares: Sequence[float] | FloatArray) -> Point:
    """Return the gains at shares of their ranges."""
    return tuple(
        factor.span.at(float(share)) for factor, share in zip(space.factors, shares, strict=True)
    )


def first_population(known: Sequence[FloatArray], gains: int, size: int, seed: int) -> FloatArray:
    """Return a population that fills the ranges, with known places among it, (size, gains)."""
    from scipy.stats import qmc

    filled = qmc.LatinHypercube(gains, rng=np.random.default_rng(seed)).random(size)
    for row, place in enumerate(known[:size]):
        filled[row] = place
    return np.asarray(filled)


def narrow_population(
    best: Sequence[TriedGains], size: int, spread: float, seed: int
) -> FloatArray:
    """Return the best places, and others scattered around them, (size, gains)."""
    generator = np.random.default_rng(seed)
    places = np.array([item.shares for item in best])
    chosen = places[np.arange(size) % len(places)]
    scattered = chosen + spread * generator.standard_normal(chosen.shape)
    scattered[: len(places)] = places[:size]
    return np.asarray(np.clip(scattered, 0.0, 1.0))
