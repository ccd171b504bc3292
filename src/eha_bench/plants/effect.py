"""An effect: one physical phenomenon that a plant's declared equations may lack.

An effect is bound to a role, never to a plant: to the friction of anything that moves, to a volume,
a pump, a drive, a valve, a sensor. It is written as small pure functions, one for each place of the
role where it acts (a *hook*). The first argument of such a function is what it changes; the others
name what it needs: quantities of the hook, of the place (`speed`, `pressure` ...), the effect's own
parameters and states, or a NamedTuple of such names. Everything is compiled once; at its neutral
strength an effect is skipped, so the declared model is nested in every candidate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from functools import cache, cached_property

from eha_bench.core import plugins
from eha_bench.core.errors import PluginError
from eha_bench.core.near_miss import suggest
from eha_bench.core.place_unit import unit_at_place, usual_size
from eha_bench.plants.parameter import Parameter, choice

AT = "at"
"""The parameter that says where an effect acts, where there is more than one place."""
EVERYWHERE = "all"
"""Its word for all places alike."""
POSITION_LOOP = "position_loop"
"""The role of a controller inside a plant that is given a reference."""
ANYTHING = "anything"
"""The role of every place where something may act: of one place at a time."""


class Equation(StrEnum):
    """The balance that an effect acts in."""

    ACTUATION = "actuation"
    TORQUE = "torque"
    FLOW = "flow"
    FORCE = "force"
    MEASUREMENT = "measurement"


@dataclass(frozen=True)
class Opening:
    """What opens above a setting, and is shut most of the time.

    Attributes:
        setting: the parameter. reached: function returning what is held against it, of `p_a` and
            `p_b` (pressures of two chambers) and the effect's choices.
    """

    setting: str
    reached: Callable[..., float]


@dataclass(frozen=True)
class Coupling:
    """An elastic coupling with play, by the names of an effect's parameters.

    Attributes:
        compliance: inverse of the stiffness, m/N (or rad/(N*m)); where it is 0 the coupling is as
            stiff as can be followed.
        damping_time: damping over stiffness, s.
        sensors: a choice, not the first word of which where the sensors are on the other side.
        play: m (or rad) from end to end, "" where there is none.
    """

    compliance: str
    damping_time: str
    sensors: str
    play: str = ""


@dataclass(frozen=True)
class Action:
    """How an effect acts in one role.

    Attributes:
        hooks: hook of the role -> function that returns its first argument, changed.
        equation: the balance it acts in, None for that of the place.
        chosen_by: the choice parameter that decides the equation, where one does.
        equations: word of that choice -> equation; the rest act in `equation`.
        choices: parameter -> the words that make sense in this role, where not all do.
        advance: state -> function returning it after a time `h`.
        start: state -> function returning it at the first sample (else 0).
        adjusts: parameter of the place -> function returning it changed, for what does not change
            with time or state.
        couples: how it sets an elastic coupling in a joint that the plant takes for rigid, None
            where it does not.
        same_as: parameter of the place that says the same: where that is not 0, the effect would
            only repeat it.
        needs: parameter of the place without which there is nothing that it could change.
        alike: two parameters of the place that are declared the same where the effect can be what
            is missing.
        charges: the effect's parameter that is the pressure of the oil at rest, "" for none.
        opens: a setting that is not reached most of the time, None where there is none.
        fades_by: the effect's parameter that is the speed by which it falls, "" for none: a search
            holds it well below the fastest that was measured.
        plays: the effect's parameter that is a play, "" for none: one as large as all travel that
            was measured never closes.
        remembers: whether its states follow from what was asked for alone: they start
            at the first command of a recording, and those before a window bring them to its start.
        unread: state -> function of the effect's parameters and of what is usual at its place
            (`Spot.usual`), returning how far it may be from `start` in the midst of a motion,
            where no reading says it; 0: not at all.
    """

    hooks: Mapping[str, Callable[..., object]] = field(default_factory=dict)
    equation: Equation | None = None
    chosen_by: str = ""
    equations: Mapping[str, Equation] = field(default_factory=dict)
    choices: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    advance: Mapping[str, Callable[..., float]] = field(default_factory=dict)
    start: Mapping[str, Callable[..., float]] = field(default_factory=dict)
    adjusts: Mapping[str, Callable[..., float]] = field(default_factory=dict)
    couples: Coupling | None = None
    same_as: str = ""
    needs: str = ""
    alike: tuple[str, str] | None = None
    charges: str = ""
    opens: Opening | None = None
    fades_by: str = ""
    plays: str = ""
    remembers: bool = False
    unread: Mapping[str, Callable[..., float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Effect:
    """A named effect with its parameters and its action in every role that it fits.

    Attributes:
        id: public name.
        summary: one sentence.
        parameters: the first one is the *strength*: at its `neutral` value the effect is off. A
            `default` is a typical size, from which a search may start. Where the unit depends on
            the place (`{effort}/{speed}^2`), defaults are shares of what is usual there.
        neutral: value of the strength at which the effect is off.
        actions: role -> action.
        states: names of the effect's own states at each place.
        together: whether a search tries all places alike as well. only_together: whether it is
            the only one.
        source: literature.
        separate: the experiment that tells this effect from its look-alikes.
        starts: further starting points of a search, as {parameter: value}; a choice is given by
            its place among the words. The rest keep their defaults.
        order: place in a hook's chain where several effects meet; what scales or filters the
            others' sum comes later.
        yields_to: id of an effect that describes the same with less: it is named where both
            explain what is there.
        reversing: whether it shows only where a motion turns back.
        relative: whether a sensor of something else has to be read: alone, it is late as a command
            is.
    """

    id: str
    summary: str
    parameters: tuple[Parameter, ...]
    actions: Mapping[str, Action]
    source: str
    neutral: float = 0.0
    states: tuple[str, ...] = ()
    together: bool = False
    only_together: bool = False
    separate: str = ""
    starts: tuple[Mapping[str, float], ...] = ()
    order: int = 0
    yields_to: str = ""
    reversing: bool = False
    relative: bool = False

    def __post_init__(self) -> None:
        """Refuse names that mean nothing: misspelt, they would be without effect.

        Raises:
            PluginError: an action advances what is no state, or names what is no parameter.
        """
        parameters = [item.name for item in self.parameters]
        for action in self.actions.values():
            self._refuse_unknown("state", (*action.advance, *action.start), self.states)
            setting = action.opens.setting if action.opens else ""
            coupling = asdict(action.couples).values() if action.couples else ()
            named = (*action.choices, action.chosen_by, action.charges, setting, *coupling)
            self._refuse_unknown("parameter", filter(None, named), parameters)
        for start in self.starts:
            self._refuse_unknown("parameter", start, parameters)

    def _refuse_unknown(self, what: str, names: Iterable[str], known: Sequence[str]) -> None:
        for name in names:
            if name not in known:
                raise PluginError(
                    f"effect '{self.id}' names the {what} '{name}', which it does not have",
                    hint=suggest(name, known),
                )

    @property
    def strength(self) -> Parameter:
        """The parameter that turns the effect off at its neutral value."""
        return self.parameters[0]


@dataclass(frozen=True)
class Hook:
    """One place of a kernel, as a role's hook.

    Attributes:
        at: id of the place in the kernel. names: what functions may name there -> expression.
    """

    at: str
    names: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Spot:
    """A place of a plant that plays a role.

    Attributes:
        name: as `at` says it: a node, an element or a channel.
        equation: the balance there.
        hooks: hook of the role -> where that is in the kernel; one hook may be at several.
        names: what every function may name -> expression.
        units: units that depend on the place (`effort`, `speed` ...).
        usual: what is usual there, SI, by the same words.
        parameters: name of a parameter of the place -> key in the plant's layout.
        also: other names that `at` may call it.
        words: choice of an effect -> the words of it that make sense here.
        vocabulary: choice of an effect -> its words in this plant.
        follows: form in which something unknown may act here -> variables that it may follow.
        sensors: channels that it changes without changing what goes on; none for a balance.
        angle: channel of the angle that something periodic follows there; "" where none shows it.
        motion: channels of the position and the speed there, "" where none shows it.
        reference: the input without which nothing goes on there, "" for none.
    """

    name: str
    equation: Equation
    hooks: Mapping[str, tuple[Hook, ...]]
    names: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    usual: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, str] = field(default_factory=dict)
    also: tuple[str, ...] = ()
    words: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    vocabulary: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    follows: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    sensors: tuple[str, ...] = ()
    angle: str = ""
    motion: tuple[str, str] = ("", "")
    reference: str = ""


Spots = Mapping[str, Sequence[Spot]]
"""Role -> the places of a plant that play it."""


@dataclass(frozen=True)
class BoundEffect:
    """An effect in a plant: with the places where it may act there.

    Attributes:
        effect: it. role: the one that it plays. spots: where.
    """

    effect: Effect
    role: str
    spots: tuple[Spot, ...]

    @property
    def id(self) -> str:
        """Public name."""
        return self.effect.id

    @property
    def summary(self) -> str:
        """What it is, in one sentence."""
        return self.effect.summary

    @property
    def source(self) -> str:
        """Literature."""
        return self.effect.source

    @property
    def separate(self) -> str:
        """The experiment that tells it from its look-alikes."""
        return self.effect.separate

    @property
    def reversing(self) -> bool:
        """Whether it shows only where a motion turns back."""
        return self.effect.reversing

    @property
    def action(self) -> Action:
        """How it acts in its role."""
        return self.effect.actions[self.role]

    @property
    def neutral(self) -> float:
        """Value of the strength at which it is off."""
        return self.effect.neutral

    @property
    def strength(self) -> Parameter:
        """The parameter that turns it off at its neutral value."""
        return self.parameters[0]

    @cached_property
    def places(self) -> tuple[str, ...]:
        """The words of `at`."""
        names = tuple(spot.name for spot in self.spots)
        if self.effect.only_together:
            return (EVERYWHERE,) if len(names) > 1 else names
        return (EVERYWHERE, *names) if len(names) > 1 and self._alike else names

    @property
    def _alike(self) -> bool:
        """Whether one set of numbers can hold for all places: their units agree."""
        units = {tuple(self._at(item, spot).unit for item in self._own) for spot in self.spots}
        return self.role != ANYTHING and len(units) == 1

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Its parameters in this plant; `at` is the last one where there are several places."""
        own = tuple(self._at(item, self.spots[0]) for item in self._own)
        return (*own, choice(AT, self.places)) if len(self.places) > 1 else own

    @cached_property
    def _own(self) -> tuple[Parameter, ...]:
        """The effect's parameters in this role, with the plant's words."""
        found = []
        for item in self.effect.parameters:
            if item.role and item.role != self.role:
                continue
            words = self.spots[0].vocabulary.get(item.name)
            found.append(choice(item.name, words, item.source) if words else item)
        return tuple(found)

    def spots_of(self, place: float) -> tuple[Spot, ...]:
        """Return the spots that the number of a place means."""
        word = self.places[round(place)]
        return self.spots if word == EVERYWHERE else tuple(s for s in self.spots if s.name == word)

    def spots_at(self, values: Mapping[str, object]) -> tuple[Spot, ...]:
        """Return the spots where it acts, given its parameters' values (words or numbers)."""
        if len(self.places) == 1:
            return self.spots
        value = values.get(AT, 0.0)
        if isinstance(value, str):
            return self.spots_of(self.places.index(value))
        return self.spots_of(float(str(value)))

    def word(self, name: str) -> str | None:
        """Return the word of `at` that a name means, None where it means no place."""
        if name in self.places:
            return name
        return next((spot.name for spot in self.spots if name in spot.also), None)

    def place(self, values: Mapping[str, object]) -> str:
        """Return where it acts, in words."""
        spots = self.spots_at(values)
        return EVERYWHERE if len(spots) > 1 else spots[0].name

    @staticmethod
    def _at(parameter: Parameter, spot: Spot) -> Parameter:
        """Return a parameter with its unit and usual size at a spot."""
        if "{" not in parameter.unit:
            return parameter
        size = usual_size(parameter.unit, spot.usual)
        return replace(
            parameter,
            unit=unit_at_place(parameter.unit, spot.units),
            default=min(max(parameter.default * size, parameter.low), parameter.high),
        )

    def parameter_at(self, name: str, values: Mapping[str, object]) -> Parameter:
        """Return a parameter as it is where the effect acts: its unit there.

        Raises:
            PluginError: it has none of that name.
        """
        for item in self._own:
            if item.name == name:
                return self._at(item, self.spots_at(values)[0])
        return self.parameter(name)

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

    def words(self, parameter: Parameter) -> tuple[str, ...]:
        """Return the words of a choice that make sense here."""
        here = self.spots[0].words.get(parameter.name, parameter.choices)
        return self.action.choices.get(parameter.name, here)

    @cached_property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """Starting points of a search, at every place, {parameter: value}."""
        found: list[Mapping[str, float]] = []
        for number, word in enumerate(self.places):
            if word == EVERYWHERE and not (self.effect.together or self.effect.only_together):
                continue
            spot = self.spots_of(number)[0]
            for point in ({}, *self.effect.starts):
                values = {}
                for item in self._own:
                    own = self._at(item, spot)
                    share = point.get(item.name, item.default)
                    size = usual_size(item.unit, spot.usual)
                    given = share * size if item.name in point else own.default
                    if item.name in point or "{" in item.unit:
                        values[item.name] = min(max(given, item.low), item.high)
                if len(self.places) > 1:
                    values[AT] = float(number)
                if values not in found:
                    found.append(values)
        return tuple(found)

    def search_parameters(self, values: Mapping[str, object]) -> tuple[Parameter, ...]:
        """Return what a search moves, given the choices (words or places) among `values`."""
        return tuple(
            parameter
            for parameter in self.parameters
            if parameter.searched and not parameter.choices and self._matters(parameter, values)
        )

    def words_at(self, values: Mapping[str, float]) -> dict[str, str]:
        """Return the words of its choices that matter, given its numbers; its place is none."""
        return {
            item.name: str(item.decode(values[item.name]))
            for item in self.parameters
            if item.choices and item.name != AT and self._matters(item, values)
        }

    def _matters(self, parameter: Parameter, values: Mapping[str, object]) -> bool:
        name, words = parameter.when
        return not name or self._chosen_word(name, values) in words

    def equation(self, values: Mapping[str, object] | None = None) -> Equation:
        """Return the balance it acts in, given its parameters' values (words or places)."""
        given = values or {}
        action = self.action
        word = self._chosen_word(action.chosen_by, given) if action.chosen_by else ""
        own = action.equations.get(word, action.equation)
        return own if own is not None else self.spots_at(given)[0].equation

    def repeats(self, values: Mapping[str, object] | None = None) -> str:
        """Return the plant's own parameter that says the same, "" where there is none."""
        spot = self.spots_at(values or {})[0]
        return spot.parameters.get(self.action.same_as, "") if self.action.same_as else ""

    def needed(self, values: Mapping[str, object] | None = None) -> str | None:
        """Return the plant's own parameter that has to be there, "" where the place has none.

        None where nothing has to be.
        """
        spot = self.spots_at(values or {})[0]
        return spot.parameters.get(self.action.needs, "") if self.action.needs else None

    def alike(self, values: Mapping[str, object] | None = None) -> tuple[str, ...]:
        """Return the plant's own parameters that have to be declared the same, () for none."""
        spot = self.spots_at(values or {})[0]
        names = self.action.alike or ()
        return tuple(spot.parameters[name] for name in names if name in spot.parameters)

    def _chosen_word(self, name: str, values: Mapping[str, object]) -> str:
        """Return the word of a choice, given as word or place, or its default."""
        parameter = self.parameter(name)
        value = values.get(name, parameter.default)
        return value if isinstance(value, str) else str(parameter.decode(float(str(value))))


