"""The JSON Schema of plant.yaml, from which editors complete: every kind, its keys and units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from eha_bench.plants.network.element import ElementKind
from eha_bench.plants.network.network import NODE_PARAMETERS, UNITS, element_kinds
from eha_bench.plants.parameter import Parameter

_BETWEEN = {"first", "second"}


def plant_schema(model: Mapping[str, Any]) -> dict[str, Any]:
    """Return the schema of plant.yaml.

    Args:
        model: that of model.yaml, whose keys may stand in a plant.yaml too.
    """
    own = dict(model)
    properties = {key: value for key, value in own["properties"].items() if key != "model"}
    properties["nodes"] = {
        "type": "object",
        "description": "what holds state, by name",
        "additionalProperties": {"oneOf": [_node(kind) for kind in NODE_PARAMETERS]},
    }
    properties["elements"] = {
        "type": "object",
        "description": "what joins nodes, by name",
        "additionalProperties": {"oneOf": [_element(kind) for kind in element_kinds().values()]},
    }
    for key in ("inputs", "channels", "names"):
        properties[key] = {**properties[key], "type": "object"}
        properties[key].pop("anyOf", None)
    own |= {
        "title": "PlantFile",
        "description": "plant.yaml: a plant as a network of nodes and elements.",
        "properties": properties,
        "required": ["plant", "nodes", "elements", "channels"],
    }
    return own


def _node(kind: Any) -> dict[str, Any]:
    keys: dict[str, Any] = {item.name: _quantity(item) for item in NODE_PARAMETERS[kind]}
    if kind in UNITS:
        keys["stroke"] = {
            "type": "array",
            "minItems": 2,
            "maxItems": 2,
            "items": {"type": ["number", "string"]},
            "description": f"ends of its motion, {UNITS[kind]['position']}",
        }
    return _object(str(kind), keys, ("kind",))


def _element(kind: ElementKind) -> dict[str, Any]:
    ports = {port.name for port in kind.ports}
    keys: dict[str, Any] = {}
    required = ["kind", *kind.required]
    if ports == _BETWEEN:
        keys["between"] = {
            "type": "array",
            "minItems": 2,
            "maxItems": 2,
            "items": {"type": "string"},
            "description": "two nodes",
        }
        required.append("between")
    else:
        for port in kind.ports:
            fits = " or ".join(str(item) for item in port.kinds)
            keys[port.name] = {"type": "string", "description": f"a node: {fits}"}
            if not port.optional:
                required.append(port.name)
    keys |= {item.name: _quantity(item) for item in kind.parameters}
    keys |= {name: {"type": "string", "description": "name of an element"} for name in kind.refers}
    one_of = [{"required": [name]} for name in kind.one_of]
    found = _object(kind.id, keys, tuple(required), kind.summary)
    return {**found, "oneOf": one_of} if one_of else found


def _quantity(parameter: Parameter) -> dict[str, Any]:
    unit = parameter.unit.replace("{", "").replace("}", "") or "a pure number"
    text = f"{parameter.symbol + ', ' if parameter.symbol else ''}{unit}"
    return {"type": ["number", "string"], "description": text}


def _object(
    kind: str, keys: Mapping[str, Any], required: tuple[str, ...], summary: str = ""
) -> dict[str, Any]:
    return {
        "type": "object",
        "description": summary or kind,
        "properties": {"kind": {"const": kind}, **keys},
        "required": list(required),
        "additionalProperties": False,
    }
