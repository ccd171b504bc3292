"""What inputs determine: which nodes of a network anything given to it moves."""

from __future__ import annotations

from collections.abc import Mapping

from eha_bench.plants.network.element import NodeKind
from eha_bench.plants.network.system import Coordinate, System

_WAYS = ("laminar_leakage", "turbulent_leakage", "orifice", "check_valve", "relief_valve",
         "pilot_check_valve")  # fmt: skip


def determined_nodes(
    system: System, states: Mapping[str, int], inputs: frozenset[str]
) -> frozenset[str]:
    """Return names of the nodes and elements whose motion or pressure inputs determine.

    A command moves its motor's shaft, a shaft moves the oil of its pumps, a valve that of its
    ports, oil finds its way through gaps and orifices, and moves the rod, or the shaft of a pump
    that no motor turns; never the other way, so that what nothing drives is not taken to rest. Oil
    that a pump or a valve moves in a way that nothing says is not known, whatever else joins it.

    Args:
        system: the network. states: channel -> place in `Y`. inputs: channels that are given.
    """
    nodes = system.network.nodes
    found: set[str] = set()
    places = {states[name] for name in inputs if name in states}
    for item in system.coordinates:
        if item.speed in places or item.position in places:
            found.add(item.name)
    imposed = set(found)
    for volume in system.volumes:
        if volume.pressure in places:
            found.add(volume.name)
    for part in system.parts.values():
        if any(
            f"{part.name}.{q.signal}" in system.signals
            and system.size <= states.get(channel, -1)
            and channel in inputs
            for channel, (of, quantity) in system.network.channels.items()
            for q in part.anatomy.quantities
            if of == part.name and q.name == quantity and q.signal
        ):
            found.add(part.name)
    for column in system.columns:
        if column.part is None or column.channel not in inputs:
            continue
        loop = column.part.anatomy.loop
        if column.command is not None:
            found.add(column.part.name)
        elif (
            loop is not None
            and column.signal == system.signals[f"{column.part.name}.{loop.reference}"]
        ):
            found.add(column.part.element.refers[loop.drives])
    found |= {name for name, node in nodes.items() if node.kind is NodeKind.RESERVOIR}
    _undriven(system, found)
    while True:
        before = len(found)
        _spread(system, found, imposed)
        if len(found) == before:
            return frozenset(found)


def _undriven(system: System, found: set[str]) -> None:
    """Add what moves by itself: a coordinate that nothing drives, such as a free pendulum."""
    for item in system.coordinates:
        drivers = [
            part
            for part in system.parts.values()
            if part.element.kind.id in ("motor", "linear_motor", "cylinder", "pump")
            and system.leader_of(part.element.ports["on"]) is item
        ]
        if not drivers and system.inertias(item):
            found.add(item.name)


def _has_motor(system: System, item: Coordinate) -> bool:
    """Whether an electric motor drives a coordinate."""
    return any(
        part.element.kind.id in ("motor", "linear_motor")
        and system.leader_of(part.element.ports["on"]) is item
        for part in system.parts.values()
    )


def _is_fed_unknown(system: System, node: str, found: set[str]) -> bool:
    """Whether a pump or a valve moves a node's oil, and nothing says how."""
    for part in system.parts.values():
        kind, ports = part.element.kind.id, part.element.ports
        if kind == "pump" and node in (ports["from"], ports["to"]):
            if system.leader_of(ports["on"]).name not in found:
                return True
        elif kind == "spool_valve" and node in ports.values() and part.name not in found:
            return True
    return False


def _spread(system: System, found: set[str], imposed: set[str]) -> None:
    for part in system.parts.values():
        kind, ports = part.element.kind.id, part.element.ports
        if kind in ("motor", "linear_motor") and part.name in found:
            found.add(system.leader_of(ports["on"]).name)
        elif kind == "pump":
            shaft, served = system.leader_of(ports["on"]), {ports["from"], ports["to"]}
            if shaft.name in found:
                found |= served
            elif served <= found and not _has_motor(system, shaft):
                found.add(shaft.name)  # the oil turns it
        elif kind == "spool_valve" and part.name in found:
            found |= {ports["a"], ports["b"]}
        elif kind == "cylinder":
            rod = system.leader_of(ports["on"]).name
            if {ports["a"], ports["b"]} <= found:
                found.add(rod)
        elif kind in _WAYS:
            ends = [node for port, node in ports.items() if port != "pilot"]
            # oil that has a way from where something is known
            if any(node in found for node in ends):
                found |= {node for node in ends if not _is_fed_unknown(system, node, found)}
    for joint, pair in system.elastic_joints():
        moved = {item.name for item in pair}
        # what one side moves, the other does, and the force between them is known
        if moved & found:
            found |= {*moved, joint.name}
    for node, chain in system.leaders.items():
        if chain[-1] in found:
            found.add(node)
    for part in system.parts.values():
        # what a motor draws is known where its shaft is
        if part.element.kind.id in ("motor", "linear_motor", "spool_valve") and part.name in found:
            found.add(part.name)
    del imposed
