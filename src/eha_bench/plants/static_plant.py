"""A plant without states: every sample of a log is an operating point.

Its effects are evaluated as they are written, over all points at once, without compilation.
"""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from typing import Any

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import InputError
from eha_bench.plants.effect import Equation
from eha_bench.plants.plant import Drive, Plant


class StaticPlant(Plant, ABC):
    """A balance that holds at every operating point by itself."""

    inputs: tuple[str, ...]
    """Channels that `respond` needs."""

    balance: Equation
    """The equation that it solves."""

    states = ()

    @abstractmethod
    def respond(self, vector: FloatArray, inputs: Mapping[str, FloatArray]) -> FloatArray:
        """Return what is measured at operating points, (n, len(outputs)), SI.

        Args:
            vector: parameters, as `layout` orders them.
            inputs: channel -> (n,) SI.
        """

    def simulate(self, vector: FloatArray, drive: Drive, step: float) -> FloatArray:
        """Return what the sensors would read at every sample, (n, len(outputs)), SI.

        Raises:
            InputError: an input that this plant does not have, or one that is missing.
        """
        del step
        self.check_inputs(drive.inputs)
        return self.respond(vector, drive.inputs)

    def check_inputs(self, inputs: Collection[str]) -> None:
        """Refuse other inputs than those that the balance is solved with.

        Raises:
            InputError: an input that this plant does not have, or one that is missing.
        """
        if set(inputs) != set(self.inputs):
            raise InputError(
                f"{self.id} takes the inputs {', '.join(self.inputs)}, "
                f"not {', '.join(sorted(inputs)) or 'none'}",
                hint="name them under inputs in dataset.yaml",
            )

    def apply_effects(
        self, hook: str, vector: FloatArray, first: str, scope: dict[str, Any]
    ) -> None:
        """Let every effect that is on change `scope[first]` at a hook.

        Args:
            hook: place of the equations. vector: parameters.
            first: name of what is changed. scope: what the effects' functions may name.
        """
        for effect in sorted(self.layout.effects, key=lambda item: (item.effect.order, item.id)):
            function = effect.action.hooks.get(hook)
            own = {
                parameter.name: float(vector[self.layout.index[f"{effect.id}.{parameter.name}"]])
                for parameter in effect.parameters
            }
            if function is None or own[effect.strength.name] == effect.neutral:
                continue
            known = {**scope, **own}
            scope[first] = function(**{name: known[name] for name in _names(function)})


def _names(function: Any) -> tuple[str, ...]:
    return tuple(inspect.signature(function).parameters)
