"""Where parameters and effects' states live in the vectors that a kernel works on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from eha_bench.core import plugins
from eha_bench.core.arrays import FloatArray, IndexArray
from eha_bench.core.errors import PluginError
from eha_bench.core.near_miss import suggest
from eha_bench.plants.effect import BoundEffect, Equation
from eha_bench.plants.parameter import Parameter


@dataclass(frozen=True)
class Layout:
    """Where each parameter lives in the vector `P`.

    Attributes:
        plant: plant id.
        parameters: the plant's own, first in `P`.
        effects: those that the plant has places for, in the order of their ids.
        synonyms: other names of parameters, as in `model.yaml` -> the name in `parameters`.
    """

    plant: str
    parameters: tuple[Parameter, ...]
    effects: tuple[BoundEffect, ...] = ()
    synonyms: Mapping[str, str] = field(default_factory=dict, kw_only=True)

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
    def size(self) -> int:
        """Length of `P`."""
        return sum(parameter.size for _, parameter in self.items())

    @cached_property
    def _senses(self) -> tuple[tuple[BoundEffect, ...], IndexArray, FloatArray]:
        """Effects that may act on what sensors read, places of their strengths, neutral values."""
        found = tuple(
            effect
            for effect in self.effects
            if any(
                hook.at.startswith("reading:")
                for spot in effect.spots
                for name in effect.action.hooks
                for hook in spot.hooks.get(name, ())
            )
        )
        places = [self.index[f"{effect.id}.{effect.strength.name}"] for effect in found]
        return found, np.array(places, dtype=np.intp), np.array([item.neutral for item in found])

    def sensors_are_ideal(self, vector: FloatArray) -> bool:
        """Whether every sensor reads the state itself with these parameters."""
        effects, places, neutral = self._senses
        if not effects:
            return True
        on = np.flatnonzero(vector[places] != neutral)
        return not any(
            effects[k].equation(self.choice_values(effects[k], vector)) is Equation.MEASUREMENT
            for k in on
        )

    def units_at(self, vector: FloatArray) -> dict[str, str]:
        """Return the unit of every parameter by key, an effect's where the vector has it act."""
        units = {parameter.name: parameter.unit for parameter in self.parameters}
        for effect in self.effects:
            at = self.choice_values(effect, vector)
            for parameter in effect.parameters:
                unit = effect.parameter_at(parameter.name, at).unit
                units[f"{effect.id}.{parameter.name}"] = unit
        return units

    def choice_values(self, effect: BoundEffect, vector: FloatArray) -> dict[str, object]:
        """Return the values of an effect's choices in a vector."""
        return {
            item.name: float(vector[self.index[f"{effect.id}.{item.name}"]])
            for item in effect.parameters
            if item.choices
        }

    @cached_property
    def _delays(self) -> tuple[tuple[int, int, float], ...]:
        """Places of the strength and of the time of every effect that looks back, and neutral."""
        return tuple(
            (
                self.index[f"{effect.id}.{effect.strength.name}"],
                self.index[f"{effect.id}.{parameter.name}"],
                effect.neutral,
            )
            for effect in self.effects
            if "command" in effect.action.hooks
            for parameter in effect.parameters
            if parameter.unit == "s"
        )

    def look_back(self, vector: FloatArray) -> float:
        """Return how long ago a command may be that still acts with these parameters, s."""
        delays = [vector[time] for on, time, off in self._delays if vector[on] != off]
        return float(sum(delays))

    def defaults(self) -> FloatArray:
        """Return `P` with the plant's defaults and every effect off."""
        vector = np.zeros(self.size)
        for key, parameter in self.items():
            at = self.index[key]
            vector[at : at + parameter.size] = parameter.default
        for effect in self.effects:
            vector[self.index[f"{effect.id}.{effect.strength.name}"]] = effect.neutral
        return vector

    def key(self, name: str) -> str:
        """Return the key of a parameter that may go by another name."""
        return self.synonyms.get(name, name)

    def effect(self, name: str) -> BoundEffect:
        """Return an effect of this plant.

        Raises:
            PluginError: no such effect, or the plant has no place for it.
        """
        for effect in self.effects:
            if effect.id == name:
                return effect
        known = [effect.id for effect in self.effects]
        if name in plugins.names("effects"):
            roles = " or ".join(plugins.load("effects", name).actions)
            raise PluginError(
                f"effect '{name}' acts on a {roles}, and {self.plant} has none",
                hint=f"it has places for: {', '.join(known)}",
            )
        raise PluginError(f"unknown effect '{name}' for {self.plant}", hint=suggest(name, known))