def bind_effects(effects: Sequence[Effect], spots: Spots) -> tuple[BoundEffect, ...]:
    """Return the effects that a plant has places for, in the order of their ids.

    Raises:
        PluginError: an effect acts at a hook, or has a unit, that its role does not have.
    """
    found = []
    for effect in sorted(effects, key=lambda item: item.id):
        role = next((role for role in effect.actions if spots.get(role)), None)
        if role is not None:
            _refuse_unknown_hooks(effect, role, spots[role])
            _refuse_unknown_units(effect, role, spots[role])
            found.append(BoundEffect(effect, role, tuple(spots[role])))
    return tuple(found)


def _refuse_unknown_hooks(effect: Effect, role: str, spots: Sequence[Spot]) -> None:
    for spot in spots:
        for hook in effect.actions[role].hooks:
            if hook not in spot.hooks:
                raise PluginError(
                    f"effect '{effect.id}' acts at the hook '{hook}', which the role '{role}' "
                    "does not have",
                    hint=suggest(hook, spot.hooks),
                )


def _refuse_unknown_units(effect: Effect, role: str, spots: Sequence[Spot]) -> None:
    for spot in spots:
        for item in effect.parameters:
            if item.role and item.role != role:
                continue
            try:
                unit_at_place(item.unit, spot.units)
            except PluginError as error:
                raise PluginError(
                    f"effect '{effect.id}', parameter '{item.name}': {error.what}", hint=error.hint
                ) from error


def group_of(function: Callable[..., object], name: str) -> type | None:
    """Return the NamedTuple that an argument of an effect's function is; None for a number."""
    annotation = function.__annotations__.get(name)
    kind = function.__globals__.get(annotation) if isinstance(annotation, str) else annotation
    if isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields"):
        return kind
    return None


def fields_of(group: type) -> tuple[str, ...]:
    """Return the names that a group of arguments holds."""
    return tuple(group.__annotations__)


@cache
def registered_effects() -> tuple[Effect, ...]:
    """Return all registered effects, in the order of their ids.

    Raises:
        PluginError: one of them is not an Effect.
    """
    found: list[Effect] = []
    for name in plugins.names("effects"):
        effect = plugins.load("effects", name)
        if not isinstance(effect, Effect):
            raise PluginError(f"effect '{name}' is not an Effect but {type(effect).__name__}")
        plugins.check_id("effect", name, effect.id)
        found.append(effect)
    return tuple(sorted(found, key=lambda effect: effect.id))
