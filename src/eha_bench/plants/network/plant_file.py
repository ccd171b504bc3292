"""plant.yaml → Network: every mistake with file, line and key (contract, section 3a)."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from eha_bench.core import units
from eha_bench.core.errors import InputError, Place, UnitError
from eha_bench.core.near_miss import suggest
from eha_bench.core.place_unit import unit_at_place
from eha_bench.plants.network.element import ElementKind, NodeKind, Port
from eha_bench.plants.network.network import (
    NODE_PARAMETERS,
    QUANTITIES,
    UNITS,
    Driven,
    Element,
    Network,
    Node,
    element_kinds,
)
from eha_bench.plants.parameter import Parameter

NETWORK_KEYS = ("plant", "nodes", "elements", "inputs", "channels", "names", "assumed")
"""Keys of a plant.yaml that say what the plant is; a model's keys may be added."""

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_BETWEEN = ("first", "second")
_CYLINDERS = ("cylinder", "mid_stroke_of")
_HELD = {"hold": True, "linear": False}
Locate = Callable[..., Place]


def parse_network(content: Mapping[str, Any], locate: Locate) -> Network:
    """Return the network that a plant.yaml holds.

    Args:
        content: the YAML mapping, with lines. locate: keys -> the place in the file.

    Raises:
        InputError: an unknown key or kind, a wrong unit, an element on a node of the wrong kind,
            a node that nothing joins, a channel of a state that is not there.
    """
    return _Parser(content, locate).network()


