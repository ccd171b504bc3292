"""A plant that is a network, compiled with all effects that it has places for."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, permutations
from types import ModuleType

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray
from eha_bench.core.errors import InputError
from eha_bench.core.linkage import Linkage
from eha_bench.plants.channel_roles import ChannelRoles
from eha_bench.plants.effect import BoundEffect, Effect, bind_effects
from eha_bench.plants.layout import Layout
from eha_bench.plants.network.between import bows
from eha_bench.plants.network.channels import (
    imposable_signals,
    places_of_states,
    roles_of_channels,
    shown_motions,
    units_of_channels,
)
from eha_bench.plants.network.compiler import compiled_kernel, refuse_uncompiled
from eha_bench.plants.network.element import ElementKind, Friction, NodeKind
from eha_bench.plants.network.hooks import Hooks
from eha_bench.plants.network.integration import LANES
from eha_bench.plants.network.loosened import LoosenedPlant
from eha_bench.plants.network.network import Network
from eha_bench.plants.network.plant_file import Locate
from eha_bench.plants.network.reach import determined_nodes
from eha_bench.plants.network.rigid_joint import loosened, rigid_joints
from eha_bench.plants.network.roles import refuse_unknown_roles, roles_of, usual_effort
from eha_bench.plants.network.source import kernel_source
from eha_bench.plants.network.system import BoundElement, System
from eha_bench.plants.network.unread_states import UnreadState, unread_states
from eha_bench.plants.parameter import UNLIMITED
from eha_bench.plants.plant import Drive, Drives, ElasticPair, Parametrised, Plant

_WORTH_A_BLOCK = 3
"""Least number of sets that a sweep in step gains on."""
_ANCHORED = 0.01
"""About how often a state is set anew that a drive anchors, s."""


@dataclass(frozen=True)
class Inputs:
    """A drive's inputs as arrays.

    Attributes:
        period: of a controller inside the plant, s; 0 where none is used.
        time: (m,) the clock that the kernel runs on, s. ticks: (n,) where the samples are on it.
        values: (m, columns). given: which columns are.
        imposed: (m, states and signals, and behind them how speeds bend), no rows where nothing is.
        is_imposed: which are.
    """

    period: float
    time: FloatArray
    ticks: IndexArray
    values: FloatArray
    given: BoolArray
    imposed: FloatArray
    is_imposed: BoolArray


@dataclass(frozen=True)
class ManyInputs:
    """The inputs of many drives as arrays, their ticks one behind the other.

    Attributes:
        kinds: a drive of each set of inputs, and the period of the controller inside the plant.
        ticks: of each drive, None where every sample is one. edges: (drives + 1,) where its ticks
            begin.
        firsts: (drives,) tick of each that it starts at. times, values, imposed: of all ticks.
        given, imposes, locked, bypass_open: of each drive.
    """

    kinds: tuple[tuple[Drive, float], ...]
    ticks: tuple[IndexArray | None, ...]
    edges: IndexArray
    firsts: IndexArray
    times: FloatArray
    values: FloatArray
    imposed: FloatArray
    given: BoolArray
    imposes: BoolArray
    locked: BoolArray
    bypass_open: BoolArray


@dataclass(frozen=True)
class ElasticJoint:
    """A spring between two parts, and what shows how far it is bent.

    Attributes:
        stiffness, play: places in a vector of parameters; no play: None.
        force: channel that shows its force, "" for none. first, second: states of both positions.
    """

    stiffness: int
    play: int | None
    force: str
    first: str
    second: str

    def bent(self, vector: FloatArray, force: float) -> float:
        """Return the first position less the second one where a force is read, m (or rad)."""
        stiffness = float(vector[self.stiffness])
        if not stiffness > 0.0 or force == 0.0:
            return 0.0
        play = 0.0 if self.play is None else float(vector[self.play])
        return force / stiffness + math.copysign(0.5 * play, force)


_DRIVING = ("motor", "linear_motor", "position_servo", "pump")
"""Kinds of elements whose own part carries nothing that is changed."""


class NetworkPlant(Plant):
    """A plant as a network.

    Args:
        network: what was declared. effects: all that there are. locate: keys -> place in the file.

    Raises:
        InputError: a mistake in the network.
    """

    def __init__(
        self, network: Network, effects: Iterable[Effect], locate: Locate | None = None
    ) -> None:
        self.network = network
        self.system = system = System(network, locate)
        self.id = network.name
        synonyms = {key: slot for key, slot in system.slot_of.items() if key != slot}
        self._effects = tuple(effects)
        refuse_unknown_roles(self._effects)
        own = bind_effects(self._effects, roles_of(system))
        self.layout = Layout(self.id, system.parameters, own, synonyms=synonyms)
        self.outputs = tuple(item.channel for item in system.outputs)
        self.derived_channels = tuple(system.derived)
        self._imposable = imposable_signals(system)
        self.state_places = places_of_states(system)
        self.states = tuple(self.state_places)
        self.inputs = tuple(item.channel for item in system.columns)
        commands = [item.channel for item in system.columns if item.command is not None]
        self.command = commands[0] if commands else ""
        self.references = tuple(item.channel for item in system.columns if system.is_followed(item))
        self.imposable_motions = () if commands else shown_motions(system)
        self.resting_inputs = {
            **{item.channel: math.nan for item in system.columns if item.default == -2},
            **self.resting_values(self.layout.defaults()),
        }
        self._loose_plants: dict[tuple[str, bool], LoosenedPlant] = {}
        self.can_lock = bool(system.locked_coordinates)
        self.has_bypass = system.has_bypass
        system.refuse_underived()
        self._refuse_open_linkage()

    def _refuse_open_linkage(self) -> None:
        """Refuse a linkage whose triangle does not close where the rod begins."""
        part, vector = self._linkage_part, self.layout.defaults()
        linkage = self.linkage(vector)
        if part is None or linkage is None:
            return
        rod = self.system.leader_of(part.element.ports["on"])
        if rod.name != part.element.ports["on"]:
            raise InputError(
                f"the rod '{part.element.ports['on']}' of '{part.name}' follows '{rod.name}'",
                where=self.system.locate("elements", part.name, "on"),
                hint="declare the gear or the spindle the other way round: from the shaft to the "
                "rod",
            )
        low, high = self._ends(vector, rod.number, linkage)
        position = 0.0 if low <= 0.0 <= high else 0.5 * (low + high)
        if math.isnan(linkage.angle_at(position)):
            length = float(linkage.length(np.asarray(position)))
            shortest, longest = abs(linkage.a - linkage.b), linkage.a + linkage.b
            raise InputError(
                f"the links of '{part.name}' form no triangle: with the rod at "
                f"{position * 1e3:.4g} mm the actuator is {length * 1e3:.4g} mm long, and they "
                f"allow {shortest * 1e3:.4g} to {longest * 1e3:.4g} mm",
                where=self.system.locate("elements", part.name),
                hint="link_length is the length between the pins at the rod's position 0; with "
                "link_c0 half the stroke (volume_a / area_a) is added to it",
            )

    @property
    def changed_between_runs(self) -> tuple[str, ...]:
        """Parameters that people change from one recording to the next: loads, bolted masses.

        What is bolted on is declared as an element, or else with the part that carries it, which no
        motor and no pump drives by itself.
        """
        slots, parts = self.system.slot_of, self.system.parts.values()
        kept = {
            part.element.ports.get("on")
            for part in parts
            if part.element.kind.id in _DRIVING or "mass" in part.element.kind.changed_between_runs
        }
        nodes = (name for name in self.network.nodes if name not in kept)
        own = (f"{name}.{key}" for name in nodes for key in ("inertia", "mass"))
        carried = (slots[key] for key in own if key in slots)
        return tuple(
            dict.fromkeys((*self._slots_of(lambda kind: kind.changed_between_runs), *carried))
        )

    @property
    def changed_by_warmth(self) -> tuple[str, ...]:
        """Parameters that change as a machine warms up: friction, leakage."""
        return self._slots_of(lambda kind: kind.changed_by_warmth)

    def _slots_of(self, names_of: Callable[[ElementKind], tuple[str, ...]]) -> tuple[str, ...]:
        """Return keys of those parameters of all elements that are declared, by their names."""
        slots = self.system.slot_of
        keys = (
            f"{part.name}.{name}"
            for part in self.system.parts.values()
            for name in names_of(part.element.kind)
        )
        return tuple(dict.fromkeys(slots[key] for key in keys if key in slots))

    @cached_property
    def roles(self) -> ChannelRoles:
        """What its channels are."""
        shown = {of for of, _ in self.network.channels.values()}
        return roles_of_channels(self.system, shown, self.state_places, self.units)

    @property
    def units(self) -> Mapping[str, str]:
        """SI unit of every output, derived channel, state and input."""
        return units_of_channels(self.system, self.state_places)

    # --- kernels -----------------------------------------------------------------------------

    @cached_property
    def _hooks(self) -> Hooks:
        return Hooks(self.layout, self._first_memory)

    @property
    def _first_memory(self) -> int:
        return self.system.memory

    @cached_property
    def compiled(self) -> ModuleType:
        """The kernel with all effects, compiled on first use."""
        return self._compile(self.system, self.layout)

    @cached_property
    def bare(self) -> Layout:
        """The layout without any effect; its parameters are the first of every vector."""
        full = self.layout
        return Layout(full.plant, full.parameters, synonyms=full.synonyms)

    @cached_property
    def _bare_compiled(self) -> ModuleType:
        """The kernel without effects: bit for bit what the full one computes while all are off."""
        return self._compile(self.system, self.bare)

    def check(self) -> None:
        """Write the kernel and compile none of it, which shows what plug-ins ask for in vain.

        Raises:
            PluginError: a law or an effect's function asks for what there is not, or calls a
                function that is not compiled.
        """
        refuse_uncompiled(self._kernel_source(self.system, self.layout)[1])

    def weightless(self, vector: FloatArray) -> tuple[str, tuple[str, ...]] | None:
        """Return a node that declared inertias make weigh nothing, and their parameters, or None.

        Its acceleration would be infinite. A node without any inertia, whose motion is measured,
        is none; nor is one that moves with another which has some.
        """
        index, hooked = self.layout.index, self._inertias_by_effects(vector)
        for item in self.system.coordinates:
            found = self.system.declared_inertia(item, lambda key: float(vector[index[key]]))
            if found.keys and found.inertia == 0.0 and item.name not in hooked:
                return found.node, found.keys
        return None

    def _inertias_by_effects(self, vector: FloatArray) -> set[str]:
        """Return the nodes to whose inertia an effect adds that is not off."""
        return {
            hook.at.partition(":")[2]
            for effect in self.layout.effects
            if vector[self.layout.index[f"{effect.id}.{effect.strength.name}"]] != effect.neutral
            for spot in effect.spots
            for name in effect.action.hooks
            for hook in spot.hooks[name]
            if hook.at.startswith("inertia:")
        }

    def _compile(self, system: System, layout: Layout) -> ModuleType:
        return compiled_kernel(self.id, *self._kernel_source(system, layout))

    def _kernel_source(
        self, system: System, layout: Layout
    ) -> tuple[str, list[Callable[..., object]]]:
        """Return the kernel's source, and the functions that it imports."""
        hooks = Hooks(layout, self._first_memory)
        text = kernel_source(system, hooks)
        return text, [*system.laws, *hooks.functions]

    @cached_property
    def _strengths(self) -> tuple[IndexArray, FloatArray]:
        """Places of the strengths of all effects that need the full kernel, and neutral values."""
        effects = [effect for effect in self.layout.effects if effect.action.hooks]
        places = [self.layout.index[f"{effect.id}.{effect.strength.name}"] for effect in effects]
        return np.array(places, dtype=np.intp), np.array([effect.neutral for effect in effects])

    @cached_property
    def _adjusting(self) -> tuple[BoundEffect, ...]:
        return tuple(effect for effect in self.layout.effects if effect.action.adjusts)

    def adjusted_vector(self, vector: FloatArray) -> FloatArray:
        """Return a vector with the plant's parameters as effects adjust them."""
        out = vector
        index = self.layout.index
        for effect in self._adjusting:
            if vector[index[f"{effect.id}.{effect.strength.name}"]] == effect.neutral:
                continue
            out = vector.copy() if out is vector else out
            own = {
                item.name: float(vector[index[f"{effect.id}.{item.name}"]])
                for item in effect.parameters
            }
            for spot in effect.spots_at(own):
                for name, function in effect.action.adjusts.items():
                    if name in spot.parameters:
                        place = index[spot.parameters[name]]
                        wanted = list(
                            function.__code__.co_varnames[: function.__code__.co_argcount]
                        )
                        out[place] = function(float(out[place]), *(own[n] for n in wanted[1:]))
        return out

    def kernel_for(self, vector: FloatArray) -> tuple[ModuleType, FloatArray, FloatArray]:
        """Return the fastest kernel for some parameters, and its own vectors `P` and `S`."""
        places, neutral = self._strengths
        vector = self.adjusted_vector(vector)
        if places.size and (vector[places] != neutral).any():
            return self.compiled, vector, np.zeros(self._hooks.memory)
        return self._bare_compiled, vector[: self.bare.size], np.zeros(self._first_memory + 1)

    def unread_states(self, vector: FloatArray) -> dict[str, UnreadState]:
        """Return the states of effects that are on of which nothing read says where they begin."""
        return unread_states(self.layout, vector, self._hooks.unread)

    # --- joints that give way ----------------------------------------------------------------

    @cached_property
    def _couplings(self) -> tuple[tuple[BoundEffect, int], ...]:
        """Effects that set a coupling in a joint, with the places of their strengths."""
        index = self.layout.index
        return tuple(
            (effect, index[f"{effect.id}.{effect.strength.name}"])
            for effect in self.layout.effects
            if effect.action.couples
        )

    def _coupled(self, vector: FloatArray) -> BoundEffect | None:
        """Return the effect by which a joint gives way with these parameters, None for none."""
        return next(
            (effect for effect, place in self._couplings if vector[place] != effect.neutral), None
        )

    def _loosened(self, name: str, *, beyond: bool) -> LoosenedPlant:
        """Return the plant with a joint of that name that gives way; kept."""
        if (name, beyond) not in self._loose_plants:
            joint = next(item for item in rigid_joints(self.system) if item.name == name)
            item = self.system.leader_of(joint.node)
            names = {place: name for name, place in self.state_places.items()}
            read = names[item.speed], names[item.position]
            network = loosened(self.network, joint, joint.end if beyond else joint.node, read)
            self._loose_plants[name, beyond] = LoosenedPlant(
                self,
                NetworkPlant(network, self._effects),
                joint,
                usual_effort(self.system, item),
                read,
                beyond=beyond,
            )
        return self._loose_plants[name, beyond]

    # --- simulation --------------------------------------------------------------------------

    def at(self, vector: FloatArray) -> Parametrised:
        """Return the plant with its parameters set, for many simulations with them."""
        effect = self._coupled(vector)
        if effect is None or effect.action.couples is None:
            return _Fastest(self, vector)
        own = {
            item.name: float(vector[self.layout.index[f"{effect.id}.{item.name}"]])
            for item in effect.parameters
        }
        names = effect.action.couples
        loose = self._loosened(effect.place(own), beyond=own[names.sensors] != 0.0)
        return loose.at(
            vector, own[names.compliance], own[names.damping_time], own.get(names.play, 0.0)
        )

    def simulate(self, vector: FloatArray, drive: Drive, step: float) -> FloatArray:
        """Return what the sensors would read: (n, outputs), SI.

        Raises:
            InputError: an input or a first value that this plant does not have.
        """
        return self.at(vector).simulate(drive, drive.initial, step)

    def start(
        self, vector: FloatArray, initial: Mapping[str, float]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the state vector behind what the sensors read first, and a memory."""
        return self.at(vector).start(initial)

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
        """Go on from moment `first` to moment `last`, as `Plant.advance` says."""
        self.at(vector).advance(
            first, last, time, inputs, locked, bypass_open, step, fresh, memory, state, out
        )

    def start_state(
        self,
        initial: Mapping[str, float],
        kernel: ModuleType,
        parameters: FloatArray,
        memory: FloatArray,
    ) -> FloatArray:
        """Return the state behind what the sensors read first; the rest is at rest.

        Raises:
            InputError: a channel that is not a state of this plant.
        """
        state, read = self._as_read([initial], parameters)
        shown = np.zeros(self.system.size + 1)
        kernel.settle(read[0], parameters, memory, shown, state[0])
        self._charge(parameters, state[0], read[0])
        settled: FloatArray = state[0]
        return settled

    def _as_read(
        self, initials: Sequence[Mapping[str, float]], parameters: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return states as their sensors read them first, and which were read, a row each.

        Raises:
            InputError: a channel that is not a state of this plant.
        """
        size = self.system.size
        states = np.zeros((len(initials), size + len(self._imposable)))
        states[:, size:] = self._resting_signals
        pressures, places = self._resting_pressures
        states[:, pressures] = parameters[places]
        read = np.zeros(states.shape, dtype=np.bool_)
        # hundreds of windows say the same few things of where they begin: a block each
        rows: dict[tuple[str, ...], list[int]] = {}
        for row, initial in enumerate(initials):
            rows.setdefault(tuple(initial), []).append(row)
        for names, own in rows.items():
            block = np.ix_(own, [self._state_place(name) for name in names])
            states[block] = [[*initials[row].values()] for row in own]
            read[block] = True
        return states, read

    def _state_place(self, name: str) -> int:
        """Return the place of a state.

        Raises:
            InputError: there is none of that name.
        """
        place = self.state_places.get(name)
        if place is None:
            raise InputError(
                f"'{name}' is not a state of {self.id}",
                hint=f"it has: {', '.join(self.states)}",
            )
        return place

    @cached_property
    def _resting_pressures(self) -> tuple[IndexArray, IndexArray]:
        """Places of the volumes' pressures in the state, and of what they are at rest in `P`."""
        system = self.system
        states = [volume.pressure for volume in system.volumes]
        places = [system.index[system.slot_of[f"{item.name}.pressure"]] for item in system.volumes]
        return np.array(states, dtype=np.intp), np.array(places, dtype=np.intp)

    @cached_property
    def _resting_signals(self) -> FloatArray:
        """What signals that a channel may set are where nothing was read: NaN for as commanded."""
        commanded = {item.signal for item in self.system.columns if item.command is not None}
        return np.array([0.0 if signal in commanded else math.nan for _, signal in self._imposable])

    def _charge(self, parameters: FloatArray, state: FloatArray, read: BoolArray) -> None:
        """Set pressures that follow from how much oil a closed circuit holds."""
        system = self.system
        for part, other in self._closed_circuits:
            volume = system.volume_of[part.element.ports["on"]]
            if read[volume.pressure]:
                continue

            def value(of: str, name: str) -> float:
                return float(parameters[system.index[system.slot_of[f"{of}.{name}"]]])

            rod = system.leader_of(system.parts[other].element.ports["on"])
            given = value(other, "area_a") - value(other, "area_b")
            atmosphere = value(part.name, "atmosphere")
            charge = value(part.name, "precharge") + atmosphere
            gas = value(part.name, "gas_volume")
            # oil that the cylinder takes beyond mid-stroke comes out of the gas's volume
            taken = max(gas + given * state[rod.position], 0.05 * gas)
            index = value(part.name, "polytropic_index")
            state[volume.pressure] = charge * (gas / taken) ** index - atmosphere

    @cached_property
    def _closed_circuits(self) -> tuple[tuple[BoundElement, str], ...]:
        """What holds the oil of a closed circuit, each with the cylinder at whose mid-stroke."""
        parts = self.system.parts.values()
        named = ((part, part.element.refers.get("mid_stroke_of")) for part in parts)
        return tuple((part, other) for part, other in named if other is not None)

    # --- sweeps ------------------------------------------------------------------------------

    def sweep(self, vectors: FloatArray, drive: Drive, step: float) -> FloatArray:
        """Return what `simulate` does for each row of parameters: (m, n, outputs), SI.

        Sets without effects and without friction that creeps go through SIMD registers several at a
        time, which differs from `simulate` by rounding only; the rest one by one.

        Raises:
            InputError: as `simulate`.
        """
        out = np.empty((len(vectors), drive.time.size, len(self.outputs)))
        adjusted = [self.adjusted_vector(vector) for vector in vectors]
        rows = [row for row, vector in enumerate(adjusted) if self._goes_in_step(vector)]
        sweep = None
        if len(rows) >= _WORTH_A_BLOCK and self._drives_in_step(drive, adjusted[rows[0]]):
            sweep = self.sweep_kernel
        if sweep is None:
            rows = []
        for row in sorted(set(range(len(vectors))) - set(rows)):
            out[row] = self.simulate(vectors[row], drive, step)
        for first in range(0, len(rows), LANES):
            block = rows[first : first + LANES]
            assert sweep is not None
            out[block] = self._in_step(sweep, [adjusted[row] for row in block], drive, step)
        return out

    def _goes_in_step(self, vector: FloatArray) -> bool:
        """Whether a set has no effects on, no friction that creeps, and no springs."""
        if self.system.has_springs:
            return False  # the step that resolves them differs from lane to lane
        if self._coupled(vector) is not None:
            return False
        places, neutral = self._strengths
        return bool((vector[places] == neutral).all() and (vector[self._creeps] <= 0.0).all())

    @cached_property
    def _creeps(self) -> IndexArray:
        """Places of the speeds over which frictions creep."""
        system = self.system
        keys = [
            f"{part.name}.{term.creep}"
            for item in system.coordinates
            for part, term, _ in system.terms(item, Friction)
            if term.creep
        ]
        return np.array([system.index[system.slot_of[key]] for key in keys], dtype=np.intp)

    def _drives_in_step(self, drive: Drive, vector: FloatArray) -> bool:
        """Whether nothing is imposed, and no controller inside the plant is used."""
        inputs = self.inputs_of(drive, vector)
        return not inputs.is_imposed.any() and inputs.period == 0.0

    @cached_property
    def sweep_kernel(self) -> Callable[..., None] | None:
        """The kernel of sweeps, compiled on first use; None where it cannot be vectorised."""
        from eha_bench.plants.network.lanes import sweep_source

        scalar = self._bare_compiled
        hooks = Hooks(self.bare, self._first_memory)
        text = sweep_source(self.system, hooks, scalar.__name__, self.bare.size)
        if text is None:
            return None
        kernel = compiled_kernel(self.id, text, [*self.system.laws], "sweep")
        sweep: Callable[..., None] = kernel.sweep
        return sweep

    def _in_step(
        self, sweep: Callable[..., None], vectors: list[FloatArray], drive: Drive, step: float
    ) -> FloatArray:
        """Return (m, n, outputs) for at most as many sets as there are lanes."""
        inputs = self.inputs_of(drive, vectors[0])
        first, count = int(inputs.ticks[drive.first]), len(self.outputs)
        # lanes that are left over repeat the last set
        spread = [vectors[min(lane, len(vectors) - 1)] for lane in range(LANES)]
        parameters = np.stack([vector[: self.bare.size] for vector in spread])
        memories = np.zeros((LANES, self._first_memory + 1))
        states = np.zeros((LANES, self.system.size + len(self._imposable)))
        out = np.full((drive.time.size, count * LANES), np.nan)
        begin, shown = self._bare_compiled, np.zeros(self.system.size + 1)
        for lane, own in enumerate(parameters):
            states[lane] = self.start_state(drive.initial, begin, own, memories[lane])
            # the scalar kernel's first tick sets the signals
            begin.simulate(
                first, first, inputs.time, inputs.values, inputs.given, inputs.imposed,
                inputs.is_imposed, drive.locked, drive.bypass_open, step, True, own,
                memories[lane], shown, states[lane], np.empty((first + 1, count)),
            )  # fmt: skip
        sweep(
            first, inputs.time, inputs.values, inputs.given, drive.locked, step, parameters,
            memories, states, out,
        )  # fmt: skip
        return out.reshape(-1, count, LANES).transpose(2, 0, 1)[: len(vectors)]

    # --- inputs ------------------------------------------------------------------------------

    def inputs_of(self, drive: Drive, vector: FloatArray) -> Inputs:
        """Return a drive's inputs as the kernels take them, laid out once.

        Raises:
            InputError: an input that this plant does not have.
        """
        kept = drive.laid_out[f"{self.id}:{id(self)}"] = self._own_inputs(drive, vector)
        return kept

    def _own_inputs(self, drive: Drive, vector: FloatArray) -> Inputs:
        """Return a drive's inputs as they were laid out, or laid out now and not kept."""
        period = self._period(drive, vector)
        kept = drive.laid_out.get(f"{self.id}:{id(self)}")
        if isinstance(kept, Inputs) and kept.period == period:
            return kept
        return self._laid_out(drive, period)

    def inputs_of_each(self, drives: Drives, vector: FloatArray) -> ManyInputs:
        """Return the inputs of several drives, laid out once.

        Raises:
            InputError: an input that this plant does not have.
        """
        key = f"{self.id}:{id(self)}"
        kept = drives.laid_out.get(key)
        if not isinstance(kept, ManyInputs) or any(
            self._period(drive, vector) != period for drive, period in kept.kinds
        ):
            # once together is enough: each by itself would be all of it again
            each = [self._own_inputs(drive, vector) for drive in drives.items]
            kept = drives.laid_out[key] = _one_behind_the_other(each, drives.items)
        return kept

    def _period(self, drive: Drive, vector: FloatArray) -> float:
        """Return the period of the controller inside the plant that is used, s; 0 for none."""
        system = self.system
        for name, (part, loop, driven, command) in system.loops.items():
            place = system.signals[f"{name}.{loop.reference}"]
            asked = [c.channel for c in system.columns if c.part is part and c.signal == place]
            own = system.columns[system.column_for(driven, command)].channel
            if asked and asked[0] in drive.inputs:
                if own in drive.inputs:
                    raise InputError(
                        f"{self.id} takes either '{own}' (open loop) or '{asked[0]}' (closed loop)",
                        hint="name one of them under inputs",
                    )
                return float(vector[system.index[system.slot_of[f"{name}.{loop.period}"]]])
            known = set(drive.inputs) <= {*system.column_of, *self.states}
            if own not in drive.inputs and known and not set(drive.inputs) & set(self.states):
                raise InputError(
                    f"{self.id} needs either '{own}' (open loop) or "
                    f"'{asked[0] if asked else loop.reference}' (closed loop)",
                    hint="name one of them under inputs",
                )
            more = system.signals[f"{name}.{loop.added}"]
            for column in system.columns:
                if column.part is part and column.signal == more and column.channel in drive.inputs:
                    raise InputError(
                        f"'{column.channel}' is part of '{own}' already",
                        hint=f"name '{asked[0] if asked else 'the reference'}' and "
                        f"'{column.channel}' under inputs for the closed loop",
                    )
        return 0.0

    def _laid_out(self, drive: Drive, period: float) -> Inputs:
        system = self.system
        time, ticks = _controller_clock(drive.time, period) if period > 0.0 else _same(drive.time)
        n = time.size
        values = np.zeros((n, len(system.columns)))
        given = np.zeros(len(system.columns), dtype=np.bool_)
        count = system.size + len(self._imposable)
        # a kernel reads what is imposed, and most often nothing is: then there are no rows
        imposes = any(name in self.state_places for name in drive.inputs)
        imposed = np.zeros((n if imposes else 0, count + system.size))
        speeds = {item.speed for item in system.coordinates}
        is_imposed = np.zeros(count, dtype=np.bool_)
        for name, series in drive.inputs.items():
            column = system.column_of.get(name)
            if column is not None:
                held = system.columns[column].held
                values[:, column] = _on_clock(np.asarray(series, dtype=np.float64), ticks, n, held)
                given[column] = True
            elif name in self.state_places:
                place = self.state_places[name]
                imposed[:, place] = _on_clock(np.asarray(series, dtype=np.float64), ticks, n, False)
                is_imposed[place] = True
                if place in speeds:
                    bow = bows(drive.time, np.asarray(series, dtype=np.float64))
                    imposed[:, [place, count + place]] += _bent(bow, ticks, n)
            else:
                known = ", ".join(dict.fromkeys((*system.column_of, *self.states)))
                raise InputError(
                    f"'{name}' cannot be an input of {self.id}", hint=f"inputs may be: {known}"
                )
        self.check_massless(is_imposed)
        return Inputs(period, time, ticks, values, given, imposed, is_imposed)

    def check_massless(self, is_imposed: BoolArray) -> None:
        """Refuse to leave a part without inertia to itself.

        Raises:
            InputError: nothing imposes the motion of such a part.
        """
        for item in self.system.coordinates:
            driven = is_imposed[item.speed] or is_imposed[item.position]
            if not driven and not self.system.inertias(item):
                name = next(n for n, place in self.state_places.items() if place == item.speed)
                raise InputError(
                    f"'{item.name}' of {self.id} has no inertia: its motion has to be an input",
                    hint=f"name '{name}' under inputs, or give the node an inertia",
                )

    # --- channels ---------------------------------------------------------------------------

    def determined(self, inputs: Collection[str]) -> tuple[str, ...]:
        """Return the outputs that these inputs determine."""
        nodes = determined_nodes(self.system, self.state_places, frozenset(inputs))
        places = {self.state_places[name] for name in inputs if name in self.state_places}
        # of what is imposed, a position follows from its rate, and nothing else follows
        still = {
            place
            for item in self.system.coordinates
            for place in (item.speed, item.position)
            if {item.speed, item.position} & places
            and not (item.speed in places and (place == item.position or item.is_rotation))
        }
        return tuple(
            item.channel
            for item in self.system.outputs
            if item.of in nodes and item.state not in still
        )

    def at_rest(self, measured: Mapping[str, float]) -> dict[str, float]:
        """Return pressures without a reading: a leak evens a volume out with its neighbour."""
        found: dict[str, float] = {}
        for known, other in self._evened_out_at_rest:
            if known in measured and other not in measured:
                found.setdefault(other, measured[known])
        return found

    @cached_property
    def _evened_out_at_rest(self) -> tuple[tuple[str, str], ...]:
        """Pressures, and others that a leak makes equal to them at rest.

        What feeds an accumulator is none of these: it holds more than a leak brings, and begins as
        declared.
        """
        system = self.system
        names = {place: name for name, place in self.state_places.items()}
        pairs = []
        for part, flow in system.flows():
            if part.element.kind.id == "laminar_leakage":
                ends = [n for n in system.ends(part, flow) if n in system.volume_of]
                for known, other in permutations(ends, 2):
                    if not system.compliances(system.volume_of[other]):
                        one, two = (names[system.volume_of[n].pressure] for n in (known, other))
                        pairs.append((one, two))
        return tuple(pairs)

    @cached_property
    def _resting_at(self) -> Mapping[str, str]:
        """Pressures -> key of the parameter that each rests at."""
        names = {place: name for name, place in self.state_places.items()}
        return {
            names[volume.pressure]: self.system.slot_of[f"{volume.name}.pressure"]
            for volume in self.system.volumes
        }

    @cached_property
    def charged_by(self) -> Mapping[str, str]:
        """Pressures -> key of the parameter that each is charged to.

        That of a closed circuit's reservoir follows from how much oil the circuit holds.
        """
        volumes = self.system.volume_of
        follow = {volumes[part.element.ports["on"]].pressure for part, _ in self._closed_circuits}
        return {
            name: key
            for name, key in self._resting_at.items()
            if self.state_places[name] not in follow
        }

    def rest(self, vector: FloatArray) -> Mapping[str, float]:
        """Return the pressures at rest, by channel, Pa."""
        index = self.system.index
        return {name: float(vector[index[key]]) for name, key in self._resting_at.items()}

    def followed_by(self, reference: str) -> str:
        """Return the position that a controller inside the plant makes follow a reference.

        "" where none does, or a gear stands between.
        """
        system = self.system
        part = system.columns[system.column_of[reference]].part
        if reference not in self.references or part is None:
            return ""
        node = part.element.ports[system.loops[part.name][1].reads]
        own = system.leader_of(node)
        names = {place: name for name, place in self.state_places.items()}
        return names[own.position] if own.name == node else ""

    def command_limit(self, vector: FloatArray) -> float:
        """Return the largest command that the plant follows, SI, either way; inf for none."""
        for column in self.system.columns:
            if column.channel == self.command and column.command and column.command.limit:
                assert column.part is not None
                key = self.system.slot_of[f"{column.part.name}.{column.command.limit}"]
                limit = float(vector[self.system.index[key]])
                return limit if limit < UNLIMITED else math.inf
        return math.inf

    def position_range(self, vector: FloatArray) -> Mapping[str, tuple[float, float]]:
        """Return the channels that are positions, with their ends, SI."""
        linkage = self.linkage(vector)
        found: dict[str, tuple[float, float]] = {}
        for item in self.system.outputs:
            for coordinate in self.system.coordinates:
                if item.state == coordinate.position:
                    found[item.channel] = self._ends(vector, coordinate.number, linkage)
        for item, coordinate in self.system.geared_channels():
            if item.quantity in ("angle", "position"):
                turns = self._turns(vector, item.of)
                low, high = sorted(
                    turns * end for end in self._ends(vector, coordinate.number, linkage)
                )
                found[item.channel] = (low, high)
        if linkage is not None:
            for channel, (node, _, _) in self.system.derived.items():
                low, high = self._ends(vector, self.system.leader_of(node).number, linkage)
                angles = linkage.angle_at(low), linkage.angle_at(high)
                # where the triangle does not close nothing ends
                found[channel] = (
                    -math.inf if math.isnan(angles[0]) else angles[0],
                    math.inf if math.isnan(angles[1]) else angles[1],
                )
        return found

    def _ends(
        self, vector: FloatArray, number: int, linkage: Linkage | None
    ) -> tuple[float, float]:
        system = self.system
        item = system.coordinates[number]
        for node in system.geared(item):
            if all(f"{node}.stroke_{end}" in system.slot_of for end in ("low", "high")):
                ratio = self._turns(vector, node)
                ends = sorted(
                    self._value(vector, node, f"stroke_{end}") / ratio for end in ("low", "high")
                )
                return ends[0], ends[1]
        if linkage is not None and linkage.half_stroke > 0.0:
            return -linkage.half_stroke, linkage.half_stroke
        for part in system.parts.values():
            if (
                part.element.kind.id == "cylinder"
                and system.leader_of(part.element.ports["on"]) is item
                # a chamber that is a reservoir has no oil of its own that could end
                and all(f"{part.name}.volume_{side}" in system.slot_of for side in ("a", "b"))
            ):
                half = min(
                    self._value(vector, part.name, f"volume_{side}")
                    / self._value(vector, part.name, f"area_{side}")
                    for side in ("a", "b")
                )
                half /= abs(self._turns(vector, part.element.ports["on"]))
                return -half, half
        return -math.inf, math.inf

    def _turns(self, vector: FloatArray, node: str) -> float:
        """Return how many times as fast as its coordinate a node moves, by the gears between."""
        return math.prod(float(vector[place]) for place in self.system.ratio_places(node))

    def _value(self, vector: FloatArray, of: str, name: str) -> float:
        return float(vector[self.system.index[self.system.slot_of[f"{of}.{name}"]]])

    def hanging_weight(self, vector: FloatArray, node: str) -> float:
        """Return the largest torque of the pendulums on a node, m g l, N*m."""
        return sum(
            math.prod(self._value(vector, part.name, key) for key in ("mass", "gravity", "length"))
            for part in self.system.parts.values()
            if part.element.kind.id == "pendulum" and part.element.ports["on"] == node
        )

    def linkage(self, vector: FloatArray) -> Linkage | None:
        """Return the triangle of links that the rod moves a joint with, None for none."""
        part = self._linkage_part
        if part is None:
            return None
        a, b = (self._value(vector, part.name, name) for name in ("link_a", "link_b"))
        if f"{part.name}.link_length" in self.system.slot_of:
            return Linkage(a, b, self._value(vector, part.name, "link_length"), 0.0)
        cylinder = part.element.refers["cylinder"]
        volume = self._value(vector, cylinder, "volume_a")
        half = volume / self._value(vector, cylinder, "area_a")
        return Linkage(a, b, self._value(vector, part.name, "link_c0"), half)

    @cached_property
    def _linkage_part(self) -> BoundElement | None:
        """The links between the rod and a joint, None for none."""
        parts = self.system.parts.values()
        return next((part for part in parts if part.element.kind.id == "knee_linkage"), None)

    def behind(self, vector: FloatArray, readings: Mapping[str, float]) -> dict[str, float]:
        """Return the position behind a joint angle, and a pressure behind another and P1 - P2."""
        found = {}
        linkage = self.linkage(vector)
        names = {place: name for name, place in self.state_places.items()}
        for channel, (node, _, _) in self.system.derived.items():
            if channel in readings and linkage is not None:
                place = self.system.leader_of(node).position
                found[names[place]] = linkage.position_at(readings[channel])
        if "pressure_difference" in readings:
            difference = readings["pressure_difference"]
            if "pressure_a" in readings:
                found["pressure_b"] = readings["pressure_a"] - difference
            if "pressure_b" in readings:
                found["pressure_a"] = readings["pressure_b"] + difference
        found = {name: value for name, value in found.items() if name in self.state_places}
        return {**self.through_parts(vector, {**readings, **found}), **found}

    @cached_property
    def _geared_nodes(self) -> dict[str, str]:
        return {output.channel: output.of for output, _ in self.system.geared_channels()}

    @cached_property
    def _elastic_joints(self) -> tuple[ElasticJoint, ...]:
        """Springs between two parts that no gear stands between."""
        system = self.system
        names = {place: name for name, place in self.state_places.items()}
        shown = {of: channel for channel, (of, _) in self.network.channels.items()}
        found = []
        for part, (first, second) in system.elastic_joints():
            if any(node in system.leaders for node in part.element.ports.values()):
                continue
            slots = {
                key: system.index[system.slot_of[f"{part.name}.{key}"]]
                for key in ("stiffness", "play")
                if f"{part.name}.{key}" in system.slot_of
            }
            found.append(
                ElasticJoint(slots["stiffness"], slots.get("play"), shown.get(part.name, ""),
                             names[first.position], names[second.position])
            )  # fmt: skip
        return tuple(found)

    def resting_values(self, vector: FloatArray) -> Mapping[str, float]:
        """Return what inputs are where they are not given: what the plant declares of them."""
        return {
            item.channel: float(vector[item.default])
            for item in self.system.columns
            if item.default >= 0
        }

    @property
    def held_inputs(self) -> tuple[str, ...]:
        """Inputs that keep their value between samples because nobody declared what they do."""
        declared = {name for name, item in self.network.inputs.items() if item.held is not None}
        return tuple(
            item.channel
            for item in self.system.columns
            if item.held and item.channel not in declared
        )

    @cached_property
    def elastic_pairs(self) -> tuple[ElasticPair, ...]:
        """Pairs of parts that a spring joins, and so move nearly alike."""
        rate_of = self.roles.rate_of
        return tuple(
            ElasticPair(
                (joint.first, joint.second),
                (rate_of[joint.first], rate_of[joint.second]),
                joint.force,
            )
            for joint in self._elastic_joints
        )

    def through_parts(self, vector: FloatArray, readings: Mapping[str, float]) -> dict[str, float]:
        """Return states that readings of other parts tell of.

        A speed or a position behind gears is that of its coordinate by their ratio; a position
        beyond a spring is as far off as the force that is read of it bends it.
        """
        found: dict[str, float] = {}
        for channel, (state, _) in self.roles.geared.items():
            if channel in readings and state not in readings:
                found[state] = readings[channel] / self._turns(vector, self._geared_nodes[channel])
        readings = {**found, **readings}
        for joint in self._elastic_joints:
            bent = joint.bent(vector, readings.get(joint.force, 0.0))
            if joint.first not in readings and joint.second in readings:
                found[joint.first] = readings[joint.second] + bent
            elif joint.second not in readings and joint.first in readings:
                found[joint.second] = readings[joint.first] - bent
        return found

    @property
    def reservoir_pressures(self) -> tuple[str, ...]:
        """Parameters that hold a pressure whatever flows: of a tank, or a supply."""
        nodes = self.system.network.nodes.values()
        held = (f"{node.name}.pressure" for node in nodes if node.kind is NodeKind.RESERVOIR)
        return tuple(key for key in held if key in self.layout.index)

    @property
    def tells_through_parts(self) -> bool:
        """Whether anything is geared, or beyond a spring."""
        return bool(self.roles.geared or self._elastic_joints)

    def behind_joint(self) -> int | None:
        """Return the output that the only derived channel, a joint's angle, follows; or None."""
        rods = [*self.rods_behind.values()]
        return self.outputs.index(rods[0]) if len(self.system.derived) == len(rods) == 1 else None

    @cached_property
    def rods_behind(self) -> Mapping[str, str]:
        """Channels of joints' angles, with the output that is the position of the rod behind."""
        system = self.system
        places = {
            channel: system.leader_of(node).position
            for channel, (node, quantity, _) in system.derived.items()
            if quantity == "angle"
        }
        shown = {channel: system.channel_showing(place) for channel, place in places.items()}
        return {channel: rod for channel, rod in shown.items() if rod}

    def derived(
        self, vector: FloatArray, outputs: Mapping[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """Return the joint's angle, NaN where the triangle does not close, (n,) rad."""
        linkage = self.linkage(vector)
        names = {place: name for name, place in self.state_places.items()}
        found = {}
        for channel, (node, quantity, _) in self.system.derived.items():
            position = names[self.system.leader_of(node).position]
            if linkage is not None and quantity == "angle" and position in outputs:
                found[channel] = linkage.angle(outputs[position])
        return found


class _Fastest(Parametrised):
    """A plant with its parameters set, and the kernel that is the fastest for them."""

    plant: NetworkPlant

    def __init__(self, plant: NetworkPlant, vector: FloatArray) -> None:
        super().__init__(plant, vector)
        self._kernel, self._parameters, memory = plant.kernel_for(vector)
        self._memory = memory.size
        self._unread = plant.unread_states(vector)
        self._look_back = plant.layout.look_back(vector)
        self._shown = np.zeros(plant.system.size + 1)
        count = plant.system.size + len(plant._imposable)
        self._is_imposed = np.zeros(count, dtype=np.bool_)
        # what is to come is not known yet: moment by moment all is straight
        self._imposed = np.zeros((2, count + plant.system.size))
        self._given = np.ones(len(plant.system.columns), dtype=np.bool_)
        for name, (part, loop, _, _) in plant.system.loops.items():
            # moment by moment it is the command that is given
            for number, column in enumerate(plant.system.columns):
                if column.part is part:
                    self._given[number] = False
            del name, loop
        self._loop_period = 0.0
        self._motion = -1
        self._linkage = plant.linkage(vector)
        self._behind_joint = plant.behind_joint()

    def derived_at(self, reading: FloatArray) -> tuple[float, ...]:
        """Return the joint's angle at one reading (outputs,), rad; nothing without a linkage."""
        if self._linkage is None or self._behind_joint is None:
            return super().derived_at(reading)
        place = self._behind_joint
        return (float(self._linkage.angle(reading[place : place + 1])[0]),)

    def following(self, reference: str) -> Parametrised:
        """Return it driven by what a controller inside the plant follows, once its period.

        Raises:
            InputError: no controller inside the plant follows that.
        """
        plant, system = self.plant, self.plant.system
        if reference not in plant.references:
            return super().following(reference)
        other = _Fastest(plant, self.vector)
        column = system.columns[system.column_of[reference]]
        assert column.part is not None
        loop = system.loops[column.part.name][1]
        other._given[system.column_of[reference]] = True
        other._loop_period = float(
            self.vector[system.index[system.slot_of[f"{column.part.name}.{loop.period}"]]]
        )
        return other

    def imposing(self, motion: str) -> Parametrised:
        """Return it driven by a motion of one of its parts.

        Raises:
            InputError: nothing can impose that motion, or it leaves another one undetermined.
        """
        plant = self.plant
        if motion not in plant.imposable_motions:
            return super().imposing(motion)
        other = _Fastest(plant, self.vector)
        other._motion = plant.state_places[motion]
        other._is_imposed[other._motion] = True
        plant.check_massless(other._is_imposed)
        return other

    def simulate(self, drive: Drive, initial: Mapping[str, float], step: float) -> FloatArray:
        """Return (n, outputs) in the order of the plant's outputs, SI."""
        return self.simulate_to_end(drive, initial, step)[0]

    def simulate_to_end(
        self, drive: Drive, initial: Mapping[str, float], step: float
    ) -> tuple[FloatArray, dict[str, float]]:
        """Return (n, outputs) in the order of the plant's outputs, and the states at its end."""
        plant = self.plant
        inputs = plant.inputs_of(drive, self.vector)
        out = np.empty((inputs.time.size, len(plant.outputs)))
        first = int(inputs.ticks[drive.first])
        out[:first] = np.nan
        state, memory = self.start(initial)
        # a controller inside the plant writes its command over
        values = (
            inputs.values.copy() if inputs.period > 0.0 or plant.system.loops else inputs.values
        )
        shown = np.zeros(self._shown.size)
        anchors = {plant.state_places[name]: series for name, series in drive.anchors.items()}
        for begin, end in _stretches(drive, inputs):
            self._kernel.simulate(
                begin, end, inputs.time, values, inputs.given, inputs.imposed, inputs.is_imposed,
                drive.locked, drive.bypass_open, step, begin == first, self._parameters, memory,
                shown, state, out,
            )  # fmt: skip
            for place, series in anchors.items():
                if math.isfinite(here := series[np.searchsorted(inputs.ticks, end)]):
                    state[place] = here
        ends = {name: float(state[place]) for name, place in plant.state_places.items()}
        return (out if inputs.period == 0.0 else out[inputs.ticks]), ends

    def simulate_each(
        self,
        drives: Drives,
        which: Sequence[int],
        initials: Sequence[Mapping[str, float]],
        step: float,
    ) -> list[FloatArray]:
        """Return what `simulate` does for each simulation, by one call of compiled code."""
        from eha_bench.plants.network import many  # imports Numba

        if not initials:
            return []
        plant = self.plant
        parameters = np.require(self._parameters, np.float64, ["C", "W"])
        inputs = plant.inputs_of_each(drives, self.vector)
        read_first: Sequence[Mapping[str, float]] = initials
        unread: Sequence[Mapping[str, float]] = ()
        if self._unread:
            read_first, unread = zip(*map(self._parted, initials), strict=True)
        settle, simulate = many.addresses(self._kernel)
        chosen = np.asarray(which, dtype=np.intp)
        ends = np.concatenate(([0], np.cumsum(np.diff(inputs.edges)[chosen])))
        out = np.empty((int(ends[-1]), len(plant.outputs)))
        memories = np.zeros((chosen.size, self._memory))
        shown = np.zeros((chosen.size, self._shown.size))
        states, read = plant._as_read(read_first, parameters)
        many.settle_each(settle, read, parameters, memories, shown, states)
        for memory, own_unread in zip(memories, unread, strict=bool(unread)):
            self._remember(memory, own_unread)
        if plant._closed_circuits:
            for state, own in zip(states, read, strict=True):
                plant._charge(parameters, state, own)
        many.simulate_each(
            simulate, chosen, inputs.edges, inputs.firsts, inputs.times, inputs.values,
            bool(plant.system.loops), inputs.given, inputs.imposed, inputs.imposes, inputs.locked,
            inputs.bypass_open, step, parameters, memories, np.zeros_like(shown), states, ends, out,
        )  # fmt: skip
        rows = zip(which, pairwise(ends.tolist()), strict=True)
        return [
            out[here:there] if (ticks := inputs.ticks[k]) is None else out[here:there][ticks]
            for k, (here, there) in rows
        ]

    @property
    def look_back(self) -> float:
        """The delay of the command, s."""
        return self._look_back

    def start(self, initial: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Return the state behind what the sensors read first, and the kernel's memory."""
        memory = np.zeros(self._memory)
        read, unread = self._parted(initial)
        state = self.plant.start_state(read, self._kernel, self._parameters, memory)
        self._remember(memory, unread)
        return state, memory

    def _parted(
        self, initial: Mapping[str, float]
    ) -> tuple[Mapping[str, float], Mapping[str, float]]:
        """Return what a first state says of the plant's states, and of its effects' own."""
        if initial.keys().isdisjoint(self._unread):
            return initial, {}
        own = {name: value for name, value in initial.items() if name in self._unread}
        return {name: value for name, value in initial.items() if name not in own}, own

    def _remember(self, memory: FloatArray, unread: Mapping[str, float]) -> None:
        """Put what a first state says of the effects' own states into a kernel's memory."""
        for name, value in unread.items():
            memory[self._unread[name].place] = value

    @property
    def hidden(self) -> Mapping[str, float]:
        """How far what its effects hold may be from where it begins, in the midst of a motion."""
        return {name: item.reach for name, item in self._unread.items()}

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
        memory: FloatArray,
        state: FloatArray,
        out: FloatArray,
    ) -> None:
        """Go on as `Plant.advance` does."""
        if self._loop_period > 0.0 and last > first:
            for k in range(first, last):
                self._tick(
                    k, time, inputs, locked, bypass_open, step, fresh and k == first, memory,
                    state, out,
                )  # fmt: skip
            return
        n = last + 1
        if n > len(self._imposed):
            self._imposed = np.zeros((2 * n, self._imposed.shape[1]))
        if self._motion >= 0:
            self._imposed[first:n, self._motion] = inputs[first:n, -1]
        self._kernel.simulate(
            first, last, time, inputs, self._given, self._imposed, self._is_imposed, locked,
            bypass_open, step, fresh, self._parameters, memory, self._shown, state, out,
        )  # fmt: skip

    def _tick(
        self,
        k: int,
        time: FloatArray,
        inputs: FloatArray,
        locked: bool,
        bypass_open: bool,
        step: float,
        fresh: bool,
        memory: FloatArray,
        state: FloatArray,
        out: FloatArray,
    ) -> None:
        """Go on from moment k to the next by the clock of the controller inside the plant."""
        parts = max(1, round(float(time[k + 1] - time[k]) / self._loop_period))
        within = np.linspace(time[k], time[k + 1], parts + 1)
        times = np.concatenate((time[:k], within))
        # what is given is held until the next moment
        values = np.concatenate((inputs[:k], np.repeat(inputs[k : k + 1], parts + 1, axis=0)))
        values[-1] = inputs[k + 1]
        shown = np.full((times.size, out.shape[1]), np.nan)
        size = self.plant.system.size
        count = size + len(self.plant._imposable)
        self._kernel.simulate(
            k, k + parts, times, values, self._given, np.zeros((times.size, count + size)),
            self._is_imposed, locked, bypass_open, step, fresh, self._parameters, memory,
            self._shown, state, shown,
        )  # fmt: skip
        inputs[k], out[k], out[k + 1] = values[k], shown[k], shown[-1]


def _stretches(drive: Drive, inputs: Inputs) -> list[tuple[int, int]]:
    """Return the ticks between which a drive runs on without a state being set anew."""
    first, last = int(inputs.ticks[drive.first]), inputs.time.size - 1
    if not drive.anchors or last == first:
        return [(first, last)]
    every = max(1, round(_ANCHORED / float(np.median(np.diff(drive.time)))))
    edges = [*inputs.ticks[drive.first :: every].tolist()]
    return [*pairwise([*edges, last] if edges[-1] < last else edges)]


def _one_behind_the_other(each: Sequence[Inputs], drives: Sequence[Drive]) -> ManyInputs:
    """Return many drives' inputs as one."""
    kinds = {
        frozenset(drive.inputs): (drive, item.period)
        for drive, item in zip(drives, each, strict=True)
    }
    return ManyInputs(
        tuple(kinds.values()),
        tuple(item.ticks if item.period > 0.0 else None for item in each),
        np.cumsum([0, *(item.time.size for item in each)]),
        np.array([item.ticks[drive.first] for item, drive in zip(each, drives, strict=True)]),
        np.concatenate([item.time for item in each]),
        np.concatenate([item.values for item in each]),
        _imposed_of_each(each),
        np.array([item.given for item in each]),
        np.array([item.is_imposed for item in each]),
        np.array([drive.locked for drive in drives], dtype=np.bool_),
        np.array([drive.bypass_open for drive in drives], dtype=np.bool_),
    )


def _imposed_of_each(each: Sequence[Inputs]) -> FloatArray:
    """Return what is imposed on many drives, of all ticks; no rows where it is nothing on any."""
    parts = [item.imposed for item in each]
    if any(part.size for part in parts):
        parts = [
            part if part.size else np.zeros((item.time.size, part.shape[1]))
            for part, item in zip(parts, each, strict=True)
        ]
    return np.concatenate(parts)


def _controller_clock(time: FloatArray, period: float) -> tuple[FloatArray, IndexArray]:
    """Return a clock on which the controller ticks, and where on it the samples are."""
    parts = np.maximum(1, np.rint(np.diff(time) / period)).astype(np.intp)
    ticks = np.concatenate(([0], np.cumsum(parts)))
    return np.interp(np.arange(ticks[-1] + 1), ticks, time), ticks


def _same(time: FloatArray) -> tuple[FloatArray, IndexArray]:
    return np.ascontiguousarray(time, dtype=np.float64), np.arange(time.size)


def _on_clock(values: FloatArray, ticks: IndexArray, n: int, held: bool) -> FloatArray:
    """Return a series on the kernel's clock: held between samples, or linear."""
    if values.size == n:
        return values
    if not held:
        return np.interp(np.arange(n), ticks, values)
    return np.ascontiguousarray(values[np.searchsorted(ticks, np.arange(n), side="right") - 1])


def _bent(bow: FloatArray, ticks: IndexArray, n: int) -> FloatArray:
    """Return what a series is beside straight lines on the kernel's clock, and how it bends there.

    Args:
        bow: (samples,) how far it is beside them after each. ticks: where they are. n: ticks.

    Returns:
        (n, 2).
    """
    at = np.searchsorted(ticks, np.arange(n), side="right") - 1
    parts = np.append(np.diff(ticks), 1)[at]
    share = (np.arange(n) - ticks[at]) / parts
    return np.column_stack([share * (1.0 - share) * bow[at], bow[at] / parts**2])
