"""Points of a space: all combinations, a Latin hypercube, or a Sobol sequence, by a seed.

Latin hypercube: McKay, Beckman, Conover, Technometrics 21 (1979) 239. Sobol's sequence, scrambled:
Owen, J. Complexity 14 (1998) 466. Both are SciPy's.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import InputError, Place
from eha_bench.sweeps.space import Point, Space
from eha_bench.sweeps.sweep_file import MOST_POINTS, DesignKind, SweepFile


class Design(ABC):
    """How points are chosen."""

    @abstractmethod
    def points(self, space: Space) -> tuple[Point, ...]:
        """Return the points, each a value for every factor."""


@dataclass(frozen=True)
class Grid(Design):
    """All combinations of all levels; the last factor moves first."""

    where: Place

    def points(self, space: Space) -> tuple[Point, ...]:
        """Return every combination.

        Raises:
            InputError: there are too many.
        """
        levels = [factor.span.levels for factor in space.factors]
        count = math.prod(len(item) for item in levels)
        if count > MOST_POINTS:
            raise InputError(
                f"the grid has {count:.3g} points, more than {MOST_POINTS:.0e}",
                where=self.where,
                hint="take fewer steps, or 'design: sobol' with 'points'",
            )
        return tuple(itertools.product(*levels))


@dataclass(frozen=True)
class SpaceFilling(Design):
    """A number of points that fill the space evenly."""

    count: int
    seed: int

    def points(self, space: Space) -> tuple[Point, ...]:
        """Return the points in the order of the sequence."""
        shares = self._shares(len(space.factors))
        return tuple(
            tuple(
                factor.span.at(float(share))
                for factor, share in zip(space.factors, row, strict=True)
            )
            for row in shares
        )

    @abstractmethod
    def _shares(self, factors: int) -> FloatArray:
        """Return the points as shares of every factor's span, (count, factors)."""


class LatinHypercube(SpaceFilling):
    """Every factor in as many slices as there are points, one point in each."""

    def _shares(self, factors: int) -> FloatArray:
        from scipy.stats import qmc

        generator = np.random.default_rng(self.seed)
        return np.asarray(qmc.LatinHypercube(factors, rng=generator).random(self.count))


class Sobol(SpaceFilling):
    """The first points of a scrambled Sobol sequence: `points` may grow without others changing."""

    def _shares(self, factors: int) -> FloatArray:
        from scipy.stats import qmc

        generator = np.random.default_rng(self.seed)
        # a power of two is what the sequence is even for, and what it warns about otherwise
        power = math.ceil(math.log2(self.count))
        found = qmc.Sobol(factors, rng=generator).random_base2(power)
        return np.asarray(found[: self.count])


def design_of(file: SweepFile) -> Design:
    """Return the design that a file asks for."""
    form = file.form
    if form.design is DesignKind.GRID:
        return Grid(Place(file=str(file.path)))
    kind = LatinHypercube if form.design is DesignKind.LATIN_HYPERCUBE else Sobol
    assert form.points is not None
    return kind(form.points, form.seed)
