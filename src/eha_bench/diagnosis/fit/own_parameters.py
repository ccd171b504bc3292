"""Where every number of a fit stands: the plant's parameters, and those that a run has of its own.

A load that nobody measured is another one in every run. So a parameter under `per_run` stands in a
vector once for all runs, where no run reads it, and behind the plant's layout once for each
training run, where a fit moves it with everything else (`Run.vector` puts it in its place). Only
its own run tells of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eha_bench.diagnosis.data.dataset import Run
from eha_bench.plants.layout import Layout
from eha_bench.plants.parameter import Parameter

FloatArray = NDArray[np.float64]
OwnValues = Mapping[str, Mapping[str, float]]
"""Run -> parameter -> value that the run has of its own, SI."""


@dataclass(frozen=True)
class Own:
    """A parameter (`name`, or `effect.name`) that one run has of its own, and its place."""

    parameter: str
    run: str
    place: int

    @property
    def key(self) -> str:
        """Its key beside those of the layout."""
        return f"{self.parameter} in {self.run}"


@dataclass(frozen=True)
class Places:
    """Where the numbers of a vector stand, by key.

    Attributes:
        layout: of the plant. own: what runs have of their own, in the order of their places.
    """

    layout: Layout
    own: tuple[Own, ...] = ()

    @cached_property
    def index(self) -> dict[str, int]:
        """Place of each number, by key."""
        return {**self.layout.index, **{item.key: item.place for item in self.own}}

    @cached_property
    def by_key(self) -> dict[str, Parameter]:
        """What each number is, by key."""
        known = self.layout.by_key
        return {**known, **{item.key: known[item.parameter] for item in self.own}}

    @cached_property
    def runs(self) -> dict[str, str]:
        """The run of each key that is one run's own."""
        return {item.key: item.run for item in self.own}

    def lengthened(self, vector: FloatArray) -> FloatArray:
        """Return a plant's vector with what runs have of their own, as declared for all of them."""
        size = max((item.place + 1 for item in self.own), default=vector.size)
        if size <= vector.size:
            return vector
        out = np.concatenate([vector, np.zeros(size - vector.size)])
        for item in self.own:
            out[item.place] = vector[self.layout.index[item.parameter]]
        return out

    def with_values(self, vector: FloatArray, values: OwnValues) -> FloatArray:
        """Return a vector, as long as `lengthened` makes it, with what runs have of their own."""
        out = self.lengthened(vector).copy()
        for item in self.own:
            out[item.place] = values.get(item.run, {}).get(item.parameter, out[item.place])
        return out

    def values(self, vector: FloatArray) -> OwnValues:
        """Return run -> parameter -> the value that the run has of its own, SI."""
        found: dict[str, dict[str, float]] = {}
        for item in self.own:
            found.setdefault(item.run, {})[item.parameter] = float(vector[item.place])
        return found


def places_of(layout: Layout, runs: Iterable[Run]) -> Places:
    """Return where the numbers of a plant and of some runs stand."""
    own = {place: Own(key, run.name, place) for run in runs for key, place in run.own.items()}
    return Places(layout, tuple(own[place] for place in sorted(own)))


def with_own(layout: Layout, runs: Sequence[Run], per_run: Sequence[str]) -> tuple[Run, ...]:
    """Return runs with a place for every parameter that each has of its own.

    What a run declares is known, and not estimated.
    """
    found, place = [], layout.size
    for run in runs:
        keys = [key for key in per_run if key not in run.parameters]
        found.append(replace(run, own={key: place + k for k, key in enumerate(keys)}))
        place += len(keys)
    return tuple(found)
