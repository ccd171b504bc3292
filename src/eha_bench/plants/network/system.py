"""A network laid flat: parameters, states, signals, inputs and outputs, each with its place.

Every number that a kernel works on lives in one of three vectors: parameters in `P`, states in `Y`,
signals (and flags, and effects' states) in `S`. Inside the kernel a state is a local name: `v0`,
`x0` of the first coordinate, `p0` of the first volume. Laws are bound to these by the names of
their arguments.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from eha_bench.core import units
from eha_bench.core.channels import unit_of as unit_of_channel
from eha_bench.core.error_text import error_text
from eha_bench.core.errors import InputError, Place, PluginError, UnitError
from eha_bench.core.near_miss import suggest
from eha_bench.core.place_unit import unit_at_place
from eha_bench.plants.network.element import (
    HYDRAULIC,
    MECHANICAL,
    Anatomy,
    Command,
    Compliance,
    Effort,
    Flow,
    Inertia,
    Input,
    Law,
    Loop,
    NodeKind,
    Oil,
    Stops,
    Tie,
    ports_of,
)
from eha_bench.plants.network.network import (
    NODE_PARAMETERS,
    QUANTITIES,
    UNITS,
    Element,
    Network,
    Node,
)
from eha_bench.plants.network.plant_file import Locate
from eha_bench.plants.parameter import Parameter

BYPASS = "bypass"
"""The signal that is 1 while the bypass is open."""
_LOOP_MEMORY = 4
"""Places in a kernel's memory for a controller inside the plant: two readings, its error, and what
it asks for by its law."""


@dataclass(frozen=True)
class BoundElement:
    """An element as it is bound: what it does, with the parameters it has."""

    element: Element
    anatomy: Anatomy
    tokens: Mapping[str, str]

    @property
    def name(self) -> str:
        """Name of the element."""
        return self.element.name


@dataclass(frozen=True)
class Coordinate:
    """A node that moves by its own balance.

    Attributes:
        node: it. number: among the coordinates; its states are `v<number>` and `x<number>`.
        speed, position: places in `Y`.
    """

    node: Node
    number: int
    speed: int
    position: int

    @property
    def name(self) -> str:
        """Name of the node."""
        return self.node.name

    @property
    def is_rotation(self) -> bool:
        """Whether it is a rotation."""
        return self.node.kind is NodeKind.ROTATION


@dataclass(frozen=True)
class Volume:
    """A volume of oil: its pressure is `p<number>`."""

    node: Node
    number: int
    pressure: int

    @property
    def name(self) -> str:
        """Name of the node."""
        return self.node.name


@dataclass(frozen=True)
class PlantInput:
    """An input of the plant.

    Attributes:
        channel: its name. unit: SI. held: whether it keeps its value between samples.
        signal: place in `S` that it sets, where it is not a command.
        default: place in `P` of what stands in where it is not given, -1 for 0.
        command: the command that it is, None where it is none. part: its element.
    """

    channel: str
    unit: str
    held: bool
    signal: int
    default: int
    command: Command | None
    part: BoundElement | None


@dataclass(frozen=True)
class Output:
    """A channel that the plant computes.

    Attributes:
        channel, unit: name, SI. of, quantity: as declared.
        state: place in `Y`, -1 where it is none. signal: place in `S` of what an imposed channel
            of it sets, -1 where it cannot be.
        expression: its value over states, signals and parameters.
        command: number of the input column that it shows, -1 for none.
    """

    channel: str
    unit: str
    of: str
    quantity: str
    state: int
    signal: int
    expression: str
    command: int = -1


@dataclass(frozen=True)
class Weighed:
    """What a coordinate weighs, SI, by its node's name, and the parameters that make it up."""

    node: str
    inertia: float
    keys: tuple[str, ...]


