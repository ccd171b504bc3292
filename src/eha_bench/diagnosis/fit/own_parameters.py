"""Where every number of a fit stands: the plant's parameters, and those of single runs.

An unmeasured load differs from run to run. So a parameter under `per_run` stands in a
vector once for all runs, where no run reads it, and behind the plant's layout once for each
training run, where a fit moves it with everything else (`Run.vector` puts it in its place). Only
its own run tells of it.

Behind these stands by how much each topic's stamps are late (`data.ticks`): always the same,
nothing of the machine's, and known only by a fit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.dataset import Run
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.fit.reached import NO_BOUNDS, ReachedBounds, reached_bounds
from eha_bench.plants.layout import Layout
from eha_bench.plants.parameter import Parameter

OwnValues = Mapping[str, Mapping[str, float]]
"""Run -> parameter -> value of that run alone, SI."""


@dataclass(frozen=True)
class RunParameter:
    """A parameter (`name`, or `effect.name`) of one run alone, and its place."""

    parameter: str
    run: str
    place: int

    @property
    def key(self) -> str:
        """Its key among those of the layout."""
        return f"{self.parameter} in {self.run}"


LATEST = 2e-3
"""Most that a fit takes a topic's stamps to be late by, s; early ones likewise. With more, it would
take a lag of what is read for it: that is told apart before (`late_topics`)."""
_AT_MOST = 0.99
"""Share of that from which stamps are late by the most."""
LATENESS = Parameter("lateness", "s", 0.0, -LATEST, LATEST)


def is_latest(late: float) -> bool:
    """Whether stamps are late or early by the most that a fit takes them to be, s."""
    return abs(late) > _AT_MOST * LATEST


@dataclass(frozen=True)
class LateClock:
    """A clock whose stamps may be late by always the same, and the place of that number.

    Attributes:
        clock: its name. place: in a vector, of what it is late by beyond `read_earlier`.
        channels: what ticks with it. read_earlier: s, by which they are read before their stamps.
    """

    clock: str
    place: int
    channels: tuple[str, ...] = ()
    read_earlier: float = 0.0

    @property
    def key(self) -> str:
        """Its key among those of the layout."""
        return f"lateness of {self.clock}"


_NEAR = 1e-3
"""Share of a bound within which a number stands at it."""


@dataclass(frozen=True)
class Places:
    """Where the numbers of a vector stand, by key.

    Attributes:
        layout: of the plant. own: the runs' own parameters, in the order of their places.
        late: clocks whose lateness is estimated. reached: bounds by what was measured.
    """

    layout: Layout
    own: tuple[RunParameter, ...] = ()
    late: tuple[LateClock, ...] = ()
    reached: tuple[ReachedBounds, ...] = ()

    def bounds(self, key: str, vector: FloatArray) -> tuple[float, float]:
        """Return between what a number may be by what was measured, SI; mostly infinite."""
        known = (item.at(vector) for item in self.reached if item.key == key)
        return next(known, NO_BOUNDS)

    def permits(self, vector: FloatArray, keys: Iterable[str]) -> bool:
        """Return whether numbers of a vector are within what measurements let them be."""
        return all(
            low <= vector[self.index[key]] <= high
            for key in keys
            for low, high in [self.bounds(key, vector)]
        )

    def may_begin(self, vector: FloatArray, keys: Sequence[str]) -> bool:
        """Return whether a search may begin from a vector: as permitted, and where it acts."""
        return self.permits(vector, keys) and all(
            vector[self.index[item.key]] <= item.highest_first(vector)
            for item in self.reached
            if item.key in keys
        )

    def bound_met(self, keys: Iterable[str], vector: FloatArray) -> tuple[str, float] | None:
        """Return the first number that is as large as measurements let it be, with that; or None.

        A least setting of a valve is only where it is no longer told from a leak; what is fitted
        there may well be a valve.
        """
        for key in keys:
            _, most = self.bounds(key, vector)
            if np.isfinite(most) and float(vector[self.index[key]]) >= (1.0 - _NEAR) * most:
                return key, most
        return None

    @cached_property
    def behind(self) -> tuple[RunParameter | LateClock, ...]:
        """What stands behind the plant's parameters."""
        return (*self.own, *self.late)

    @cached_property
    def index(self) -> dict[str, int]:
        """Place of each number, by key."""
        return {**self.layout.index, **{item.key: item.place for item in self.behind}}

    @cached_property
    def by_key(self) -> dict[str, Parameter]:
        """What each number is, by key."""
        known = self.layout.by_key
        own = {item.key: known[item.parameter] for item in self.own}
        return {**known, **own, **{item.key: LATENESS for item in self.late}}

    @cached_property
    def runs(self) -> dict[str, str]:
        """The run of each key that is one run's own."""
        return {item.key: item.run for item in self.own}

    def lengthened(self, vector: FloatArray) -> FloatArray:
        """Return a plant's vector with the runs' own parameters, as declared for all of them."""
        size = max((item.place + 1 for item in self.behind), default=vector.size)
        if size <= vector.size:
            return vector
        out = np.concatenate([vector, np.zeros(size - vector.size)])
        for item in self.own:
            out[item.place] = vector[self.layout.index[item.parameter]]
        return out

    def with_values(self, vector: FloatArray, values: OwnValues) -> FloatArray:
        """Return a vector, as long as `lengthened` makes it, with the runs' own parameters."""
        out = self.lengthened(vector).copy()
        for item in self.own:
            out[item.place] = values.get(item.run, {}).get(item.parameter, out[item.place])
        return out

    def lateness(self, vector: FloatArray) -> dict[str, float]:
        """Return clock -> what it is late by as it is read, s, of those that a vector knows of."""
        known = (item for item in self.late if item.place < vector.size)
        return {item.clock: float(vector[item.place]) for item in known}

    def with_lateness(self, vector: FloatArray, lateness: Mapping[str, float]) -> FloatArray:
        """Return a vector, as long as `lengthened` makes it, with clocks late by what is given.

        Args:
            vector: of the plant. lateness: clock -> s, as it is read.
        """
        out = self.lengthened(vector).copy()
        for item in self.late:
            out[item.place] = lateness.get(item.clock, out[item.place])
        return out

    def beyond_reading(self, lateness: Mapping[str, float]) -> dict[str, float]:
        """Return clock -> what it is late by as it is read, s, from what it is late by in all."""
        return {
            item.clock: lateness[item.clock] - item.read_earlier
            for item in self.late
            if item.clock in lateness
        }

    def values(self, vector: FloatArray) -> OwnValues:
        """Return run -> parameter -> the value of that run alone, SI."""
        found: dict[str, dict[str, float]] = {}
        for item in self.own:
            found.setdefault(item.run, {})[item.parameter] = float(vector[item.place])
        return found