class _Parser:
    def __init__(self, content: Mapping[str, Any], locate: Locate) -> None:
        self.content = content
        self.locate = locate

    def network(self) -> Network:
        name = self.content.get("plant")
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise InputError(
                f"'{name}' is not a name for a plant",
                where=self.locate("plant"),
                hint="a name has letters, digits and underscores, and begins with a letter",
            )
        nodes = {key: self.node(key, value) for key, value in self.section("nodes").items()}
        elements = {
            key: self.element(key, value, nodes) for key, value in self.section("elements").items()
        }
        if double := set(nodes) & set(elements):
            key = min(double)
            raise InputError(
                f"'{key}' names a node and an element",
                where=self.locate("elements", key),
                hint="give one of them another name",
            )
        self.refuse_unjoined(nodes, elements)
        for key, element in elements.items():
            self.check_refers(key, element, elements)
        inputs = {
            key: self.input(key, value, nodes, elements)
            for key, value in self.section("inputs", optional=True).items()
        }
        channels = {
            key: self.channel(key, value, nodes, elements)
            for key, value in self.section("channels").items()
        }
        self.one_meaning(inputs, channels)
        names = {
            key: self.targets(key, v) for key, v in self.section("names", optional=True).items()
        }
        assumed = {key: str(v) for key, v in self.section("assumed", optional=True).items()}
        source = {key: _plain(self.content[key]) for key in NETWORK_KEYS if key in self.content}
        return Network(name, nodes, elements, inputs, channels, names, assumed, source)

    def section(self, key: str, *, optional: bool = False) -> Mapping[str, Any]:
        value = self.content.get(key)
        if value is None:
            if optional:
                return {}
            raise InputError(f"key '{key}' is missing", where=self.locate())
        if not isinstance(value, Mapping) or (not value and not optional):
            raise InputError("expected names and what they are", where=self.locate(key))
        if key in {"nodes", "elements", "inputs", "channels"}:
            for name in value:
                if not isinstance(name, str) or not _NAME.fullmatch(name):
                    raise InputError(
                        f"'{name}' is not a name",
                        where=self.locate(key, name),
                        hint="a name has letters, digits and underscores, and begins with a letter",
                    )
        return value

    def kind(self, keys: Sequence[str], value: Any, known: Iterable[str]) -> str:
        if not isinstance(value, Mapping):
            raise InputError("expected a kind and its parameters", where=self.locate(*keys))
        if "kind" not in value:
            raise InputError(
                "key 'kind' is missing",
                where=self.locate(*keys),
                hint=f"one of {', '.join(sorted(known))}",
            )
        kind = value["kind"]
        if not isinstance(kind, str) or kind not in known:
            raise InputError(
                f"there is no kind '{kind}' of {keys[0][:-1]}",
                where=self.locate(*keys, "kind"),
                hint=suggest(str(kind), known),
            )
        return kind

    def node(self, name: str, value: Any) -> Node:
        kind = NodeKind(self.kind(("nodes", name), value, [item.value for item in NodeKind]))
        own = {item.name: item for item in NODE_PARAMETERS[kind]}
        stroke = None
        values = {}
        for key, raw in value.items():
            where = self.locate("nodes", name, key)
            if key == "kind":
                continue
            if key == "stroke" and kind in UNITS:
                stroke = self.stroke(raw, UNITS[kind]["position"], where)
            elif key in own:
                values[key] = _quantity(own[key], own[key].unit, raw, where)
            else:
                allowed = (*own, "stroke") if kind in UNITS else tuple(own)
                raise InputError(
                    f"a {kind} has no '{key}'", where=where, hint=suggest(key, allowed)
                )
        return Node(name, kind, values, stroke)

    def stroke(self, raw: Any, unit: str, where: Place) -> tuple[float, float]:
        if not isinstance(raw, (list, tuple)) or len(raw) != 2:
            raise InputError("expected two ends, as in [0 mm, 200 mm]", where=where)
        low, high = (_number(item, unit, where) for item in raw)
        if not low < high:
            raise InputError("the lower end comes first", where=where)
        return low, high

    def element(self, name: str, value: Any, nodes: Mapping[str, Node]) -> Element:
        keys = ("elements", name)
        kind = element_kinds()[self.kind(keys, value, element_kinds())]
        given = dict(value)
        if "between" in given and {port.name for port in kind.ports} == set(_BETWEEN):
            pair = given.pop("between")
            if not isinstance(pair, (list, tuple)) or len(pair) != 2:
                raise InputError(
                    "expected two nodes, as in [chamber_a, chamber_b]",
                    where=self.locate(*keys, "between"),
                )
            for port_name in _BETWEEN:
                if port_name in given:
                    raise InputError(
                        f"'between' already says what '{port_name}' joins",
                        where=self.locate(*keys, port_name),
                        hint="leave one of them out",
                    )
            given |= dict(zip(_BETWEEN, pair, strict=True))
        self.known_keys(name, kind, given)
        ports = {}
        for port in kind.ports:
            if port.name in given:
                where = self.locate(*keys, port.name if port.name in value else "between")
                ports[port.name] = self.port(name, kind, port, given[port.name], nodes, where)
            elif not port.optional:
                shown = "between" if port.name in _BETWEEN else port.name
                raise InputError(
                    f"key '{shown}' is missing: a {kind.id} joins nodes",
                    where=self.locate(*keys),
                    hint=f"nodes: {', '.join(nodes)}",
                )
        self.two_nodes(name, kind, ports)
        tokens = _tokens(ports, nodes)
        refers = {}
        values = {}
        for key, raw in given.items():
            if key == "kind" or key in ports:
                continue
            where = self.locate(*keys, key)
            parameter = kind.parameter(key)
            if key in kind.refers:
                refers[key] = str(raw)
            elif parameter is not None:
                unit = _unit(parameter, tokens)
                values[key] = (
                    _quantity(parameter, unit, raw, where)
                    if unit is not None
                    else _of_any_unit(raw, where)
                )
        for needed in kind.required:
            if needed not in values:
                raise InputError(
                    f"a {kind.id} needs '{needed}'",
                    where=self.locate(*keys),
                    hint=self._addition(kind, needed, tokens),
                )
        if kind.one_of and len(found := [one for one in kind.one_of if one in values]) != 1:
            names = " or ".join(f"'{one}'" for one in kind.one_of)
            raise InputError(
                f"a {kind.id} needs {names}" + (", and not both" if found else ""),
                where=self.locate(*keys),
                hint="leave one of them out"
                if found
                else self._addition(kind, kind.one_of[0], tokens),
            )
        return Element(name, kind, ports, values, refers)

    @staticmethod
    def _addition(kind: ElementKind, needed: str, tokens: Mapping[str, str]) -> str:
        """Return how a parameter that is missing is written."""
        parameter = kind.parameter(needed)
        unit = None if parameter is None else _unit(parameter, tokens)
        return f"add '{needed}: ... {unit}'" if unit else f"add '{needed}: ...'"

    def known_keys(self, name: str, kind: ElementKind, given: Mapping[str, Any]) -> None:
        """Refuse keys that an element of this kind does not have."""
        ports = [item.name for item in kind.ports]
        shown = ["between"] if set(ports) == set(_BETWEEN) else ports
        allowed = [*(item.name for item in kind.parameters), *kind.refers, *shown]
        for key in given:
            if key != "kind" and key not in allowed and key not in ports:
                raise InputError(
                    f"a {kind.id} has no '{key}'",
                    where=self.locate("elements", name, key),
                    hint=suggest(str(key), allowed),
                )

    def two_nodes(self, name: str, kind: ElementKind, ports: Mapping[str, str]) -> None:
        """Refuse an element whose two ends are one node: it would do nothing."""
        for one, other in (_BETWEEN, ("from", "to")):
            if one in ports and ports[one] == ports.get(other):
                raise InputError(
                    f"'{name}' joins '{ports[one]}' with itself",
                    where=self.locate("elements", name),
                    hint=f"a {kind.id} joins two nodes",
                )

    def port(
        self, name: str, kind: ElementKind, port: Port, raw: Any, nodes: Mapping[str, Node],
        where: Place,
    ) -> str:  # fmt: skip
        node = nodes.get(str(raw))
        if node is None:
            raise InputError(
                f"there is no node '{raw}'", where=where, hint=suggest(str(raw), nodes)
            )
        if node.kind not in port.kinds:
            fits = " or ".join(f"a {item}" for item in port.kinds)
            raise InputError(
                f"'{name}' is a {kind.id}: its '{port.name}' joins {fits}, "
                f"but '{raw}' is a {node.kind}",
                where=where,
            )
        return node.name

    def check_refers(self, name: str, element: Element, elements: Mapping[str, Element]) -> None:
        for key, other in element.refers.items():
            if other not in elements:
                raise InputError(
                    f"there is no element '{other}'",
                    where=self.locate("elements", name, key),
                    hint=suggest(other, elements),
                )
            if key in _CYLINDERS and elements[other].kind.id != "cylinder":
                raise InputError(
                    f"'{other}' is a {elements[other].kind.id}, no cylinder",
                    where=self.locate("elements", name, key),
                    hint="name the cylinder",
                )

    def refuse_unjoined(self, nodes: Mapping[str, Node], elements: Mapping[str, Element]) -> None:
        """Refuse nodes that nothing joins: no balance could move them."""
        used = {node for element in elements.values() for node in element.ports.values()}
        for name, node in nodes.items():
            if name not in used:
                raise InputError(
                    f"nothing joins the {node.kind} '{name}'",
                    where=self.locate("nodes", name),
                    hint="name it at an element's port, or leave it out",
                )

    def input(
        self, name: str, raw: Any, nodes: Mapping[str, Node], elements: Mapping[str, Element]
    ) -> Driven:
        where = self.locate("inputs", name)
        held: bool | None = None
        if isinstance(raw, Mapping):
            if set(raw) - {"to", "between_samples"} or "to" not in raw:
                raise InputError(
                    "expected {to: element.port, between_samples: hold or linear}", where=where
                )
            if "between_samples" in raw:
                word = str(raw["between_samples"])
                if word not in _HELD:
                    raise InputError(
                        f"'{word}' is not a choice", where=where, hint="hold or linear"
                    )
                held = _HELD[word]
            raw = raw["to"]
        of, port = _pair(raw, where)
        if of in elements:
            return Driven(of, port, held)
        if of in nodes and nodes[of].kind is NodeKind.RESERVOIR and port == "pressure":
            return Driven(of, port, held)
        if of in nodes:
            raise InputError(
                f"'{raw}' is a state: an input drives an element, or a reservoir's pressure",
                where=where,
                hint="name the state under `channels`; in dataset.yaml any channel may be an input",
            )
        raise InputError(
            f"there is no element '{of}'", where=where, hint=suggest(of, (*elements, *nodes))
        )

    def one_meaning(
        self, inputs: Mapping[str, Driven], channels: Mapping[str, tuple[str, str]]
    ) -> None:
        """Refuse two inputs of one port, and a name that means one thing here, another there."""
        driven: dict[tuple[str, str], str] = {}
        for name, item in inputs.items():
            other = driven.setdefault((item.of, item.port), name)
            if other != name:
                raise InputError(
                    f"'{other}' and '{name}' both drive '{item.of}.{item.port}'",
                    where=self.locate("inputs", name),
                    hint="leave one of them out",
                )
            shown = channels.get(name)
            if shown is not None and shown[0] != item.of:
                raise InputError(
                    f"'{name}' is also an input, of '{item.of}.{item.port}'",
                    where=self.locate("channels", name),
                    hint="give one of them another name",
                )

    def channel(
        self, name: str, raw: Any, nodes: Mapping[str, Node], elements: Mapping[str, Element]
    ) -> tuple[str, str]:
        where = self.locate("channels", name)
        of, quantity = _pair(raw, where)
        if of in nodes:
            known: Iterable[str] = QUANTITIES[nodes[of].kind]
            if quantity not in known:
                raise InputError(
                    f"a {nodes[of].kind} has no '{quantity}'",
                    where=where,
                    hint=f"it has: {', '.join(known)}",
                )
        elif of not in elements:
            raise InputError(
                f"there is no node or element '{of}'",
                where=where,
                hint=suggest(of, (*nodes, *elements)),
            )
        return of, quantity

    def targets(self, name: str, raw: Any) -> tuple[str, ...]:
        where = self.locate("names", name)
        items = raw if isinstance(raw, (list, tuple)) else [raw]
        return tuple(".".join(_pair(item, where)) for item in items)


