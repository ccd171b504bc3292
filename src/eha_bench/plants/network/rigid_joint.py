"""Joints that a network takes for rigid, and the network with an elastic coupling in one of them.

Two kinds of joints are found: that of a gear, with the shaft that it turns on one side and the rest
on the other; and that between a shaft (or rod) with a mass of its own and the elements of some mass
that it carries, with what pulls from outside. Where either side weighs nothing there is nothing
that could swing.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.network.element import Inertia
from eha_bench.plants.network.network import QUANTITIES, Element, Network, Node, element_kinds
from eha_bench.plants.network.system import BoundElement, System

_LOAD_PORT = "on"
_COUPLING, _END = "~coupling", "~end"
"""Behind the name of a joint: what no file can call anything."""


@dataclass(frozen=True)
class Weight:
    """What a node, or an element on it, adds to the inertia of a coordinate.

    Attributes:
        factor: of the ratio to the coordinate, squared. law: parameters -> inertia, at the node.
        places: of these in the plant's vector.
    """

    factor: float
    law: Callable[..., float]
    places: tuple[int, ...]

    def at(self, values: FloatArray) -> float:
        """Return it for a plant's vector of parameters."""
        return self.factor * self.law(*(float(values[place]) for place in self.places))


@dataclass(frozen=True)
class RigidJoint:
    """A joint that is taken for rigid.

    Attributes:
        name: of the gear, or of the node that carries masses.
        node: the coordinate on this side of it, whose sensors stay there.
        moved: element and port that are on the other side.
        sides: what either side weighs, at the coordinate.
    """

    name: str
    node: str
    moved: tuple[tuple[str, str], ...]
    sides: tuple[tuple[Weight, ...], tuple[Weight, ...]]

    def inertia(self, values: FloatArray) -> float:
        """Return the smaller inertia of both sides for a plant's vector of parameters."""
        return min(sum(weight.at(values) for weight in side) for side in self.sides)

    @property
    def end(self) -> str:
        """Name of the node on the other side, once it moves by itself."""
        return f"{self.name}{_END}"

    @property
    def coupling(self) -> str:
        """Name of the element between both sides, once they move apart."""
        return f"{self.name}{_COUPLING}"


def rigid_joints(system: System) -> Iterator[RigidJoint]:
    """Yield the joints that a network takes for rigid, with masses on both sides as declared."""
    declared = np.array([item.default for item in system.parameters])
    yield from (joint for joint in _joints(system) if joint.inertia(declared) > 0.0)


def _joints(system: System) -> Iterator[RigidJoint]:
    """Yield all joints that something is beyond, whatever it weighs."""
    for item in system.coordinates:
        for part in system.parts.values():
            if part.element.kind.id == "gear" and part.element.ports["to"] == item.name:
                beyond = _turned_by(system, part)
                here = [node for node in system.nodes_on(item) if node not in beyond]
                name = part.element.name
                sides = _weights_of(system, here), _weights_of(system, beyond)
                yield RigidJoint(name, item.name, ((name, "to"),), sides)
        carried = tuple((part.name, term.port) for part, term in _weights(system, item.name))
        if carried:
            # what pulls from outside pulls at what is carried
            carried += tuple(
                (part.name, _LOAD_PORT)
                for part in system.parts.values()
                if part.element.kind.id == "load" and part.element.ports[_LOAD_PORT] == item.name
            )
            behind = [node for node in system.nodes_on(item) if node != item.name]
            this = *_own(system, item.name), *_weights_of(system, behind)
            yield RigidJoint(item.name, item.name, carried, (this, (*_carried(system, item.name),)))


def _turned_by(system: System, gear: BoundElement) -> list[str]:
    """Return the nodes that move with what a gear turns."""
    first = gear.element.ports["from"]
    return [first, *(node for node, chain in system.leaders.items() if first in chain)]


def _weights(system: System, node: str) -> Iterator[tuple[BoundElement, Inertia]]:
    """Yield what adds inertia to a node, with its element."""
    for part in system.parts.values():
        for term in part.anatomy.contributions:
            if isinstance(term, Inertia) and part.element.ports[term.port] == node:
                yield part, term


def _weights_of(system: System, nodes: Sequence[str]) -> tuple[Weight, ...]:
    """Return what nodes weigh with what they carry."""
    return tuple(
        weight for node in nodes for weight in (*_own(system, node), *_carried(system, node))
    )


def _own(system: System, node: str) -> Iterator[Weight]:
    """Yield what a node itself weighs at its coordinate."""
    factor = system.declared_ratio(node) ** 2
    for key in ("inertia", "mass"):
        if (slot := system.slot_of.get(f"{node}.{key}")) is not None:
            yield Weight(factor, float, (system.index[slot],))


def _carried(system: System, node: str) -> Iterator[Weight]:
    """Yield what elements on a node add at its coordinate, by their own parameters."""
    factor = system.declared_ratio(node) ** 2
    for part, term in _weights(system, node):
        names = inspect.signature(term.law).parameters
        slots = [system.slot_of.get(f"{part.name}.{name}") for name in names]
        own = tuple(system.index[slot] for slot in slots if slot is not None)
        if len(own) == len(slots):
            yield Weight(factor, term.law, own)


def loosened(
    network: Network, joint: RigidJoint, sensors: str, declared: tuple[str, str]
) -> Network:
    """Return a network with an elastic coupling where a joint was taken for rigid.

    What is on the other side moves by itself then, as a node that comes last. So do channels that
    show the motion of both sides past every sensor (`motions_of`).

    Args:
        network: as declared. joint: in it.
        sensors: the node on whose side the sensors of the joint's node are: that or `joint.end`.
        declared: states of the speed and position of the joint's node: those of that side now.
    """
    kind = network.nodes[joint.node].kind
    moved: dict[str, dict[str, str]] = {}
    for name, port in joint.moved:
        moved.setdefault(name, {})[port] = joint.end
    elements = {
        name: replace(item, ports={**item.ports, **moved.get(name, {})})
        for name, item in network.elements.items()
    }
    elements[joint.coupling] = Element(
        joint.coupling,
        element_kinds()["coupling"],
        {"first": joint.node, "second": joint.end},
        {"stiffness": 1.0, "damping": 0.0, "play": 0.0},
    )
    shown = {
        channel: (sensors if of == joint.node else of, quantity)
        for channel, (of, quantity) in network.channels.items()
    }
    motions = {
        channel: (node, quantity)
        for node, channels in (
            (sensors, declared),
            *((node, motions_of(node)) for node in (joint.node, joint.end)),
        )
        for channel, quantity in zip(channels, QUANTITIES[kind], strict=True)
    }
    return replace(
        network,
        nodes={**network.nodes, joint.end: Node(joint.end, kind)},
        elements=elements,
        channels={**shown, **motions},
    )


def motions_of(node: str) -> tuple[str, str]:
    """Return the channels that show the speed and the position of a side past every sensor."""
    return f"{node}~speed", f"{node}~position"
