"""A plant in Python with what may act on its signals: on its command, and in its sensors.

Its balances are its own code, so no effect acts within them. But a command may be late, a sensor
may be off or slow, and something unknown may be added to either. These effects stand around the
plant, tick by tick: what the plant is given is the command as it arrives, what is read of it is
what its sensors make of it. While all of them are off the plant is simulated as it is.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Final

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.linkage import Linkage
from eha_bench.plants.channel_roles import ChannelRoles
from eha_bench.plants.effect import (
    ANYTHING,
    BoundEffect,
    Effect,
    Equation,
    Hook,
    Spot,
    bind_effects,
    fields_of,
    group_of,
)
from eha_bench.plants.layout import Layout
from eha_bench.plants.plant import Drive, Plant
from eha_bench.plants.static_plant import StaticPlant

Scope = dict[str, Any]

_USUAL: Final = 1.0
"""A reading, or a command without a limit, that matters, in its SI unit."""


def with_signals(plant: Plant, effects: Iterable[Effect]) -> Plant:
    """Return a plant with the effects on its signals; one that has its own effects as it is.

    So is one that is not simulated moment by moment: nothing can act on its command.
    """
    apart = isinstance(plant, StaticPlant) or type(plant).advance is Plant.advance
    return plant if apart or plant.layout.effects else SignalPlant(plant, effects)


@dataclass(frozen=True)
class _Acting:
    """An effect that is on, at one place.

    Attributes:
        effect: it. channel: what it acts on. values: its parameters. states: name -> place in the
            memory.
    """

    effect: BoundEffect
    channel: str
    values: Mapping[str, Any]
    states: Mapping[str, int]


class SignalPlant(Plant):
    """A plant within the effects on its command and its sensors.

    Args:
        inner: without any effect, and simulated moment by moment.
        effects: all that there are.
    """

    def __init__(self, inner: Plant, effects: Iterable[Effect]) -> None:
        self.inner = inner
        self.id, self.outputs, self.states = inner.id, inner.outputs, inner.states
        self.state_places, self.inputs, self.command = (
            inner.state_places, inner.inputs, inner.command,
        )  # fmt: skip
        self.references, self.resting_inputs = inner.references, inner.resting_inputs
        self.derived_channels = inner.derived_channels
        self.can_lock, self.has_bypass = inner.can_lock, inner.has_bypass
        own = inner.layout
        self._size = own.size
        known = ("time", *self.outputs, *(n for n in self.inputs if n not in self.outputs))
        spots = {
            "command_path": tuple(self._command_spots()),
            "sensor": tuple(self._sensor_spots()),
            ANYTHING: tuple(self._unknown_spots(known)),
        }
        self.layout = Layout(
            own.plant, own.parameters, bind_effects(tuple(effects), spots), synonyms=own.synonyms
        )
        self._variables = known

    # --- where something may act -------------------------------------------------------------

    def _command_spots(self) -> Iterator[Spot]:
        if self.command:
            hooks = {"command": (Hook(f"command:{self.command}"),)}
            unit = self.inner.units.get(self.command, "")
            yield Spot(self.command, Equation.ACTUATION, hooks, units={"command": unit})

    def _sensor_spots(self) -> Iterator[Spot]:
        units = self.inner.units
        for name in self.outputs:
            hooks = {
                "reading": (Hook(f"reading:{name}"),),
                "initial": (Hook(f"initial:{name}"),),
            }
            yield Spot(
                name, Equation.MEASUREMENT, hooks, units={"reading": units.get(name, "")},
                usual={"reading": _usual_reading(units.get(name, ""))}, sensors=(name,),
            )  # fmt: skip

    def _unknown_spots(self, known: tuple[str, ...]) -> Iterator[Spot]:
        empty: dict[str, tuple[Hook, ...]] = dict.fromkeys(
            ("added", "taken", "changed", "torque", "level", "delivered"), ()
        )
        words = {"variable": known}
        if self.command:
            yield Spot(
                f"{self.command}.drive", Equation.ACTUATION,
                {**empty, "changed": (Hook(f"command:{self.command}"),)},
                usual={"size": _USUAL}, vocabulary=words,
                follows={"additive": known},
            )  # fmt: skip
        for name in self.outputs:
            follows = ("time", name)
            yield Spot(
                f"{name}.sensor", Equation.MEASUREMENT,
                {**empty, "changed": (Hook(f"reading:{name}"),)},
                usual={"size": _USUAL}, vocabulary=words,
                follows={"additive": follows, "gain": follows}, sensors=(name,),
            )  # fmt: skip

    # --- simulation --------------------------------------------------------------------------

    def simulate(self, vector: FloatArray, drive: Drive, step: float) -> FloatArray:
        """Return what the sensors would read, (n, outputs), SI."""
        if not self._acting(vector):
            return self.inner.simulate(vector[: self._size], drive, step)
        return super().simulate(vector, drive, step)

    def start(
        self, vector: FloatArray, initial: Mapping[str, float]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the state behind what the sensors read first, and the memory of all."""
        behind = dict(initial)
        for item in reversed(self._acting(vector)):
            if item.channel in behind and "initial" in item.effect.action.hooks:
                function = item.effect.action.hooks["initial"]
                scope = {**item.values, "value": behind[item.channel]}
                behind[item.channel] = float(_call(function, scope))
        state, memory = self.inner.start(vector[: self._size], behind)
        return state, np.concatenate((memory, np.zeros(self._own_memory)))

    def advance(
        self,
        first: int,
        last: int,
        time: FloatArray,
        inputs: FloatArray,
        locked: bool,
        bypass_open: bool,
        step: float,
        fresh: bool,
        vector: FloatArray,
        memory: FloatArray,
        state: FloatArray,
        out: FloatArray,
    ) -> None:
        """Go on as `Plant.advance` does."""
        size = memory.size - self._own_memory
        inner, own, parameters = memory[:size], memory[size:], vector[: self._size]
        acting = self._acting(vector)
        if not acting:
            self.inner.advance(
                first, last, time, inputs, locked, bypass_open, step, fresh, parameters, inner,
                state, out,
            )  # fmt: skip
            return
        given, true = inputs.copy(), np.empty_like(out)
        # the row that is gone on from is read again: what its sensors made of it is in the memory
        is_first = fresh
        for k in range(first, last + 1):
            self.inner.advance(
                k,
                k,
                time,
                given,
                locked,
                bypass_open,
                step,
                is_first,
                parameters,
                inner,
                state,
                true,
            )
            self._read(acting, own, k, time, inputs, true[k], out[k], fresh=is_first)
            if k == last:
                return
            self._command(acting, own, k, time, inputs, given, true[k], fresh=is_first)
            self.inner.advance(
                k, k + 1, time, given, locked, bypass_open, step, False, parameters, inner, state,
                true,
            )  # fmt: skip
            is_first = False

    def _read(
        self,
        acting: tuple[_Acting, ...],
        own: FloatArray,
        k: int,
        time: FloatArray,
        inputs: FloatArray,
        true: FloatArray,
        out: FloatArray,
        *,
        fresh: bool,
    ) -> None:
        """Write what the sensors make of a row."""
        out[:] = true
        seen = own[self._readings_start : self._readings_start + true.size]
        since = float(time[k] - own[self._seen_at])
        for item in acting:
            if item.channel not in self.outputs:
                continue
            place = self.outputs.index(item.channel)
            scope: Scope = {**item.values, **self._follows(item, time[k], true, inputs[k])}
            scope |= {"value": float(true[place]), "before": float(seen[place]), "h": since}
            action = item.effect.action
            laws = action.start if fresh else action.advance if since > 0.0 else {}
            scope |= {name: float(own[at]) for name, at in item.states.items()}
            for name, law in laws.items():
                own[item.states[name]] = scope[name] = float(_call(law, scope))
            for hook in ("reading", "changed"):
                if hook in action.hooks and item.channel in self.outputs:
                    scope["value"] = float(out[place])
                    out[place] = float(_call(action.hooks[hook], scope))
        seen[:] = true
        own[self._seen_at] = time[k]

    def _command(
        self,
        acting: tuple[_Acting, ...],
        own: FloatArray,
        k: int,
        time: FloatArray,
        inputs: FloatArray,
        given: FloatArray,
        true: FloatArray,
        *,
        fresh: bool,
    ) -> None:
        """Write the command as it arrives in the row from which the plant goes on."""
        given[k : k + 2] = inputs[k : k + 2]
        place = self.inputs.index(self.command) if self.command else 0
        value = float(inputs[k, place])
        for item in acting:
            if item.channel != self.command or item.channel in self.outputs:
                continue
            action = item.effect.action
            scope: Scope = {**item.values, **self._follows(item, time[k], true, inputs[k])}
            scope |= {
                "k": k, "t": float(time[k]), "h": float(time[k + 1] - time[k]), "times": time,
                "commands": inputs[:, place], "asked": value, "value": value,
                "current": float(inputs[max(k - 1, 0), place]),
            }  # fmt: skip
            if fresh:
                for name, law in action.start.items():
                    own[item.states[name]] = float(_call(law, scope))
            scope |= {name: float(own[at]) for name, at in item.states.items()}
            for hook in ("command", "changed"):
                if hook in action.hooks:
                    value = float(_call(action.hooks[hook], scope))
            for name, law in action.advance.items():
                own[item.states[name]] = float(_call(law, scope))
        given[k, place] = value

    def _follows(
        self, item: _Acting, now: float, true: FloatArray, inputs: FloatArray
    ) -> Mapping[str, float]:
        """Return the value of the variable that a learned curve follows."""
        if item.effect.role != ANYTHING:
            return {}
        name = self._variables[round(item.values["variable"])]
        if name == "time":
            return {"u": float(now)}
        if name in self.outputs:
            return {"u": float(true[self.outputs.index(name)])}
        return {"u": float(inputs[self.inputs.index(name)])}

    # --- what is on --------------------------------------------------------------------------

    @cached_property
    def _state_places(self) -> dict[tuple[str, str], dict[str, int]]:
        """Effect and channel -> places of its states in the own part of the memory."""
        places: dict[tuple[str, str], dict[str, int]] = {}
        at = 0
        for effect in self.layout.effects:
            for spot in effect.spots:
                names = effect.effect.states
                places[effect.id, spot.name] = {name: at + n for n, name in enumerate(names)}
                at += len(names)
        return places

    @property
    def _readings_start(self) -> int:
        """Place in the own memory from which the last true readings are kept."""
        return sum(len(item) for item in self._state_places.values())

    @property
    def _seen_at(self) -> int:
        return self._readings_start + len(self.outputs)

    @property
    def _own_memory(self) -> int:
        return self._seen_at + 1

    def _acting(self, vector: FloatArray) -> tuple[_Acting, ...]:
        """Return the effects that are on, in the order in which they act."""
        index = self.layout.index
        found = []
        for effect in sorted(self.layout.effects, key=lambda item: item.effect.order):
            at = index[f"{effect.id}.{effect.strength.name}"]
            if vector[at] == effect.neutral:
                continue
            values: dict[str, Any] = {}
            for item in effect.parameters:
                place = index[f"{effect.id}.{item.name}"]
                number = vector[place : place + item.size]
                values[item.name] = number if item.size > 1 else float(number[0])
            for spot in effect.spots_at(values):
                channel = spot.name.removesuffix(".sensor").removesuffix(".drive")
                states = self._state_places[effect.id, spot.name]
                found.append(_Acting(effect, channel, values, states))
        return tuple(found)

    # --- what the plant itself says ----------------------------------------------------------

    @property
    def roles(self) -> ChannelRoles:
        """What its channels are."""
        return self.inner.roles

    @property
    def units(self) -> Mapping[str, str]:
        """SI unit of every channel."""
        return self.inner.units

    def rest(self, vector: FloatArray) -> Mapping[str, float]:
        """Return the states that are not 0 at rest."""
        return self.inner.rest(vector[: self._size])

    def command_limit(self, vector: FloatArray) -> float:
        """Return the largest command that the plant follows."""
        return self.inner.command_limit(vector[: self._size])

    def position_range(self, vector: FloatArray) -> Mapping[str, tuple[float, float]]:
        """Return the channels that are positions, with their ends."""
        return self.inner.position_range(vector[: self._size])

    def linkage(self, vector: FloatArray) -> Linkage | None:
        """Return the triangle of links that the rod moves a joint with."""
        return self.inner.linkage(vector[: self._size])

    def resting_values(self, vector: FloatArray) -> Mapping[str, float]:
        """Return what inputs are where they are not given."""
        return self.inner.resting_values(vector[: self._size])

    def determined(self, inputs: Collection[str]) -> tuple[str, ...]:
        """Return the outputs that these inputs determine."""
        return self.inner.determined(inputs)

    def at_rest(self, measured: Mapping[str, float]) -> dict[str, float]:
        """Return states that have no reading, as those that have one tell them."""
        return self.inner.at_rest(measured)

    def behind(self, vector: FloatArray, readings: Mapping[str, float]) -> dict[str, float]:
        """Return states that other readings tell of."""
        return self.inner.behind(vector[: self._size], readings)

    def derived(
        self, vector: FloatArray, outputs: Mapping[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """Return channels that follow from the outputs alone."""
        return self.inner.derived(vector[: self._size], outputs)


def _usual_reading(unit: str) -> float:
    """Return a reading that matters, in its unit: of one that is a few per cent off."""
    return {"Pa": 1e7, "m": 0.05, "N": 1e3, "rad/s": 10.0, "K": 50.0}.get(unit, _USUAL)


@cache
def _arguments_of(function: Callable[..., object]) -> tuple[tuple[str, type | None], ...]:
    """Return a function's arguments, each with the tuple of names that it stands for, or None."""
    plain = getattr(function, "py_func", function)
    return tuple((name, group_of(plain, name)) for name in inspect.signature(plain).parameters)


def _call(function: Callable[..., Any], scope: Mapping[str, Any]) -> Any:
    """Call an effect's function with what its arguments name."""
    given = []
    for number, (name, several) in enumerate(_arguments_of(function)):
        if several is not None:
            given.append(several(*(scope[field] for field in fields_of(several))))
        elif number == 0 and name not in scope:
            given.append(scope["value"])
        else:
            given.append(scope[name])
    return function(*given)