def _pair(raw: Any, where: Place) -> tuple[str, str]:
    parts = str(raw).split(".")
    if len(parts) != 2 or not all(parts):
        raise InputError(f"'{raw}' is not of the form element.name", where=where)
    return parts[0], parts[1]


def _tokens(ports: Mapping[str, str], nodes: Mapping[str, Node]) -> dict[str, str]:
    """Return the units that depend on what the element joins."""
    kinds = [nodes[name].kind for name in ports.values() if nodes[name].kind in UNITS]
    if not kinds:
        return {}
    tokens = dict(UNITS[kinds[-1] if len(kinds) > 1 else kinds[0]])
    positions = [UNITS[kind]["position"] for kind in kinds]
    tokens["ratio"] = "" if len(set(positions)) == 1 else "/".join(positions)
    return tokens


def _unit(parameter: Parameter, tokens: Mapping[str, str]) -> str | None:
    """Return a parameter's unit, None where it depends on what another element does."""
    if "{command}" in parameter.unit:
        return None
    return unit_at_place(parameter.unit, tokens)


def _quantity(parameter: Parameter, unit: str, raw: Any, where: Place) -> float:
    value = _number(raw, unit, where)
    if refusal := parameter.refusal(value, unit):
        raise InputError(refusal, where=where)
    return value


def _of_any_unit(raw: Any, where: Place) -> float:
    """Return a number in SI whose unit depends on another element."""
    unit = units.unit_in(raw) if isinstance(raw, str) else ""
    try:
        return units.parse(raw, units.base_unit(unit) if unit else "")
    except UnitError as error:
        raise InputError(error.what, where=where, hint=error.hint) from error


def _number(raw: Any, unit: str, where: Place) -> float:
    if isinstance(raw, bool) or not isinstance(raw, (int, float, str)):
        raise InputError(f"expected a number or text such as '1 {unit}'", where=where)
    try:
        return units.parse(raw, unit)
    except UnitError as error:
        raise InputError(error.what, where=where, hint=error.hint) from error


def _plain(content: Any) -> Any:
    from eha_bench.core.yaml_file import plain

    return plain(content)