def places_of(layout: Layout, runs: Iterable[Measured]) -> Places:
    """Return where the numbers of a plant and of some runs stand."""
    own: dict[int, RunParameter] = {}
    late: dict[int, LateClock] = {}
    known = list({id(item): item for item in runs}.values())
    for item in known:
        run = item.run
        own |= {place: RunParameter(key, run.name, place) for key, place in run.own.items()}
        for clock, place in item.clocks.items():
            before = late[place].channels if place in late else ()
            own_names = (name for name, ticks_with in item.late.items() if ticks_with == clock)
            names = tuple(dict.fromkeys((*before, *own_names)))
            late[place] = LateClock(clock, place, names, _read_earlier(run, names))
    return Places(
        layout,
        tuple(own[place] for place in sorted(own)),
        tuple(late[place] for place in sorted(late)),
        reached_bounds(layout, known),
    )


def _read_earlier(run: Run, channels: Iterable[str]) -> float:
    return next((run.stamped_late[name] for name in channels if name in run.stamped_late), 0.0)


def with_clocks(layout: Layout, measured: Sequence[Measured]) -> tuple[Measured, ...]:
    """Return runs with a place for the lateness of every clock that may be late."""
    behind = [place + 1 for item in measured for place in item.run.own.values()]
    first = max((layout.size, *behind))
    names = dict.fromkeys(clock for item in measured for clock in item.late.values())
    places = {name: first + k for k, name in enumerate(names)}
    return tuple(
        replace(item, clocks={name: places[name] for name in dict.fromkeys(item.late.values())})
        if item.late
        else item
        for item in measured
    )


def with_own(layout: Layout, runs: Sequence[Run], per_run: Sequence[str]) -> tuple[Run, ...]:
    """Return runs with a place for every parameter of single runs.

    What a run declares is known, and not estimated.
    """
    found, place = [], layout.size
    for run in runs:
        keys = [key for key in per_run if key not in run.parameters]
        found.append(replace(run, own={key: place + k for k, key in enumerate(keys)}))
        place += len(keys)
    return tuple(found)


def like_clocks(measured: Measured, others: Sequence[Measured]) -> Measured:
    """Return a run whose clocks have the places that they have in other runs."""
    known = {name: place for item in others for name, place in item.clocks.items()}
    own = {name: known[name] for name in measured.late.values() if name in known}
    return replace(measured, clocks=own) if own else measured
