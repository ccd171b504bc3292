"""A network as it was declared: nodes, elements between them, inputs and channels."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from eha_bench.core import plugins
from eha_bench.core.errors import PluginError
from eha_bench.plants.network.element import ElementKind, NodeKind
from eha_bench.plants.parameter import Parameter

_INF = float("inf")

NODE_PARAMETERS: Mapping[NodeKind, tuple[Parameter, ...]] = {
    NodeKind.ROTATION: (Parameter("inertia", "kg*m^2", 0.0, 0.0, _INF, "J"),),
    NodeKind.TRANSLATION: (Parameter("mass", "kg", 0.0, 0.0, _INF, "M"),),
    NodeKind.VOLUME: (
        Parameter("bulk_modulus", "Pa", 1e9, 1e3, _INF, "beta"),
        Parameter("volume", "m^3", 0.0, 0.0, _INF, "V", "in addition to what its cylinders hold"),
        Parameter("pressure", "Pa", 0.0, -1e5, _INF, "p_0", "at rest, where nothing measures it"),
    ),
    NodeKind.RESERVOIR: (Parameter("pressure", "Pa", 0.0, -1e5, _INF, "p"),),
}
"""What each kind of node may declare, besides the `stroke` of a translation or a rotation."""

UNITS: Mapping[NodeKind, Mapping[str, str]] = {
    NodeKind.ROTATION: {
        "effort": "N*m", "speed": "rad/s", "position": "rad", "damping": "N*m*s/rad",
        "inertia": "kg*m^2",
    },
    NodeKind.TRANSLATION: {
        "effort": "N", "speed": "m/s", "position": "m", "damping": "N*s/m", "inertia": "kg",
    },
}  # fmt: skip
"""Units of what depends on whether something turns or slides."""

QUANTITIES: Mapping[NodeKind, Mapping[str, str]] = {
    NodeKind.ROTATION: {"speed": "rad/s", "angle": "rad"},
    NodeKind.TRANSLATION: {"velocity": "m/s", "position": "m"},
    NodeKind.VOLUME: {"pressure": "Pa"},
    NodeKind.RESERVOIR: {"pressure": "Pa"},
}
"""What a channel may show of a node, and its unit."""


@dataclass(frozen=True)
class Node:
    """A node: its kind, what it declares (SI), and the ends of its stroke."""

    name: str
    kind: NodeKind
    values: Mapping[str, float] = field(default_factory=dict)
    stroke: tuple[float, float] | None = None


@dataclass(frozen=True)
class Element:
    """An element: its kind, the nodes at its ports, what it declares (SI) and refers to."""

    name: str
    kind: ElementKind
    ports: Mapping[str, str]
    values: Mapping[str, float] = field(default_factory=dict)
    refers: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Driven:
    """An input: the port of an element (or reservoir) that it drives.

    Attributes:
        of: element or node. port: as in `motor.current`.
        held: whether it keeps its value between samples; None: as the port's kind says.
    """

    of: str
    port: str
    held: bool | None = None


@dataclass(frozen=True)
class Network:
    """A plant as a network.

    Attributes:
        name: of the plant.
        nodes, elements: by name, in the order of the file.
        inputs: channel -> what it drives. channels: channel -> (node or element, quantity).
        names: name of a parameter -> what it stands for, as `element.parameter`.
        assumed: parameters whose value is a guess -> why it is this one.
        source: what the file says, as plain dicts and lists: to be written again.
    """

    name: str
    nodes: Mapping[str, Node]
    elements: Mapping[str, Element]
    inputs: Mapping[str, Driven]
    channels: Mapping[str, tuple[str, str]]
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    assumed: Mapping[str, str] = field(default_factory=dict)
    source: Mapping[str, Any] = field(default_factory=dict)

    @property
    def digest(self) -> str:
        """Digest of what the file says."""
        text = json.dumps(self.source, sort_keys=False)
        return hashlib.sha256(text.encode()).hexdigest()


@cache
def element_kinds() -> Mapping[str, ElementKind]:
    """Return the registered kinds of elements by id.

    Raises:
        PluginError: one of them is not an ElementKind.
    """
    return {name: element_kind(name) for name in plugins.names("elements")}


def element_kind(name: str) -> ElementKind:
    """Return the registered kind of elements of that id.

    Raises:
        PluginError: it cannot be loaded, or is not an ElementKind of that id.
    """
    kind = plugins.load("elements", name)
    if not isinstance(kind, ElementKind):
        raise PluginError(f"element '{name}' is not an ElementKind but {type(kind).__name__}")
    plugins.check_id("element", name, kind.id)
    return kind
