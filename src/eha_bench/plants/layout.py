"""Where parameters, signals and effects' states live in the vectors that a kernel works on."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.errors import PluginError
from eha_bench.plants.effect import Effect, Equation
from eha_bench.plants.parameter import Parameter

SENSOR = "measured_"
"""How the names of the hooks begin where what a sensor reads is changed."""


@dataclass(frozen=True)
class Layout:
    """Where each parameter and effect state lives in the vectors `P` and `S`.

    Attributes:
        plant: plant id.
        parameters: the plant's own, first in `P`.
        effects: registered effects that apply to the plant, in the order of their ids.
        hooks: names of the places where effects act, each with a flag in `S` that says whether
            any effect is on there.
        signals: measured signals that effects may look at by name, first in `S`.
    """

    plant: str
    parameters: tuple[Parameter, ...]
    effects: tuple[Effect, ...]
    hooks: tuple[str, ...]
    signals: tuple[str, ...] = ()

    @cached_property
    def index(self) -> dict[str, int]:
        """Place of each parameter: `name` for the plant's, `effect.name` for an effect's."""
        places: dict[str, int] = {}
        position = 0
        for key, parameter in self.items():
            places[key] = position
            position += parameter.size
        return places

    def items(self) -> Iterable[tuple[str, Parameter]]:
        """All parameters with their keys, in the order of `P`."""
        for parameter in self.parameters:
            yield parameter.name, parameter
        for effect in self.effects:
            for parameter in effect.parameters:
                yield f"{effect.id}.{parameter.name}", parameter

    @cached_property
    def by_key(self) -> dict[str, Parameter]:
        """Parameters by key."""
        return dict(self.items())

    @cached_property
    def flags(self) -> dict[str, int]:
        """Place of each hook's flag in `S`, after the signals."""
        return {name: place for place, name in enumerate(self.hooks, len(self.signals))}

    @cached_property
    def states(self) -> dict[str, int]:
        """Place of each effect's state in `S`, as `effect.state`."""
        names = [f"{effect.id}.{state}" for effect in self.effects for state in effect.states]
        first = len(self.signals) + len(self.hooks)
        return {name: position for position, name in enumerate(names, first)}

    @property
    def memory(self) -> int:
        """Length of `S`: signals, flags of the hooks, effects' states."""
        return max(1, len(self.signals) + len(self.hooks) + len(self.states))

    @property
    def size(self) -> int:
        """Length of `P`."""
        return sum(parameter.size for _, parameter in self.items())

    @cached_property
    def _senses(self) -> tuple[tuple[Effect, ...], NDArray[np.intp], NDArray[np.float64]]:
        """Effects that may act on what sensors read, places of their strengths, neutral values."""
        found = tuple(
            effect
            for effect in self.effects
            if any(hook.startswith(SENSOR) for hook in effect.action(self.plant).hooks)
        )
        places = [self.index[f"{effect.id}.{effect.strength.name}"] for effect in found]
        return found, np.array(places, dtype=np.intp), np.array([item.neutral for item in found])

    def sensors_are_ideal(self, vector: NDArray[np.float64]) -> bool:
        """Whether every sensor reads the state itself with these parameters."""
        effects, places, neutral = self._senses
        on = np.flatnonzero(vector[places] != neutral)
        return not any(self._acts_on_a_sensor(effects[k], vector) for k in on)

    def _acts_on_a_sensor(self, effect: Effect, vector: NDArray[np.float64]) -> bool:
        """Whether an effect is one of measurement, with the choice that decides its equation."""
        choice = effect.action(self.plant).chosen_by
        values = {choice: float(vector[self.index[f"{effect.id}.{choice}"]])} if choice else {}
        return effect.equation(self.plant, values) is Equation.MEASUREMENT

    def defaults(self) -> NDArray[np.float64]:
        """Return `P` with the plant's defaults and every effect off."""
        vector = np.zeros(self.size)
        for key, parameter in self.items():
            at = self.index[key]
            vector[at : at + parameter.size] = parameter.default
        for effect in self.effects:
            vector[self.index[f"{effect.id}.{effect.strength.name}"]] = effect.neutral
        return vector

    def effect(self, name: str) -> Effect:
        """Return a registered effect of this plant.

        Raises:
            PluginError: no such effect, or not for this plant.
        """
        for effect in self.effects:
            if effect.id == name:
                return effect
        known = ", ".join(effect.id for effect in self.effects)
        raise PluginError(f"unknown effect '{name}' for {self.plant}", hint=f"known: {known}")
