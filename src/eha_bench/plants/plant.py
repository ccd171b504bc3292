"""What every plant offers: parameters, effects, and simulation of its measured channels."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from eha_bench.core import plugins
from eha_bench.core.errors import PluginError
from eha_bench.plants.effect import Effect
from eha_bench.plants.layout import Layout

FloatArray = NDArray[np.float64]

_FIRST_TICK = "first tick"


@dataclass(frozen=True)
class Drive:
    """What drives a simulation: measured inputs on a clock, the setup, and where it starts.

    Attributes:
        time: (n,) s, increasing.
        inputs: channel -> (n,) SI; commands are held between samples, measured states that
            stand here are imposed (their own equation drops out), linear between samples.
        initial: channel -> what its sensor reads at the first sample, SI (the plant finds the
            state behind it); the rest starts at 0 or at what the plant takes as rest.
        locked, bypass_open: setup of the rig.
        first: tick at which the simulation starts; what is before it is history of the inputs
            (a delayed command looks back), and its rows of the result are NaN.
    """

    time: FloatArray
    inputs: Mapping[str, FloatArray]
    initial: Mapping[str, float] = field(default_factory=dict)
    locked: bool = False
    bypass_open: bool = False
    first: int = 0
    laid_out: dict[str, object] = field(default_factory=dict, init=False, repr=False, compare=False)
    """What is kept of the inputs between simulations: a plant's by its id, and the first tick."""

    def starting(self, initial: Mapping[str, float]) -> Drive:
        """Return the same drive from another first state; what is laid out is shared."""
        other = replace(self, initial=initial)
        object.__setattr__(other, "laid_out", self.laid_out)
        return other

    @property
    def first_tick(self) -> Drive:
        """The drive ended at the tick where it starts."""
        kept = self.laid_out.get(_FIRST_TICK)
        if not isinstance(kept, Drive):
            end = self.first + 1
            inputs = {name: values[:end] for name, values in self.inputs.items()}
            kept = replace(self, time=self.time[:end], inputs=inputs)
            self.laid_out[_FIRST_TICK] = kept
        return kept


class Parametrised:
    """A plant with its parameters set: what depends on them alone is looked up once.

    Attributes:
        plant: the plant. vector: its parameters, as `layout` orders them.
    """

    def __init__(self, plant: Plant, vector: FloatArray) -> None:
        self.plant = plant
        self.vector = vector
        self.sensors_are_ideal = plant.layout.sensors_are_ideal(vector)

    def simulate(self, drive: Drive, initial: Mapping[str, float], step: float) -> FloatArray:
        """Return what the sensors would read from another first state than the drive's own.

        Args and result are those of `Plant.simulate`.
        """
        return self.plant.simulate(self.vector, drive.starting(initial), step)


class Plant(ABC):
    """A plant: equations compiled with all effects, simulated from inputs and a first state."""

    id: str
    outputs: tuple[str, ...]
    """Channels that `simulate` returns, in the order of its columns."""

    states: tuple[str, ...]
    """Names that `Drive.initial` may give."""

    layout: Layout

    def __reduce__(self) -> tuple[Callable[[str], Plant], tuple[str]]:
        """Travel to other processes by name: each compiles, or loads, a kernel of its own."""
        return get_plant, (self.id,)

    @abstractmethod
    def simulate(self, vector: FloatArray, drive: Drive, step: float) -> FloatArray:
        """Return what the sensors would read, without noise.

        Args:
            vector: parameters of plant and effects, as `layout` orders them.
            drive: inputs, setup and first state.
            step: largest integration step in s.

        Returns:
            (n, len(outputs)), SI.
        """

    def at(self, vector: FloatArray) -> Parametrised:
        """Return the plant with its parameters set, for many simulations with them."""
        return Parametrised(self, vector)

    def determined(
        self,
        inputs: Collection[str],  # noqa: ARG002 - for plants that not every input drives
    ) -> tuple[str, ...]:
        """Return the outputs that these inputs determine: nothing drives the others."""
        return self.outputs

    def at_rest(
        self,
        measured: Mapping[str, float],  # noqa: ARG002 - for plants whose states tell of each other
    ) -> dict[str, float]:
        """Return states that have no reading at the first sample, as those that have one tell them.

        Args:
            measured: state -> reading at the first sample, SI.
        """
        return {}

    def behind(
        self,
        vector: FloatArray,  # noqa: ARG002 - for plants with other sensors than of their states
        readings: Mapping[str, float],  # noqa: ARG002 - for these as well
    ) -> dict[str, float]:
        """Return states that other readings tell of, SI: a position behind a joint's angle.

        Args:
            vector: parameters. readings: channel -> reading at one sample, SI; any channels.
        """
        return {}

    def derived(
        self,
        vector: FloatArray,  # noqa: ARG002 - for plants with other sensors than of their outputs
        outputs: Mapping[str, FloatArray],  # noqa: ARG002 - for these as well
    ) -> dict[str, FloatArray]:
        """Return channels that follow from the outputs alone, (n,) SI.

        Args:
            vector: parameters. outputs: channel -> (n,) SI, those that are known.
        """
        return {}

    def sweep(self, vectors: FloatArray, drive: Drive, step: float) -> FloatArray:
        """Return what `simulate` does for many parameter sets over the same input.

        Args:
            vectors: (m, len(P)), a set a row.
            drive, step: as in `simulate`.

        Returns:
            (m, n, len(outputs)), SI.
        """
        return np.stack([self.simulate(vector, drive, step) for vector in vectors])


def effects_of(plant: str) -> tuple[Effect, ...]:
    """Return all registered effects that apply to a plant, in the order of their ids."""
    found: list[Effect] = []
    for name in plugins.names("effects"):
        effect = plugins.load("effects", name)
        if not isinstance(effect, Effect):
            raise PluginError(f"effect '{name}' is not an Effect but {type(effect).__name__}")
        if plant in effect.actions:
            found.append(effect)
    return tuple(sorted(found, key=lambda effect: effect.id))


@cache
def get_plant(name: str) -> Plant:
    """Return the registered plant of that id, compiled on first use.

    Raises:
        PluginError: no such plant.
    """
    plant = plugins.load("plants", name)()
    if not isinstance(plant, Plant):
        raise PluginError(f"plant '{name}' is not a Plant but {type(plant).__name__}")
    return plant
