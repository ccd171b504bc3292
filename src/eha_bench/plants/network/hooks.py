"""Writes the chains of effects in the places of a kernel where they act."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from eha_bench.core.errors import PluginError
from eha_bench.plants.effect import (
    AT,
    EVERYWHERE,
    POSITION_LOOP,
    BoundEffect,
    Hook,
    Spot,
    fields_of,
    group_of,
)
from eha_bench.plants.layout import Layout

_VALUE = "value"
STATES = "states"
"""Group of the effects with their own states."""
CONDUCTANCES = "conductances"
"""Group of the places where a conductance between volumes may come and go."""
_CONDUCTANCE = re.compile(r"(link|ground|[a-z_]+_slope):")
_OF_EFFECT = re.compile(r"@([a-z_]+\.[a-z_]+)")
_OWN = "own"


@dataclass(frozen=True)
class _Use:
    """A function of an effect at one place of the kernel."""

    effect: BoundEffect
    spot: Spot
    hook: Hook
    function: Callable[..., object]


class Hooks:
    """What the effects of a layout do in a kernel.

    Args:
        layout: where parameters live. first: first free place in the vector `S`.
    """

    def __init__(self, layout: Layout, first: int) -> None:
        self.layout = layout
        self.states: dict[str, int] = {}
        self._owners: dict[str, tuple[BoundEffect, Spot]] = {}
        for effect in layout.effects:
            for spot in effect.spots:
                for state in effect.effect.states:
                    key = f"{effect.id}.{state}@{spot.name}"
                    self.states[key] = first + len(self.states)
                    self._owners[key] = effect, spot
        self._order = sorted(layout.effects, key=lambda e: (e.effect.order, e.id))
        self._uses: dict[str, list[_Use]] = {}
        for effect in self._order:
            for spot in effect.spots:
                self._register(effect, spot)
        self._first_flag = first + len(self.states)
        self.flags = {
            name: self._first_flag + place
            for place, name in enumerate([*sorted(self._uses), STATES, CONDUCTANCES])
        }
        self._names: dict[str, str] = {}
        self._locals: dict[str, tuple[str, ...]] = {}
        self._also: dict[str, tuple[str, ...]] = {}
        self._imports: dict[Callable[..., object], str] = {}
        self._groups: dict[str, type] = {}

    @property
    def memory(self) -> int:
        """Places in `S` behind the last one that is used."""
        return self._first_flag + len(self.flags)

    @property
    def is_empty(self) -> bool:
        """Whether no effect acts anywhere."""
        return not self._order

    @property
    def functions(self) -> list[Callable[..., object]]:
        """All functions of effects that the kernel imports."""
        found = []
        for effect in self._order:
            action = effect.action
            found += [*action.hooks.values(), *action.advance.values(), *action.start.values()]
        return found

    def _register(self, effect: BoundEffect, spot: Spot) -> None:
        for name, function in effect.action.hooks.items():
            for hook in spot.hooks[name]:
                self._uses.setdefault(hook.at, []).append(_Use(effect, spot, hook, function))

    def uses(self, at: str) -> bool:
        """Whether any effect may act at a place."""
        return at in self._uses

    def apply(
        self, at: str, value: str, more: tuple[str, ...], also: Mapping[str, str] | None = None
    ) -> str:
        """Return the expression of a value as effects change it, or the value itself.

        Args:
            at: place. value: expression. more: local names that functions may ask for.
            also: further names -> expressions.
        """
        if at not in self._uses:
            return value
        name = self._names.setdefault(at, f"hook{len(self._names)}")
        self._locals[at] = more
        self._also[at] = tuple(also or ())
        arguments = [value, *more, *(also or {}).values(), "X", "P", "S"]
        call = f"{name}({', '.join(arguments)})"
        # further values may be views of arrays, which cost as much as a step: only where it is on
        return f"({call} if {self.is_on(at)} else {value})" if also else call

    # --- source ------------------------------------------------------------------------------

    def lines(self) -> list[str]:
        """Return the source of all hooks that `apply` was asked for, and of `activate`."""
        if self.is_empty:
            return []
        chains: list[str] = []
        for at, name in self._names.items():
            chains += self._chain(at, name)
        activate = ["", "", "@njit", "def activate(P, S):"]
        for at, place in self.flags.items():
            tests = sorted({self._guard(effect, spot) for effect, spot in self._acting(at)})
            activate.append(
                f"    S[{place}] = 1.0 if {' or '.join(f'({t})' for t in tests) or '0.0'} else 0.0"
            )
        every = [self._strong(effect) for effect in self._order]
        activate.append(f"    S[2] = 1.0 if {' or '.join(every)} else 0.0")
        imports = []
        for function, alias in self._imports.items():
            imports += [
                f"from {function.__module__} import {function.__name__} as {alias}_py",
                f"{alias} = njit({alias}_py)",
            ]
        for alias, group in self._groups.items():
            imports.append(f"from {group.__module__} import {group.__name__} as {alias}")
        return [*imports, *activate, *chains]

    def _acting(self, at: str) -> list[tuple[BoundEffect, Spot]]:
        """Return what may act at a place, or in a group of places."""
        if at == STATES:
            return [(e, spot) for e in self._order if e.action.advance for spot in e.spots]
        places = filter(_CONDUCTANCE.match, self._uses) if at == CONDUCTANCES else [at]
        return [(use.effect, use.spot) for place in places for use in self._uses[place]]

    def is_on(self, at: str) -> str:
        """Return the test for a place, or a group of places, where any effect is on."""
        return f"S[{self.flags[at]}] != 0.0"

    def advance(self) -> list[str]:
        """Return the lines that move the effects' own states on by a time `h`."""
        return self._states_lines("advance", self._order)

    def remember(self, what: str = "advance", of_loops: bool = False) -> list[str]:
        """Return the lines that `advance` or `start` states that follow from commands alone.

        Args:
            what: which. of_loops: those that follow from what controllers inside the plant are
                asked for, and not from what drives are.
        """
        return self._states_lines(what, self._remembering(of_loops))

    def _remembering(self, of_loops: bool) -> list[BoundEffect]:
        return [
            item
            for item in self._order
            if item.action.remembers and (item.role == POSITION_LOOP) is of_loops
        ]

    def is_remembering(self, of_loops: bool = False) -> str:
        """Return the test for any effect whose states follow from commands alone."""
        remembering = self._remembering(of_loops)
        tests = {self._guard(effect, spot) for effect in remembering for spot in effect.spots}
        return " or ".join(f"({test})" for test in sorted(tests))

    def start(self) -> list[str]:
        """Return the lines that set the effects' other states at the first sample."""
        others = [item for item in self._order if not item.action.remembers]
        return self._states_lines("start", others)

    def restart(self, at: str) -> list[str]:
        """Return the lines that set the states of the effects of a place as at the first sample."""
        effects = {use.effect.id: use.effect for use in self._uses.get(at, ())}
        return self._states_lines("start", list(effects.values()))

    @property
    def unread(self) -> dict[str, int]:
        """States of which nothing read says where they begin -> place in `S`."""
        return {
            key: self.states[key]
            for effect in self._order
            for spot in effect.spots
            for state in effect.action.unread
            if (key := f"{effect.id}.{state}@{spot.name}") in self.states
        }

    def _states_lines(self, what: str, effects: Sequence[BoundEffect]) -> list[str]:
        lines = []
        for effect in effects:
            functions = effect.action.advance if what == "advance" else effect.action.start
            for spot in effect.spots:
                if not functions:
                    continue
                lines.append(f"if {self._guard(effect, spot)}:")
                for state, function in functions.items():
                    place = self.states[f"{effect.id}.{state}@{spot.name}"]
                    names = inspect.signature(function).parameters
                    own = ", ".join(
                        self._argument(effect, spot, {"h": "h"}, function, n) for n in names
                    )
                    lines.append(f"    S[{place}] = {self._alias(function)}({own})")
        return lines

    def _chain(self, at: str, name: str) -> list[str]:
        more = self._locals[at]
        head = self._also[at]
        taken = ", ".join([_VALUE, *more, *head, "X", "P", "S"])
        body = []
        for use in self._uses[at]:
            known = {**{n: n for n in (*more, *head)}, **use.hook.names}
            first, *rest = inspect.signature(use.function).parameters
            own = [
                _VALUE,
                *(self._argument(use.effect, use.spot, known, use.function, n) for n in rest),
            ]
            del first
            body += [
                f"    if {self._guard(use.effect, use.spot)}:",
                f"        {_VALUE} = {self._alias(use.function)}({', '.join(own)})",
            ]
        return [
            *("", "", "@njit", f"def _{name}({taken}):", *body, f"    return {_VALUE}"),
            *("", "", "@njit", f"def {name}({taken}):"),
            f"    if S[{self.flags[at]}] != 0.0:",
            f"        return _{name}({taken})",
            f"    return {_VALUE}",
        ]

    def _alias(self, function: Callable[..., object]) -> str:
        return self._imports.setdefault(function, f"_e{len(self._imports)}")

    def _strong(self, effect: BoundEffect) -> str:
        place = self.layout.index[f"{effect.id}.{effect.strength.name}"]
        return f"P[{place}] != {effect.neutral!r}"

    def _guard(self, effect: BoundEffect, spot: Spot) -> str:
        """Return the test for an effect that is on at a spot."""
        strong = self._strong(effect)
        if len(effect.places) == 1:
            return strong
        at = self.layout.index[f"{effect.id}.{AT}"]
        here = f"P[{at}] == {float(effect.places.index(spot.name))!r}"
        if EVERYWHERE in effect.places:
            here = f"({here} or P[{at}] == {float(effect.places.index(EVERYWHERE))!r})"
        return f"{strong} and {here}"

    def _resolved(self, expression: str, effect: BoundEffect, spot: Spot) -> str:
        """Return an expression with parameters of effects, `@effect.name`, put in; 0 for none.

        `@own.name` is a state of the effect that asks, at its spot; a state of another effect, at
        the same spot, is 0 where that one is off.
        """

        def place(found: re.Match[str]) -> str:
            owner, _, name = (key := found[1]).partition(".")
            if owner == _OWN:
                state = f"{effect.id}.{name}@{spot.name}"
                return f"S[{self.states[state]}]" if state in self.states else "0.0"
            if (state := f"{key}@{spot.name}") in self.states:
                return f"(S[{self.states[state]}] if {self._guard(*self._owners[state])} else 0.0)"
            return f"P[{self.layout.index[key]}]" if key in self.layout.index else "0.0"

        return _OF_EFFECT.sub(place, expression)

    def _argument(
        self,
        effect: BoundEffect,
        spot: Spot,
        known: Mapping[str, str],
        function: Callable[..., object],
        name: str,
    ) -> str:
        """Return what an argument stands for; a NamedTuple gets each of its fields.

        Raises:
            PluginError: there is nothing of that name.
        """
        group = group_of(function, name)
        if group is not None:
            alias = f"_g_{group.__module__.replace('.', '_')}_{group.__name__}"
            self._groups[alias] = group
            fields = (
                self._argument(effect, spot, known, function, field) for field in fields_of(group)
            )
            return f"{alias}({', '.join(fields)})"
        state = f"{effect.id}.{name}@{spot.name}"
        if state in self.states:
            return f"S[{self.states[state]}]"
        key = f"{effect.id}.{name}"
        if key in self.layout.index:
            place, size = self.layout.index[key], self.layout.by_key[key].size
            return f"P[{place}]" if size == 1 else f"numba.carray(behind(P, {place}), {size})"
        if name in known:
            return self._resolved(known[name], effect, spot)
        if name in spot.names:
            return self._resolved(spot.names[name], effect, spot)
        own = (*(item.name for item in effect.parameters if item.name != AT), *effect.effect.states)
        raise PluginError(
            f"effect '{effect.id}' asks for '{name}' in {function.__name__}",
            hint=f"at {spot.name} there are: {', '.join([*known, *spot.names, *own])}",
        )
