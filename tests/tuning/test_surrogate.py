"""The search for the basin: it finds a small one beside a large one, and goes to its bottom."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import pytest

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import Place
from eha_bench.sweeps.factor import Gain
from eha_bench.sweeps.space import Point, Space
from eha_bench.sweeps.span import Range
from eha_bench.tuning.aim import Worst
from eha_bench.tuning.search import GainSearch, first_population
from eha_bench.tuning.surrogate import next_places
from eha_bench.tuning.trying import GainTrials, Machine

SMALL = np.array([0.9, 0.85, 0.3])


@dataclass
class Landscape(ABC):
    """Stands for `GainTrials`: the margins of two limits, by gains from 0 to 1."""

    space: Space

    @abstractmethod
    def of(self, x: FloatArray) -> tuple[float, float]:
        """Return the margins at three gains."""

    def margins(
        self,
        points: Sequence[Point],
        machines: Sequence[Machine],
        stop: Callable[[], bool] = lambda: False,
    ) -> list[FloatArray]:
        gains = [np.array([float(value) for value in point]) for point in points]
        return [np.array([self.of(x)] * len(machines)) for x in gains]


class Basins(Landscape):
    """A wide basin that just fails, and a narrow one that passes.

    Beyond a ridge the first limit is not scored, as of a step that does not settle.
    """

    def of(self, x: FloatArray) -> tuple[float, float]:
        wide = -0.03 - 0.5 * float(np.sum((x - 0.3) ** 2))
        narrow = 0.1 - 1.5 * float(np.sum((x - SMALL) ** 2))
        first = max(wide, narrow) if x[0] + x[1] - x[2] < 1.7 else float("nan")
        return first, 0.5 - x[2] / 2.0


class Corner(Landscape):
    """A limit that only two gains at their ends and a third one keep."""

    def of(self, x: FloatArray) -> tuple[float, float]:
        return 0.002 - 0.3 * (1.0 - x[0]) - 0.3 * x[1] - 2.0 * (x[2] - 0.43) ** 2, 1.0


def search(kind: type[Landscape] = Basins) -> GainSearch:
    gains = tuple(
        Gain(name, Range(0.0, 1.0, 5, False), "", Place(file="vary.yaml"))
        for name in ("a.x", "a.y", "a.z")
    )
    trying = kind(Space(cast("object", None), gains))
    machine = Machine(-1, cast("object", None))
    return GainSearch(cast("GainTrials", trying), [machine], Worst(), lambda: False, lambda _: None)


@pytest.mark.parametrize("seed", range(5))
def test_a_narrow_basin_is_found_beside_a_wide_one(seed: int) -> None:
    found = search()
    found.explore(first_population([], 3, 45, seed), 112, 12, seed)
    assert len(found.tried) == 112
    assert found.best.worth > 0.08


@pytest.mark.parametrize("seed", range(5))
def test_gains_at_the_ends_of_their_ranges_are_tried(seed: int) -> None:
    """Places between the ends come near them, and a limit that leaves little room asks for them."""
    found = search(Corner)
    found.explore(first_population([], 3, 20, seed), 80, 12, seed, until=0.0)
    assert found.best.shares[:2] == (1.0, 0.0)
    assert found.best.worth >= 0.0
    # and no more is tried than that takes
    assert len(found.tried) < 80


def test_the_same_seed_tries_the_same_places() -> None:
    one, two = search(), search()
    for item in (one, two):
        item.explore(first_population([], 3, 20, 1), 44, 12, 1)
    assert [item.shares for item in one.tried] == [item.shares for item in two.tried]


def test_no_place_is_tried_twice_also_where_nothing_is_scored() -> None:
    generator = np.random.default_rng(2)
    shares = generator.random((12, 2))
    found = next_places(shares, np.full((12, 2), np.nan), 6, generator)
    assert len(np.unique(np.vstack([shares, found]), axis=0)) == 18
    assert found.min() >= 0.0
    assert found.max() <= 1.0
