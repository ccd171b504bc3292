"""Channels of a network: states, units and roles, by the nodes and elements that they show."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from eha_bench.plants.channel_roles import ChannelRoles
from eha_bench.plants.network.element import NodeKind
from eha_bench.plants.network.system import System, Volume

_READ_BACK = "current"
"""The known channel of a motor's current as it is measured, not as it is asked for."""


def imposable_signals(system: System) -> list[tuple[str, int]]:
    """Return the outputs that are signals, (channel, place in `S`): a drive may impose them."""
    return [(item.channel, item.signal) for item in system.outputs if item.signal >= 0]


def shown_motions(system: System) -> tuple[str, ...]:
    """Return the channels that show how parts move, one of which a drive may impose.

    A part without inertia moves only as it is made to: beside one, no other is imposed.
    """
    left = [item for item in system.coordinates if not system.inertias(item)]
    may = system.coordinates if not left else left if len(left) == 1 else ()
    moving = {place for item in may for place in (item.speed, item.position)}
    return tuple(item.channel for item in system.outputs if item.state in moving)


def places_of_states(system: System) -> dict[str, int]:
    """Return states by the channel that shows them, or by node and quantity.

    Signals that may be imposed come behind the states.
    """
    shown, found = system.shown, {}
    taken = {*shown.values(), *(column.channel for column in system.columns)}

    def unshown(node: str, quantity: str) -> str:
        name = f"{node}_{quantity}"
        return f"{node}.{quantity}" if name in taken else name  # a channel shows another node so

    for item in system.coordinates:
        turning = item.node.kind is NodeKind.ROTATION
        names = ("speed", "angle") if turning else ("velocity", "position")
        for place, name in zip((item.speed, item.position), names, strict=True):
            found[shown.get(place) or unshown(item.name, name)] = place
    for volume in system.volumes:
        found[shown.get(volume.pressure) or unshown(volume.name, "pressure")] = volume.pressure
    for number, (channel, _) in enumerate(imposable_signals(system)):
        found[channel] = system.size + number
    return found


def facing_volumes(system: System) -> tuple[Volume, Volume] | None:
    """Return the volumes whose difference and sum are looked at: a cylinder's, else a pump's."""
    for kind, ports in (("cylinder", ("a", "b")), ("pump", ("to", "from"))):
        for part in system.parts.values():
            if part.element.kind.id != kind:
                continue
            first, second = (part.element.ports[port] for port in ports)
            if first != second and {first, second} <= set(system.volume_of):
                return system.volume_of[first], system.volume_of[second]
    return None


def units_of_channels(system: System, state_places: Mapping[str, int]) -> dict[str, str]:
    """Return the SI unit of every output, derived channel, state and input."""
    found = {item.channel: item.unit for item in system.columns}
    found |= {item.channel: item.unit for item in system.outputs}
    found |= {channel: unit for channel, (_, _, unit) in system.derived.items()}
    for name, place in state_places.items():
        found.setdefault(name, _unit_of_state(system, place))
    return found


def _unit_of_state(system: System, place: int) -> str:
    for item in system.coordinates:
        if place in (item.speed, item.position):
            unit = "rad" if item.node.kind is NodeKind.ROTATION else "m"
            return unit if place == item.position else f"{unit}/s"
    return "Pa"


def roles_of_channels(
    system: System,
    shown: Collection[str],
    state_places: Mapping[str, int],
    units: Mapping[str, str],
) -> ChannelRoles:
    """Return what the channels of a network are.

    Args:
        system: the network. shown: nodes and elements that a channel shows.
        state_places: state -> place in `Y`. units: channel -> SI unit.
    """
    names = {place: name for name, place in state_places.items()}
    rates = {item.name: names[item.speed] for item in system.coordinates}
    positions = {item.name: names[item.position] for item in system.coordinates}
    locked = [
        name
        for item in system.coordinates
        if item.number in system.locked_coordinates
        for name in (positions[item.name], rates[item.name])
    ]
    locked += [
        channel
        for channel, (node, _, _) in system.derived.items()
        if system.leader_of(node).number in system.locked_coordinates
    ]
    locked += [
        output.channel
        for output, item in system.geared_channels()
        if item.number in system.locked_coordinates
    ]
    commands = {column.signal: column.channel for column in system.columns if column.command}
    asked = [column.channel for column in system.columns if column.held and column.command]
    # by its name a current was read back, whatever it drives, so it has a sensor's noise
    read_back = [name for name in asked if name == _READ_BACK]
    held = [name for name in asked if name != _READ_BACK]
    held += [
        column.channel for column in system.columns
        if column.held and column.part is not None and column.part.anatomy.loop is not None
    ]  # fmt: skip
    references = [item.channel for item in system.columns if system.is_followed(item)]
    on_top = [
        column.channel
        for column in system.columns
        if column.part is not None
        and (loop := column.part.anatomy.loop) is not None
        and column.signal == system.signals[f"{column.part.name}.{loop.added}"]
    ]
    acting = {
        item.channel: commands[item.signal]
        for item in system.outputs
        if item.signal in commands and item.command < 0
    }
    looped = [item.channel for item in system.outputs if item.command >= 0]
    pressures = tuple(names[volume.pressure] for volume in system.volumes)
    pair = next(
        (
            (names[system.volume_of[part.element.ports["a"]].pressure],
             names[system.volume_of[part.element.ports["b"]].pressure])
            for part in system.parts.values()
            if part.element.kind.id == "cylinder"
            and {part.element.ports["a"], part.element.ports["b"]} <= set(system.volume_of)
        ),
        (),
    )  # fmt: skip
    facing = facing_volumes(system)
    reservoirs = [column.channel for column in system.pressure_inputs]
    forces = [
        column.channel
        for column in system.columns
        if column.part is not None and column.part.element.kind.id == "load"
    ]
    turning = {
        rates[item.name]: positions[item.name]
        for item in system.coordinates
        if item.node.kind is NodeKind.ROTATION
        and not any(out.state == item.position for out in system.outputs)
    }
    read = {output.state for output in system.outputs}
    geared, geared_rates, geared_rate_of = {}, [], {}
    for output, item in system.geared_channels():
        moving = output.quantity in ("speed", "velocity")
        state = names[item.speed if moving else item.position]
        geared[output.channel] = state, system.declared_ratio(output.of)
        if moving:
            geared_rates.append(output.channel)
        else:
            geared_rate_of[output.channel] = rates[item.name]
            read.add(item.position)
    joined = [
        end for part, ends in system.elastic_joints() if part.name not in shown for end in ends
    ]
    bent = [positions[item.name] for item in joined if item.position not in read]
    return ChannelRoles(
        rates=(*rates.values(), *geared_rates),
        rate_of={**{positions[name]: rates[name] for name in positions}, **geared_rate_of},
        geared=geared,
        turning=turning,
        pressures=pressures,
        pair=pair,
        facing=() if facing is None else (names[facing[0].pressure], names[facing[1].pressure]),
        commands=tuple(dict.fromkeys((*held, *references))),
        remembered=tuple(
            column.channel
            for column in system.columns
            if column.command and column.part and column.part.element.kind.id == "spool_valve"
        ),
        followed=tuple(references),
        on_top=tuple(on_top),
        acting=acting,
        limited=(*acting, *looped),
        bent=tuple(bent),
        locked=tuple(locked),
        read_back=tuple(read_back),
        added_up=(
            *acting,
            *read_back,
            *rates.values(),
            *pressures,
            *reservoirs,
            "pressure_difference",
        ),
        added_up_by_rod=tuple(forces),
        volumes=tuple(item.name for item in system.volumes),
        units=units,
    )
