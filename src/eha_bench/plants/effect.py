"""An effect: one physical phenomenon that a plant's declared equations may lack.

An effect is written as small pure functions, one for each place of the plant's kernel where it
acts (a *hook*). A function names what it needs as its arguments: the hook's own quantities
(`omega`, `pressure`, `level` ...), parameters of the plant by name, the effect's own parameters and
states by name, or a NamedTuple of such names. `composition` binds them and `assembly` compiles
everything once; at its neutral parameters an effect is skipped, so the declared model is nested in
every candidate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from eha_bench.core.errors import PluginError
from eha_bench.plants.parameter import Parameter


class Equation(StrEnum):
    """The balance that an effect acts in."""

    ACTUATION = "actuation"
    TORQUE = "torque"
    FLOW = "flow"
    FORCE = "force"
    MEASUREMENT = "measurement"


@dataclass(frozen=True)
class Action:
    """How an effect acts in one plant: the equation, and a function for each hook it uses.

    Attributes:
        equation: the balance it acts in, with every choice at its default.
        hooks: hook -> function that returns the hook's first quantity, changed.
        chosen_by: the choice parameter that decides the equation, where one does.
        equations: word of that choice -> equation; the rest act in `equation`.
        choices: parameter -> the words that make sense in this plant, where not all do.
        same_as: word of `chosen_by` ("" where nothing is chosen) -> the plant's own parameter that
            says the same. Where that is not 0 the effect would only repeat it: no candidate.
        advance, start: what moves and sets the effect's states in this plant, instead of the
            effect's own functions.
    """

    equation: Equation
    hooks: Mapping[str, Callable[..., object]]
    chosen_by: str = ""
    equations: Mapping[str, Equation] = field(default_factory=dict)
    choices: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    same_as: Mapping[str, str] = field(default_factory=dict)
    advance: Mapping[str, Callable[..., float]] = field(default_factory=dict)
    start: Mapping[str, Callable[..., float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Effect:
    """A named effect with its parameters and its action in every plant it applies to.

    Attributes:
        id: public name.
        summary: one sentence.
        parameters: the first one is the *strength*: at its `neutral` value the effect is off.
            A parameter's `default` is a typical size, from which a search may start.
        neutral: value of the strength at which the effect is off.
        actions: plant id -> action.
        states: names of the effect's own states (all start at 0 unless `start` has a function).
        advance: state name -> function returning the state after a time `h`.
        start: state name -> function returning the state at the first sample.
        source: literature.
        separate: the experiment that tells this effect from its look-alikes.
        starts: further starting points of a search, as {parameter: value}; a choice is given by
            its place among the words, as in the parameter vector. The rest keep their defaults.
        order: place in a hook's chain where several effects meet; what scales or filters the
            others' sum comes later.
    """

    id: str
    summary: str
    parameters: tuple[Parameter, ...]
    actions: Mapping[str, Action]
    source: str
    neutral: float = 0.0
    states: tuple[str, ...] = ()
    advance: Mapping[str, Callable[..., float]] = field(default_factory=dict)
    start: Mapping[str, Callable[..., float]] = field(default_factory=dict)
    separate: str = ""
    starts: tuple[Mapping[str, float], ...] = ()
    order: int = 0

    @property
    def strength(self) -> Parameter:
        """The parameter that turns the effect off at its neutral value."""
        return self.parameters[0]

    def parameter(self, name: str) -> Parameter:
        """Return one of the effect's parameters.

        Raises:
            PluginError: it has none of that name.
        """
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        known = ", ".join(parameter.name for parameter in self.parameters)
        raise PluginError(f"effect '{self.id}' has no parameter '{name}'", hint=f"it has: {known}")

    def searched(self, values: Mapping[str, object]) -> tuple[Parameter, ...]:
        """Return what a search moves, given the choices (words or places) among `values`."""
        return tuple(
            parameter
            for parameter in self.parameters
            if parameter.searched and not parameter.choices and self._matters(parameter, values)
        )

    def _matters(self, parameter: Parameter, values: Mapping[str, object]) -> bool:
        name, words = parameter.when
        return not name or self._chosen(name, values) in words

    def action(self, plant: str) -> Action:
        """Return how the effect acts in a plant.

        Raises:
            PluginError: the effect does not apply to that plant.
        """
        if plant not in self.actions:
            raise PluginError(
                f"effect '{self.id}' does not apply to plant '{plant}'",
                hint=f"it applies to: {', '.join(self.actions)}",
            )
        return self.actions[plant]

    def equation(self, plant: str, values: Mapping[str, object] | None = None) -> Equation:
        """Return the balance it acts in, given its parameters' values (words or places).

        Raises:
            PluginError: the effect does not apply to that plant.
        """
        action = self.action(plant)
        return action.equations.get(self._word(action, values), action.equation)

    def repeats(self, plant: str, values: Mapping[str, object] | None = None) -> str:
        """Return the plant's own parameter that says the same, "" where there is none.

        Raises:
            PluginError: the effect does not apply to that plant.
        """
        action = self.action(plant)
        return action.same_as.get(self._word(action, values), "")

    def _word(self, action: Action, values: Mapping[str, object] | None) -> str:
        """Return the word that decides the equation, "" where nothing is chosen."""
        return self._chosen(action.chosen_by, values or {}) if action.chosen_by else ""

    def _chosen(self, name: str, values: Mapping[str, object]) -> str:
        """Return the word of a choice, given as word or place, or its default."""
        parameter = self.parameter(name)
        value = values.get(name, parameter.default)
        return value if isinstance(value, str) else str(parameter.decode(float(str(value))))
