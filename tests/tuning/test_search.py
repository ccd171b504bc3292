"""The race of a search: fewer simulations, and the same gains."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import cast

import numpy as np
import pytest

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import Place
from eha_bench.sweeps.factor import Gain
from eha_bench.sweeps.space import Point, Space
from eha_bench.sweeps.span import Range
from eha_bench.tuning import search as room
from eha_bench.tuning.aim import Aim, PassProbability, Tail, Worst
from eha_bench.tuning.search import GainSearch, first_population
from eha_bench.tuning.trying import GainTrials, Machine


@dataclass
class Curves:
    """Stands for `GainTrials`: two limits that are smooth in two gains, other on each machine."""

    space: Space
    count: int = 0
    asked: list[tuple[Point, int]] = field(default_factory=list)

    def margins(
        self,
        points: Sequence[Point],
        machines: Sequence[Machine],
        stop: Callable[[], bool] = lambda: False,
    ) -> list[FloatArray]:
        self.count += len(points) * len(machines)
        found = []
        for point in points:
            x, y = (float(value) for value in point)
            rows = [
                (0.5 - abs(x - 3.0 - 0.1 * m.number), 0.6 - 0.5 * (y - 1.0 + 0.05 * m.number) ** 2)
                for m in machines
            ]
            found.append(np.array(rows))
            if stop():
                break
        return found


def test_a_stop_in_the_midst_of_a_generation_keeps_what_was_tried() -> None:
    search, _ = searched(Worst())
    search._standing = None  # a first population, which does not race
    before = len(search.tried)
    asked = iter(range(100))
    search.stop = lambda: next(asked) >= 4  # the fifth time
    with pytest.raises(KeyboardInterrupt):
        search.explore(first_population([], 2, 8, 4), 8, 8, 4)
    # asked twice before the generation, and once after each of its candidates
    assert len(search.tried) == before + 3


def searched(aim: Aim) -> tuple[GainSearch, Curves]:
    gains = tuple(
        Gain(name, Range(0.0, 6.0, 5, False), "", Place(file="vary.yaml"))
        for name in ("a.x", "a.y")
    )
    curves = Curves(Space(cast("object", None), gains))
    machines = [Machine(number, cast("object", None)) for number in range(8)]
    search = GainSearch(cast("GainTrials", curves), machines, aim, lambda: False, lambda _: None)
    search.run(first_population([], 2, 8, 3), 12, 3)
    return search, curves


@pytest.mark.parametrize("aim", [PassProbability(), Worst(), Tail()])
def test_a_race_changes_nothing_but_the_effort(aim: Aim, monkeypatch: pytest.MonkeyPatch) -> None:
    raced, with_race = searched(aim)
    monkeypatch.setattr(room, "_FIRST", 1.0)
    whole, without = searched(aim)
    assert with_race.count < without.count
    assert raced.best.point == whole.best.point
    assert raced.best.worth == whole.best.worth
    assert len(raced.best.margins) == 8
    assert [item.point for item in raced.tried] == [item.point for item in whole.tried]


def test_the_most_that_a_worth_can_be_is_never_less_than_it_is() -> None:
    rng = np.random.default_rng(1)
    for aim in (PassProbability(), Worst(), Tail()):
        for _ in range(50):
            margins = rng.normal(0.0, 0.3, (10, 3))
            found = aim.of(margins)
            assert aim.most(margins, 10) == found
            assert all(aim.most(margins[:k], 10) >= found for k in range(1, 10))