class System:
    """A network laid flat.

    Args:
        network: what was declared. locate: keys -> place in the file, for messages.

    Raises:
        InputError: a mistake that needs the whole network to see.
    """

    def __init__(self, network: Network, locate: Locate | None = None) -> None:
        self.network = network
        self.locate = locate or (lambda *keys: Place(key=".".join(map(str, keys))))
        self.parts = {name: self._part(item) for name, item in network.elements.items()}
        self.laws: dict[Law, str] = {}
        self._followers()
        self._slots()
        self._states()
        self._signals()
        self._loops()
        self._inputs()
        self._outputs()
        self._refuse_massless()
        self._refuse_empty()
        self._bind_oils()

    # --- what each element does --------------------------------------------------------------

    def _part(self, element: Element) -> BoundElement:
        used = {
            f"input:{item.port}" for item in self.network.inputs.values() if item.of == element.name
        }
        try:
            anatomy = element.kind.anatomy(frozenset(element.values) | used)
        except Exception as error:
            raise PluginError(
                f"the anatomy of the element kind '{element.kind.id}' fails ({error_text(error)})"
            ) from error
        ports = [port.name for port in element.kind.ports]
        for port in (port for item in anatomy.contributions for port in ports_of(item)):
            if port not in ports:
                raise PluginError(
                    f"the element kind '{element.kind.id}' acts on a port '{port}' that it does "
                    "not have",
                    hint=suggest(port, ports),
                )
        own = {item.name for item in anatomy.parameters}
        for key in element.values:
            if key not in own:
                raise InputError(
                    f"'{key}' does not go with what else '{element.name}' declares",
                    where=self.locate("elements", element.name, key),
                    hint=f"it then has: {', '.join(sorted(own))}",
                )
        kinds = [self.network.nodes[name].kind for name in element.ports.values()]
        moving = [kind for kind in kinds if kind in UNITS]
        tokens: dict[str, str] = {}
        if moving:
            tokens = dict(UNITS[moving[-1] if len(moving) > 1 else moving[0]])
            positions = [UNITS[kind]["position"] for kind in moving]
            tokens["ratio"] = "" if len(set(positions)) == 1 else "/".join(positions)
        return BoundElement(element, anatomy, tokens)

    def _followers(self) -> None:
        """Find the nodes that follow others, and the coordinates that lead."""
        ties: dict[str, tuple[BoundElement, Tie]] = {}
        for part in self.parts.values():
            for item in part.anatomy.contributions:
                if isinstance(item, Tie):
                    node = part.element.ports[item.port]
                    if node in ties:
                        raise InputError(
                            f"'{node}' follows two other nodes",
                            where=self.locate("elements", part.name),
                            hint="a node behind a gear or a linkage follows one only",
                        )
                    ties[node] = part, item
        self.coordinates: list[Coordinate] = []
        for own in self.network.nodes.values():
            if own.kind in MECHANICAL and own.name not in ties:
                self.coordinates.append(Coordinate(own, len(self.coordinates), 0, 0))
        self._ties = ties
        self.leaders: dict[str, tuple[str, ...]] = {}
        for name in ties:
            chain = [name]
            while chain[-1] in ties:
                part, tie = ties[chain[-1]]
                above = part.element.ports[tie.leader]
                if above in chain:
                    raise InputError(
                        f"{' and '.join(chain)} follow one another in a loop: none has a motion of "
                        "its own",
                        where=self.locate("elements", part.name),
                        hint="let one node with inertia lead",
                    )
                chain.append(above)
            self.leaders[name] = tuple(chain[1:])

    def leader_of(self, node: str) -> Coordinate:
        """Return the coordinate that a mechanical node moves with."""
        name = self.leaders[node][-1] if node in self.leaders else node
        return next(item for item in self.coordinates if item.name == name)

    def elastic_joints(self) -> list[tuple[BoundElement, tuple[Coordinate, Coordinate]]]:
        """Return springs between two nodes, as load cells, with what moves at their ends."""
        found = []
        for part in self.parts.values():
            ends = [term.port for term in part.anatomy.contributions
                    if isinstance(term, Effort) and term.stiffness is not None]  # fmt: skip
            if len(ends) == 2:
                first, second = (self.leader_of(part.element.ports[port]) for port in ends)
                found.append((part, (first, second)))
        return found

    @property
    def pressure_inputs(self) -> list[PlantInput]:
        """The inputs that give a reservoir's pressure."""
        return [column for column in self.columns if column.unit == "Pa" and not column.command]

    # --- parameters --------------------------------------------------------------------------

    def _slots(self) -> None:
        """Give every parameter its place; names of the file stand for one or for several."""
        found: dict[str, Parameter] = {}
        for node in self.network.nodes.values():
            for item in NODE_PARAMETERS[node.kind]:
                always = node.kind is NodeKind.RESERVOIR or item.name == "pressure"
                if item.name in node.values or always:
                    value = node.values.get(item.name, item.default)
                    found[f"{node.name}.{item.name}"] = _declared(item, value, item.unit)
            if node.stroke is not None:
                unit = UNITS[node.kind]["position"]
                for end, value in zip(("stroke_low", "stroke_high"), node.stroke, strict=True):
                    found[f"{node.name}.{end}"] = Parameter(
                        end, unit, value, -math.inf, math.inf, source="end of the stroke",
                        searched=False,
                    )  # fmt: skip
        for part in self.parts.values():
            declared = part.element.values
            for item in part.anatomy.parameters:
                value = declared.get(item.name, item.default)
                unit = self._unit(item.unit, part)
                if (
                    "{command}" in item.unit
                    and item.name in declared
                    and self._motor_commands(part)
                ):
                    self._check_unit(part, item.name, unit)
                found[f"{part.name}.{item.name}"] = _declared(item, value, unit)
        self.slot_of: dict[str, str] = {}
        parameters: list[Parameter] = []
        for alias, targets in self.network.names.items():
            first = None
            for target in targets:
                if target not in found:
                    raise InputError(
                        f"there is no parameter '{target}'",
                        where=self.locate("names", alias),
                        hint=suggest(target, found),
                    )
                if target in self.slot_of:
                    raise InputError(
                        f"'{target}' has two names: {self.slot_of[target]} and {alias}",
                        where=self.locate("names", alias),
                    )
                item = found[target]
                if first is not None and (item.unit, item.default) != (first.unit, first.default):
                    raise InputError(
                        f"'{targets[0]}' and '{target}' share the name '{alias}', but not their "
                        "value or unit",
                        where=self.locate("names", alias),
                        hint="declare the same value for both",
                    )
                first = first or item
                self.slot_of[target] = alias
            if first is None:
                raise InputError("names no parameter", where=self.locate("names", alias))
            parameters.append(self._named_parameter(alias, first))
        for key, item in found.items():
            if key not in self.slot_of:
                if key in self.network.names:
                    raise InputError(
                        f"'{key}' is the name of another parameter",
                        where=self.locate("names", key),
                    )
                self.slot_of[key] = key
                parameters.append(self._named_parameter(key, item))
        for key in self.network.assumed:
            if key not in {item.name for item in parameters}:
                raise InputError(
                    f"there is no parameter '{key}'",
                    where=self.locate("assumed", key),
                    hint=suggest(key, [item.name for item in parameters]),
                )
        self.parameters = tuple(parameters)
        self.index = {item.name: place for place, item in enumerate(parameters)}

    def _unit(self, unit: str, part: BoundElement) -> str:
        if "{command}" not in unit:
            return unit_at_place(unit, part.tokens)
        command = self._motor_commands(part)
        asked = command[0].unit if command else ""
        return unit_at_place(unit, {**part.tokens, "command": asked})

    def _motor_commands(self, part: BoundElement) -> tuple[Command, ...]:
        """Return the commands of the motor that an element drives, () where it drives none."""
        motor = self.parts.get(part.element.refers.get("motor", ""))
        return motor.anatomy.commands if motor else ()

    def _check_unit(self, part: BoundElement, name: str, unit: str) -> None:
        """Refuse a quantity whose unit depends on another element, where it is a wrong one."""
        raw = self.network.source.get("elements", {}).get(part.name, {}).get(name)
        if not isinstance(raw, str):
            return
        try:
            units.parse(raw, unit)
        except UnitError as error:
            raise InputError(
                error.what, where=self.locate("elements", part.name, name), hint=error.hint
            ) from error

    def _named_parameter(self, key: str, item: Parameter) -> Parameter:
        why = self.network.assumed.get(key)
        return replace(item, name=key, assumed=why is not None, source=why or item.source)

    def parameter(self, of: str, name: str) -> str | None:
        """Return the expression of a parameter of an element or node, None where it has none."""
        key = self.slot_of.get(f"{of}.{name}")
        return None if key is None else f"P[{self.index[key]}]"

    def declared(self, of: str, name: str) -> float | None:
        """Return what a node or an element declares, None where it has no such parameter."""
        key = self.slot_of.get(f"{of}.{name}")
        return None if key is None else self.parameters[self.index[key]].default

    # --- states and signals ------------------------------------------------------------------

    def _states(self) -> None:
        place = 0
        placed = []
        for item in self.coordinates:
            placed.append(replace(item, speed=place, position=place + 1))
            place += 2
        self.coordinates = placed
        self.volumes: list[Volume] = []
        for node in self.network.nodes.values():
            if node.kind is NodeKind.VOLUME:
                self.volumes.append(Volume(node, len(self.volumes), place))
                place += 1
        self.size = place
        self.state_names = [
            *(name for c in self.coordinates for name in (f"v{c.number}", f"x{c.number}")),
            *(f"p{item.number}" for item in self.volumes),
        ]
        self.volume_of = {item.name: item for item in self.volumes}

    def _signals(self) -> None:
        """Give every signal its place in `S`; the first ones tell of the setup and the time."""
        self.signals: dict[str, int] = {BYPASS: 0, "t": 1, "any": 2}
        for part in self.parts.values():
            for item in part.anatomy.signals:
                self.signals[f"{part.name}.{item.name}"] = len(self.signals)
            for command in part.anatomy.commands:
                self.signals[f"{part.name}.{command.port}?"] = len(self.signals)
                self.signals[f"{part.name}.{command.port}!"] = len(self.signals)
        for node in self.network.nodes.values():
            if node.kind is NodeKind.RESERVOIR:
                self.signals[f"{node.name}.pressure"] = len(self.signals)
        self.signals["oil_temperature"] = len(self.signals)

    def demand(self, part: BoundElement, command: Command) -> int:
        """Return the place in `S` of what a command asks for within its limit."""
        return self.signals[f"{part.name}.{command.port}?"]

    def drive_demand(self, part: BoundElement, command: Command) -> int:
        """Return the place in `S` of what a drive makes of that before its dynamics."""
        return self.signals[f"{part.name}.{command.port}!"]

    def _loops(self) -> None:
        """Find the controllers inside the plant, and the commands that they set."""
        self.loops: dict[str, tuple[BoundElement, Loop, BoundElement, Command]] = {}
        for part in self.parts.values():
            loop = part.anatomy.loop
            if loop is None:
                continue
            key = part.element.refers.get(loop.drives)
            if key is None:
                raise InputError(
                    f"'{part.name}' needs '{loop.drives}': the element that it drives",
                    where=self.locate("elements", part.name),
                )
            driven = self.parts[key]
            if not driven.anatomy.commands:
                raise InputError(
                    f"'{key}' takes no command",
                    where=self.locate("elements", part.name, loop.drives),
                )
            for other, _, also, _ in self.loops.values():
                if also is driven:
                    raise InputError(
                        f"'{other.name}' and '{part.name}' both set the command of '{key}'",
                        where=self.locate("elements", part.name, loop.drives),
                        hint="leave one of them out",
                    )
            self.loops[part.name] = part, loop, driven, driven.anatomy.commands[0]

    def _inputs(self) -> None:
        self.columns: list[PlantInput] = []
        for channel, item in self.network.inputs.items():
            where = self.locate("inputs", channel)
            if item.of in self.network.nodes:
                held = False if item.held is None else item.held
                key = f"{item.of}.pressure"
                self.columns.append(
                    PlantInput(
                        channel,
                        "Pa",
                        held,
                        self.signals[key],
                        self.index[self.slot_of[key]],
                        None,
                        None,
                    )
                )
                continue
            part = self.parts[item.of]
            own = {port.port: port for port in part.anatomy.inputs}
            if item.port not in own:
                raise InputError(
                    f"a {part.element.kind.id} has no input '{item.port}'",
                    where=where,
                    hint=f"it has: {', '.join(own)}" if own else "it takes none",
                )
            self.columns.append(self._column(channel, part, own[item.port], item.held))
        self._complete_loops()
        self._complete_defaults()
        self.columns.append(
            PlantInput(
                "oil_temperature", "K", False, self.signals["oil_temperature"], -2, None, None
            )
        )
        for column in self.columns:
            self._check_known("inputs", column.channel, column.unit)
        self.column_of = {item.channel: number for number, item in enumerate(self.columns)}

    def _column(
        self, channel: str, part: BoundElement, port: Input, held: bool | None
    ) -> PlantInput:
        command = next((c for c in part.anatomy.commands if c.port == port.port), None)
        default = -1
        if port.default:
            default = self.index[self.slot_of[f"{part.name}.{port.default}"]]
        unit = self._unit(port.unit, part)
        signal = self.signals[f"{part.name}.{port.signal}"]
        return PlantInput(
            channel, unit, port.held if held is None else held, signal, default, command, part
        )

    def _complete_loops(self) -> None:
        """A command that only a controller sets needs a column all the same."""
        for part, _, driven, command in self.loops.values():
            if not any(c.part is driven and c.command is command for c in self.columns):
                port = next(p for p in driven.anatomy.inputs if p.port == command.port)
                self.columns.append(
                    self._column(f"{driven.name}.{command.port}", driven, port, None)
                )
            del part

    def _complete_defaults(self) -> None:
        """A parameter that stands in for an input (a supply) needs a column as well."""
        for part in self.parts.values():
            for port in part.anatomy.inputs:
                signal = self.signals[f"{part.name}.{port.signal}"]
                if port.default and all(c.signal != signal for c in self.columns):
                    self.columns.append(self._column(f"{part.name}.{port.port}", part, port, None))

    @property
    def memory(self) -> int:
        """Places of signals and of controllers inside the plant in a kernel's memory."""
        return len(self.signals) + _LOOP_MEMORY * len(self.loops)

    def loop_memory(self, loop: str) -> int:
        """Return the first place of a controller inside the plant, behind all signals."""
        return len(self.signals) + _LOOP_MEMORY * list(self.loops).index(loop)

    def loop_error(self, loop: str) -> int:
        """Return the place of what a controller inside the plant takes for its error."""
        return self.loop_memory(loop) + 2

    def loop_law(self, loop: str) -> int:
        """Return the place of what a controller inside the plant asks for by its law."""
        return self.loop_memory(loop) + 3

    def held_by(self, loop: str) -> Coordinate | None:
        """Return the coordinate that a controller reads and its motor drives, None for none."""
        part, own, driven, _ = self.loops[loop]
        read = self.leader_of(part.element.ports[own.reads])
        drives = driven.element.ports.get("on", "")
        return read if drives and self.leader_of(drives) is read else None

    def is_followed(self, column: PlantInput) -> bool:
        """Whether a column holds what a controller inside the plant follows."""
        loop = column.part.anatomy.loop if column.part is not None else None
        return (
            loop is not None
            and column.part is not None
            and column.signal == self.signals[f"{column.part.name}.{loop.reference}"]
        )

    def channel_showing(self, state: int) -> str:
        """Return the channel that shows a state, "" where none does."""
        return next((item.channel for item in self.outputs if item.state == state), "")

    def column_for(self, part: BoundElement, command: Command) -> int:
        """Return the input column of a command.

        Raises:
            InputError: nothing drives it.
        """
        for number, item in enumerate(self.columns):
            if item.part is part and item.command is command:
                return number
        return -1

    def _outputs(self) -> None:
        self.outputs: list[Output] = []
        self.derived: dict[str, tuple[str, str, str]] = {}
        looped = {
            self.columns[self.column_for(driven, command)].channel: self.column_for(driven, command)
            for _, _, driven, command in self.loops.values()
        }
        looped = {channel: number for channel, number in looped.items() if "." not in channel}
        for channel in looped:
            if channel not in self.network.channels:
                self._command_output(channel, looped[channel])
        for channel, (of, quantity) in self.network.channels.items():
            if channel in looped:
                self._command_output(channel, looped[channel])
            elif of in self.network.nodes:
                self._node_output(channel, self.network.nodes[of], quantity)
            else:
                self._element_output(channel, self.parts[of], quantity)
        for output in self.outputs:
            self._check_known("channels", output.channel, output.unit)

    def refuse_underived(self) -> None:
        """Refuse a channel behind a linkage that nothing determines: it would be left out unsaid.

        Raises:
            InputError: it is no angle, or no channel shows the rod that it follows from.
        """
        for channel, (node, quantity, _) in self.derived.items():
            where = self.locate("channels", channel)
            rod = self.leader_of(node)
            if quantity != "angle":
                raise InputError(
                    f"the {quantity} of '{node}' cannot be shown: it is behind a linkage",
                    where=where,
                    hint=f"show its angle, and {rod.name}.velocity",
                )
            if not self.channel_showing(rod.position):
                raise InputError(
                    f"'{channel}' follows from the position of '{rod.name}', which no channel "
                    "shows",
                    where=where,
                    hint=f"add a channel for it, e.g. piston_position: {rod.name}.position; where "
                    "a log has the angle alone, its position is worked out from that",
                )

    def _check_known(self, section: str, channel: str, unit: str) -> None:
        """Refuse a channel that eha_bench knows by this name, but as another quantity."""
        known = unit_of_channel(channel)
        if known not in ("", unit):
            raise InputError(
                f"'{channel}' is a channel in {known}, but what it names here is in {unit or '1'}",
                where=self.locate(section, channel),
                hint="give it another name",
            )

    def _command_output(self, channel: str, number: int) -> None:
        """Show what a controller inside the plant asks for, as its drive logs it."""
        column = self.columns[number]
        assert column.part is not None
        assert column.command is not None
        self.outputs.append(
            Output(channel, column.unit, column.part.name, column.command.port, -1, column.signal,
                   "", number)
        )  # fmt: skip

    def _node_output(self, channel: str, node: Node, quantity: str) -> None:
        unit = QUANTITIES[node.kind][quantity]
        if node.kind is NodeKind.VOLUME:
            volume = self.volume_of[node.name]
            self.outputs.append(
                Output(channel, unit, node.name, quantity, volume.pressure, -1, f"p{volume.number}")
            )
        elif node.kind is NodeKind.RESERVOIR:
            self.outputs.append(
                Output(channel, unit, node.name, quantity, -1, -1, self.pressure(node.name))
            )
        elif node.name in self.leaders:
            part, tie = self._ties[node.name]
            if part.element.kind.id == "gear":
                self.outputs.append(
                    Output(channel, unit, node.name, quantity, -1, -1,
                           self.speed(node.name) if quantity in ("speed", "velocity")
                           else self.position(node.name))
                )  # fmt: skip
            else:
                self.derived[channel] = node.name, quantity, unit
            del tie
        else:
            item = self.leader_of(node.name)
            moving = quantity in ("speed", "velocity")
            self.outputs.append(
                Output(channel, unit, node.name, quantity, item.speed if moving else item.position,
                       -1, f"{'v' if moving else 'x'}{item.number}")
            )  # fmt: skip

    def _element_output(self, channel: str, part: BoundElement, quantity: str) -> None:
        own = {item.name: item for item in part.anatomy.quantities}
        if quantity not in own:
            raise InputError(
                f"a {part.element.kind.id} has no '{quantity}'",
                where=self.locate("channels", channel),
                hint=f"it has: {', '.join(own)}" if own else "name a state of a node instead",
            )
        item = own[quantity]
        signal = self.signals[f"{part.name}.{item.signal}"] if item.signal else -1
        self.outputs.append(
            Output(channel, self._unit(item.unit, part), part.name, quantity, -1, signal,
                   self.call(part, item.law))
        )  # fmt: skip

    def _refuse_massless(self) -> None:
        """Refuse nodes without inertia that nothing measures: their balance has no answer."""
        for item in self.coordinates:
            heavy = self.inertias(item)
            shown = any(
                of == item.name and quantity in ("speed", "velocity", "position", "angle")
                for of, quantity in self.network.channels.values()
            )
            if not heavy and not shown:
                raise InputError(
                    f"'{item.name}' has no inertia, and no channel shows its motion: nothing says "
                    "how it moves",
                    where=self.locate("nodes", item.name),
                    hint="give it an inertia (or mass), or a channel that is measured",
                )

    def _refuse_empty(self) -> None:
        """Refuse volumes that hold nothing: their pressure would have no slope."""
        for volume in self.volumes:
            if volume.node.values.get("volume", 0.0) > 0.0:
                continue
            if not self.oils(volume) and not self.compliances(volume):
                raise InputError(
                    f"the volume '{volume.name}' holds no oil",
                    where=self.locate("nodes", volume.name),
                    hint="give it a `volume`, or join a cylinder or an accumulator to it",
                )

    def _bind_oils(self) -> None:
        """Refuse a cylinder whose rod lacks the stroke that its dead volumes need."""
        for volume in self.volumes:
            for part, term in self.oils(volume):
                self.call(part, term.law)

    # --- binding -----------------------------------------------------------------------------

    def law(self, law: Law) -> str:
        """Return the name of a law in the kernel's source."""
        function = getattr(law, "py_func", law)
        if function not in self.laws:
            self.laws[function] = f"_l{len(self.laws)}"
        return self.laws[function]

    def call(self, part: BoundElement, law: Law, **extra: str) -> str:
        """Return the text of a law's call with its arguments bound.

        Raises:
            PluginError: the law asks for something that there is not.
        """
        bound = [
            self.argument_expression(part, name, extra)
            for name in inspect.signature(law).parameters
        ]
        return f"{self.law(law)}({', '.join(bound)})"

    def through(self, part: BoundElement, flow: Flow, law: Law) -> str:
        """Return the text of a call of a flow's law or slope, which may name the flow's own ends.

        Raises:
            PluginError: the law asks for something that there is not.
        """
        ports = part.element.ports
        ends = {"p_source": flow.source, "p_sink": flow.sink}
        own = {name: self.pressure(ports[port]) for name, port in ends.items() if port in ports}
        return self.call(part, law, **own)

    def argument_expression(self, part: BoundElement, name: str, extra: Mapping[str, str]) -> str:
        """Return the expression that a law's argument stands for."""
        if name in extra:
            return extra[name]
        found = self.parameter(part.name, name)
        if found is not None:
            return found
        if f"{part.name}.{name}" in self.signals:
            return f"S[{self.signals[f'{part.name}.{name}']}]"
        if name.startswith("p_") and name[2:] in part.element.ports:
            return self.pressure(part.element.ports[name[2:]])
        found = self._of_motion(part, name) or self._of_other(part, name)
        if found is not None:
            return found
        if name == "t":
            return "t"
        self._refuse_missing_of_other(part, name)
        raise PluginError(
            f"the element kind '{part.element.kind.id}' asks for '{name}', which it does not have",
            hint=f"it has: {', '.join(self._argument_names(part, extra))}",
        )

    def _argument_names(self, part: BoundElement, extra: Mapping[str, str]) -> list[str]:
        """Return what a law of an element may name."""
        nodes = part.element.ports.items()
        moving = [port for port, node in nodes if self.network.nodes[node].kind in MECHANICAL]
        ends = [f"_{port}" for port in moving] if len(moving) > 1 else [""] * len(moving)
        return [
            *(item.name for item in part.anatomy.parameters),
            *(item.name for item in part.anatomy.signals),
            *(f"{what}{end}" for end in ends for what in ("speed", "position")),
            *(f"p_{port}" for port, node in nodes if self.network.nodes[node].kind in HYDRAULIC),
            *extra,
            "t",
        ]

    def _of_motion(self, part: BoundElement, name: str) -> str | None:
        """Return the expression of a quantity of the nodes that an element moves, None for none."""
        moving = {
            port: node
            for port, node in part.element.ports.items()
            if self.network.nodes[node].kind in MECHANICAL
        }
        if not moving:
            return None
        own = next(iter(moving.values()))
        plain = {"speed": self.speed, "position": self.position, "inertia": self.inertia}
        what, _, port = name.partition("_")
        if what in plain and (not port or port in moving):
            return plain[what](moving[port] if port else own)
        if name not in ("low", "high"):
            return None
        end = self.parameter(own, f"stroke_{name}")
        if end is None:
            raise InputError(
                f"'{part.name}' declares dead volumes, so the rod '{own}' needs a stroke",
                where=self.locate("nodes", own),
                hint="add `stroke: [low, high]` to the node",
            )
        return end

    def _refuse_missing_of_other(self, part: BoundElement, name: str) -> None:
        """Refuse an element that needs of another one what that was declared without.

        Raises:
            InputError: at the other one, or where none is named at the element itself.
        """
        for key in part.element.kind.refers:
            if not name.startswith(f"{key}_"):
                continue
            needed, other = name[len(key) + 1 :], part.element.refers.get(key)
            what = f"'{part.name}' ({part.element.kind.id}) needs '{needed}' of "
            if other is None:
                raise InputError(
                    f"{what}an element that it does not name",
                    where=self.locate("elements", part.name),
                    hint=f"name it: `{key}: ...`",
                )
            raise InputError(
                f"{what}'{other}', which is declared without it",
                where=self.locate("elements", other),
                hint=f"declare '{other}' with `{needed}: ...`",
            )

    def _of_other(self, part: BoundElement, name: str) -> str | None:
        """Return the expression of a parameter of an element that is referred to, None for none."""
        for key, other in part.element.refers.items():
            if name.startswith(f"{key}_"):
                found = self.parameter(other, name[len(key) + 1 :])
                if found is not None:
                    return found
        return None

    def pressure(self, node: str) -> str:
        """Return the expression of a hydraulic node's pressure."""
        if node in self.volume_of:
            return f"p{self.volume_of[node].number}"
        return f"S[{self.signals[f'{node}.pressure']}]"

    def speed(self, node: str) -> str:
        """Return the expression of a mechanical node's speed."""
        if node not in self.leaders:
            return f"v{self.leader_of(node).number}"
        return f"({self.ratio(node)} * v{self.leader_of(node).number})"

    def position(self, node: str) -> str:
        """Return the expression of a mechanical node's position."""
        if node not in self.leaders:
            return f"x{self.leader_of(node).number}"
        part, tie = self._ties[node]
        return self.call(part, tie.position, position=self.position(part.element.ports[tie.leader]))

    def ratio(self, node: str) -> str:
        """Return the expression of d(node)/d(its coordinate), "" for the coordinate itself."""
        if node not in self.leaders:
            return ""
        part, tie = self._ties[node]
        above = part.element.ports[tie.leader]
        own = self.call(part, tie.ratio, position=self.position(above))
        further = self.ratio(above)
        return f"{own} * {further}" if further else own

    def bend(self, node: str) -> str:
        """Return the expression of d2(node)/d(its coordinate)2, "" where it is 0."""
        if node not in self.leaders:
            return ""
        part, tie = self._ties[node]
        above = part.element.ports[tie.leader]
        place = self.position(above)
        ratio, further = self.ratio(above), self.bend(above)
        terms = []
        if tie.bend is not None:
            own = self.call(part, tie.bend, position=place)
            terms.append(f"{own} * ({ratio}) * ({ratio})" if ratio else own)
        if further:
            terms.append(f"{self.call(part, tie.ratio, position=place)} * ({further})")
        return " + ".join(terms)

    def inertia(self, node: str) -> str:
        """Return the expression of the whole inertia of a node's coordinate."""
        item = self.leader_of(node)
        return f"mass{item.number}({', '.join(self.state_names)}, t, X, P, S)"

    # --- the terms of each balance -----------------------------------------------------------

    def _on(self, item: Coordinate, node: str) -> bool:
        kind = self.network.nodes[node].kind
        return kind in MECHANICAL and self.leader_of(node) is item

    def terms(self, item: Coordinate, kind: type) -> list[tuple[BoundElement, Any, str]]:
        """Return (part, contribution, ratio) of all that acts on a coordinate."""
        found = []
        for part in self.parts.values():
            for term in part.anatomy.contributions:
                if isinstance(term, kind):
                    assert not isinstance(term, Tie | Flow)
                    node = part.element.ports[term.port]
                    if self._on(item, node):
                        found.append((part, term, self.ratio(node)))
        return found

    def stiffnesses(self, item: Coordinate) -> list[str]:
        """Return the expressions whose sum is the stiffness of the springs on a coordinate."""
        found = []
        for part, term, ratio in self.terms(item, Effort):
            if term.stiffness is not None:
                found.append(at_coordinate(self.call(part, term.stiffness), ratio))
        return found

    @property
    def has_springs(self) -> bool:
        """Whether anything swings on springs that a step has to resolve."""
        return any(self.stiffnesses(item) for item in self.coordinates)

    def inertias(self, item: Coordinate) -> list[str]:
        """Return the expressions whose sum is a coordinate's inertia."""
        return [*self.inertias_of_nodes(item), *self.inertias_of_elements(item)]

    def declared_inertia(self, item: Coordinate, value: Callable[[str], float]) -> Weighed:
        """Return the sum of all inertias on a coordinate, and which parameters make it.

        That of an element whose law takes more than its own parameters counts as infinite.

        Args:
            item: the coordinate. value: parameter -> its value.
        """
        weights = self.declared_weights(item)
        keys = [key for key, _ in weights]
        total = sum(value(key) * share for key, share in weights)
        for part, term, _ in self.terms(item, Inertia):
            share = self.declared_ratio(part.element.ports[term.port]) ** 2
            names = [f"{part.name}.{name}" for name in inspect.signature(term.law).parameters]
            own = [self.slot_of[name] for name in names if name in self.slot_of]
            keys += own
            total += share * term.law(*map(value, own)) if len(own) == len(names) else math.inf
        return Weighed(item.name, total, tuple(keys))

    def declared_weights(self, item: Coordinate) -> list[tuple[str, float]]:
        """Return what a coordinate's own nodes weigh: parameters, each with its ratio squared."""
        return [
            (self.slot_of[f"{name}.{key}"], self.declared_ratio(name) ** 2)
            for name in self.nodes_on(item)
            for key in ("inertia", "mass")
            if f"{name}.{key}" in self.slot_of
        ]

    def inertias_of_nodes(self, item: Coordinate) -> list[str]:
        """Return what a coordinate's own nodes weigh."""
        return [
            at_coordinate(value, self.ratio(node)) for node, value in self._weights_of_nodes(item)
        ]

    def inertias_of_elements(self, item: Coordinate) -> list[str]:
        """Return what the elements on a coordinate add to its inertia."""
        return [at_coordinate(value, self.ratio(node)) for node, value in self._weights_on(item)]

    def forces_of_bends(self, item: Coordinate) -> list[str]:
        """Return what inertias exert on a coordinate as their ratio to it changes, -J r r' v^2.

        Lagrange's equation of J (r v)^2 / 2; nothing behind gears, whose ratio is constant.
        """
        speed = f"v{item.number}"
        return [
            f"-{value} * ({self.ratio(node)}) * ({self.bend(node)}) * {speed} * {speed}"
            for node, value in [*self._weights_of_nodes(item), *self._weights_on(item)]
            if self.bend(node)
        ]

    def _weights_of_nodes(self, item: Coordinate) -> list[tuple[str, str]]:
        """Return the nodes of a coordinate that weigh something, with what."""
        found = []
        for name in self.nodes_on(item):
            for key in ("inertia", "mass"):
                value = self.parameter(name, key)
                if value is not None:
                    found.append((name, str(value)))
        return found

    def _weights_on(self, item: Coordinate) -> list[tuple[str, str]]:
        """Return the nodes of a coordinate that carry elements of some inertia, with that."""
        return [
            (part.element.ports[term.port], self.call(part, term.law))
            for part, term, _ in self.terms(item, Inertia)
        ]

    def flows(self) -> list[tuple[BoundElement, Flow]]:
        """Return every flow with its element, in the order of the file."""
        return [
            (part, term)
            for part in self.parts.values()
            for term in part.anatomy.contributions
            if isinstance(term, Flow)
        ]

    def ends(self, part: BoundElement, flow: Flow) -> tuple[str, str]:
        """Return the nodes that a flow leaves and enters, "" for none."""
        source = part.element.ports[flow.source] if flow.source else ""
        sink = part.element.ports[flow.sink] if flow.sink else ""
        return source, sink

    def oils(self, volume: Volume) -> list[tuple[BoundElement, Oil]]:
        """Return what adds oil to a volume."""
        return self._of_volume(volume, Oil)

    def compliances(self, volume: Volume) -> list[tuple[BoundElement, Compliance]]:
        """Return what gives way besides the oil of a volume."""
        return self._of_volume(volume, Compliance)

    def _of_volume(self, volume: Volume, kind: type) -> list[tuple[BoundElement, Any]]:
        found = []
        for part in self.parts.values():
            for term in part.anatomy.contributions:
                if isinstance(term, kind):
                    assert not isinstance(term, Flow)
                    if part.element.ports[term.port] == volume.name:
                        found.append((part, term))
        return found

    def stroke(self, item: Coordinate) -> tuple[str, str] | None:
        """Return the expressions of the ends of a coordinate's stroke, None where it has none.

        Ends are those of the coordinate's own node, else of one that moves with it, else of what
        stops one of these: the way of a node behind a gear is that of the coordinate, times the
        ratio.
        """
        for node in self.geared(item):
            low, high = (self.parameter(node, f"stroke_{end}") for end in ("low", "high"))
            if low is not None and high is not None:
                return self._at_leader(low, high, self.ratio(node))
        for part, term, ratio in self.terms(item, Stops):
            gears = ratio if part.element.ports[term.port] in self.geared(item) else ""
            return self._at_leader(self.call(part, term.low), self.call(part, term.high), gears)
        return None

    @staticmethod
    def _at_leader(low: str, high: str, ratio: str) -> tuple[str, str]:
        """Return the ends of a way as those of what it moves with, `ratio` times as slow."""
        if not ratio:
            return low, high
        ends = f"({low}) / ({ratio})", f"({high}) / ({ratio})"
        return (
            f"({ends[0]} if ({ratio}) > 0.0 else {ends[1]})",
            f"({ends[1]} if ({ratio}) > 0.0 else {ends[0]})",
        )

    def geared(self, item: Coordinate) -> list[str]:
        """Return a coordinate's own node, and those that move a fixed number of times as fast."""
        return [node for node in self.nodes_on(item) if self._is_geared(node)]

    def _is_geared(self, node: str) -> bool:
        return all(part.element.kind.id == "gear" for part in self.between(node))

    def between(self, node: str) -> list[BoundElement]:
        """Return what ties a node to its coordinate, the nearest to the node first."""
        found = []
        while node in self.leaders:
            part, tie = self._ties[node]
            found.append(part)
            node = part.element.ports[tie.leader]
        return found

    def declared_ratio(self, node: str) -> float:
        """Return how many times as fast as its coordinate a node moves, as declared."""
        return math.prod(self.parameters[place].default or 1.0 for place in self.ratio_places(node))

    def ratio_places(self, node: str) -> list[int]:
        """Return the places of the ratios between a node and its coordinate among parameters."""
        keys = [self.slot_of.get(f"{part.name}.ratio") for part in self.between(node)]
        return [self.index[key] for key in keys if key is not None]

    @cached_property
    def shown(self) -> dict[int, str]:
        """The first channel that shows each state, by its place."""
        shown = [(output.state, output.channel) for output in self.outputs if output.state >= 0]
        return dict(reversed(shown))

    def geared_channels(self) -> list[tuple[Output, Coordinate]]:
        """Return channels of nodes behind gears alone, with the coordinate that they move with."""
        return [
            (output, self.leader_of(output.of))
            for output in self.outputs
            if output.of in self.leaders and self._is_geared(output.of)
        ]

    def nodes_on(self, item: Coordinate) -> list[str]:
        """Return a coordinate's own node, and those that move with it."""
        return [item.name, *(n for n, chain in self.leaders.items() if chain[-1] == item.name)]

    @cached_property
    def locked_coordinates(self) -> tuple[int, ...]:
        """Numbers of the coordinates that `piston: locked` holds: those that cylinders move."""
        found = {
            self.leader_of(part.element.ports["on"]).number
            for part in self.parts.values()
            if part.element.kind.id == "cylinder"
        }
        return tuple(sorted(found))

    @cached_property
    def has_bypass(self) -> bool:
        """Whether a valve opens where a run's setup says so."""
        return any(part.anatomy.opens_with_bypass for part in self.parts.values())


def at_coordinate(value: str, ratio: str) -> str:
    """Return the expression of an inertia, stiffness or damping as its coordinate feels it.

    Args:
        value: at its own node. ratio: of that to the coordinate, "" for the coordinate itself.
    """
    return f"({ratio}) * ({ratio}) * {value}" if ratio else value


def _declared(kind: Parameter, value: float, unit: str) -> Parameter:
    """Return a parameter of a kind as it is declared, which may be as nothing."""
    return replace(kind, default=value, unit=unit, usual=kind.usual or abs(kind.default))
