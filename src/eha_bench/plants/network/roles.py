"""Where in a network an effect may act: a walk over its coordinates, volumes, drives and sensors.

Each role is a function from a system to its places. What effects may name there is an expression
over the state that is shown to them (`X`), signals (`S`) and parameters (`P`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace

from eha_bench.core.errors import PluginError
from eha_bench.core.near_miss import suggest
from eha_bench.plants.effect import POSITION_LOOP, Effect, Equation, Hook, Spot
from eha_bench.plants.network.channels import facing_volumes, places_of_states
from eha_bench.plants.network.element import Friction, NodeKind
from eha_bench.plants.network.network import UNITS
from eha_bench.plants.network.rigid_joint import rigid_joints
from eha_bench.plants.network.system import (
    BoundElement,
    Coordinate,
    PlantInput,
    System,
    Volume,
    at_coordinate,
)

_STATE = re.compile(r"\b([vxp])(\d+)\b")
_TIME = re.compile(r"\bt\b")
_USUAL_PRESSURE = 1e6
_PIN = 2e7
"""Stiffness of a rod's hardened pin, N/m."""
_BENT, _ARM = 1e-3, 0.03
"""By how much a joint is bent by what is usual there, rad, and of a rod as at such an arm, m."""
_STRONG = 30.0
"""What accelerates a mass, in efforts that matter there."""
_CONTACT = 1e3
"""How fast a shaft swings on the teeth that it leans on, rad/s: faster asks for shorter steps."""

HOLDING = "holding"
"""The role of a balance at standstill, which no network has: see `pump_hold`."""
_ELSEWHERE = {
    HOLDING: "a pump that holds a pressure at standstill",
    "command_path": "the way of the command of a plant in Python",
    "sensor": "a sensor of a plant in Python",
}
"""Roles that no network has, with what plays them."""


def roles_of(system: System) -> dict[str, tuple[Spot, ...]]:
    """Return the places of every role in a system."""
    return {name: tuple(find(system)) for name, find in _ROLES.items()}


def refuse_unknown_roles(effects: Iterable[Effect]) -> None:
    """Refuse an effect that acts on a role that nothing plays, in no plant.

    Raises:
        PluginError: one does.
    """
    known = [*_ROLES, *_ELSEWHERE]
    for effect in effects:
        for role in effect.actions:
            if role not in known:
                raise PluginError(
                    f"effect '{effect.id}' acts on the role '{role}', which there is not",
                    hint=suggest(role, known),
                )


def role_summary(role: str) -> str:
    """Return what plays a role, in a few words."""
    if role in _ELSEWHERE:
        return _ELSEWHERE[role]
    text = (_ROLES[role].__doc__ or "").strip().splitlines()[0].removesuffix(".")
    return text[:1].lower() + text[1:]


# --- expressions -----------------------------------------------------------------------------


def shown_expression(system: System, expression: str) -> str:
    """Return an expression over states as one over what is shown to effects."""
    places = {name: place for place, name in enumerate(system.state_names)}
    text = _STATE.sub(lambda m: f"X[{places[m[0]]}]", expression)
    return _TIME.sub("S[1]", text)


def _balance(item: Coordinate) -> Equation:
    return Equation.TORQUE if item.node.kind is NodeKind.ROTATION else Equation.FORCE


def _motion(system: System, item: Coordinate) -> dict[str, str]:
    call = ", ".join([*system.state_names, "t", "X", "P", "S"])
    return {
        "speed": f"X[{item.speed}]",
        "position": f"X[{item.position}]",
        "t": "S[1]",
        "inertia": shown_expression(system, f"mass{item.number}({call})"),
        "drive": shown_expression(system, f"drive{item.number}({call})"),
        "load": shown_expression(system, f"outside{item.number}({call})"),
        "slow": repr(25.0 * _usual_position(system, item)),
        "oil_temperature": f"S[{system.signals['oil_temperature']}]",
    }


def _on(system: System, item: Coordinate, kind: str) -> list[BoundElement]:
    """Return the elements of a kind that act on a coordinate."""
    return [
        part
        for part in system.parts.values()
        if part.element.kind.id == kind
        and "on" in part.element.ports
        and system.leader_of(part.element.ports["on"]) is item
    ]


def _default(system: System, owner: str, name: str) -> float:
    """Return what a node or an element declares, 0 where it has no such parameter."""
    return system.declared(owner, name) or 0.0


def usual_effort(system: System, item: Coordinate) -> float:
    """Return a force (or torque) that matters at a coordinate, N (or N*m)."""
    level = sum(_default(system, name, "coulomb") * ratio for name, ratio in _rubbing(system, item))
    return level if level > 0.0 else _driving_effort(system, item) or 1.0


def _driving_effort(system: System, item: Coordinate) -> float:
    """Return a part of what may drive a coordinate that matters, N (or N*m); 0 for none."""
    found = [0.0]
    for part in system.parts.values():
        port = part.element.ports.get("on", "")
        if port not in system.network.nodes or system.network.nodes[port].kind not in UNITS:
            continue
        if system.leader_of(port) is not item:
            continue
        kind = part.element.kind.id
        ratio = _ratio(system, port)
        if kind == "motor":
            torque = _default(system, part.name, "torque_constant")
            resistance = _default(system, part.name, "resistance")
            limit = _default(system, part.name, "current_limit")
            supply = _default(system, part.name, "supply_voltage") or 12.0
            current = supply / resistance if resistance else min(limit, 10.0) or 1.0
            found.append(0.03 * torque * current * ratio)
        elif kind == "linear_motor":
            found.append(0.5 * _default(system, part.name, "force_constant") * ratio)
        elif kind == "cylinder":
            found.append(0.1 * _USUAL_PRESSURE * _default(system, part.name, "area_a") * ratio)
        elif kind == "pump":
            found.append(
                0.3 * _USUAL_PRESSURE * _default(system, part.name, "displacement") * ratio
            )
        elif kind == "pendulum":
            weight = _default(system, part.name, "mass") * _default(system, part.name, "gravity")
            found.append(0.05 * weight * _default(system, part.name, "length") * ratio)
    return max(found)


def usual_flow(system: System) -> float:
    """Return a flow that matters, m^3/s: a hundredth of what pump or valve may move."""
    found = []
    for part in system.parts.values():
        kind = part.element.kind.id
        if kind == "pump":
            found.append(0.01 * _default(system, part.name, "displacement") * 100.0)
        elif kind == "spool_valve":
            found.append(
                0.01 * _default(system, part.name, "flow_gain") * 0.1 * _USUAL_PRESSURE**0.5
            )
        elif kind == "cylinder":
            found.append(0.01 * _default(system, part.name, "area_a") * 0.05)
    return found[0] if found else 1e-7


def _ratio(system: System, node: str) -> float:
    """Return how fast a node moves relative to its coordinate, where a gear says so."""
    return abs(system.declared_ratio(node))


def _rubbing(system: System, item: Coordinate) -> list[tuple[str, float]]:
    """Return the elements that rub on a coordinate, each with how fast it moves relative to it."""
    return [
        (part.name, _ratio(system, part.element.ports[term.port]))
        for part, term, _ in system.terms(item, Friction)
    ]


def _usual_position(system: System, item: Coordinate) -> float:
    """Return a way over which dry friction may yield, m (or rad)."""
    if item.node.kind is NodeKind.TRANSLATION:
        return 2e-4
    for part in _on(system, item, "pump"):
        area = next(
            (_default(system, other.name, "area_a") for other in system.parts.values()
             if other.element.kind.id == "cylinder"), 0.0,
        )  # fmt: skip
        if area:
            # the turn of the pump that moves its piston so far
            turn = 2e-4 * area / _default(system, part.name, "displacement")
            return turn / _ratio(system, part.element.ports["on"])
    return 0.01


def _usual_speed(system: System, item: Coordinate, effort: float) -> float:
    """Return a speed that matters, m/s or rad/s: there viscous friction is as large as the rest."""
    damping = sum(
        _default(system, name, "viscous") * ratio**2 for name, ratio in _rubbing(system, item)
    )
    if damping > 0.0:
        return effort / damping
    return 0.1 if item.node.kind is NodeKind.TRANSLATION else 10.0


def _usual(system: System, item: Coordinate) -> dict[str, float]:
    effort, position = usual_effort(system, item), _usual_position(system, item)
    speed = _usual_speed(system, item, effort)
    stribeck = 5e-3 if item.node.kind is NodeKind.TRANSLATION else 0.3
    declared = [
        _default(system, name, "stribeck_speed") / ratio for name, ratio in _rubbing(system, item)
    ]
    return {
        "effort": effort,
        "position": position,
        "speed": speed,
        "damping": effort / speed,
        "stribeck": max([stribeck if not any(declared) else 0.0, *declared]),
    }


def _coordinate_hooks(item: Coordinate) -> dict[str, tuple[Hook, ...]]:
    name = item.name
    return {
        "dry": (Hook(f"dry:{name}", {"bent": "@presliding_friction.bristle"}),),
        "sticks": (Hook(f"sticks:{name}"),),
        "viscous": (Hook(f"viscous:{name}"),),
        "net": (Hook(f"net:{name}"),),
        "load": (Hook(f"load:{name}"),),
        "inertia": (Hook(f"inertia:{name}"),),
    }


def _frictions(system: System, item: Coordinate) -> tuple[str, ...]:
    return tuple(part.name for part, _, _ in system.terms(item, Friction))


def _spot(
    system: System, item: Coordinate, more: Mapping[str, str] | None = None,
    parameters: Mapping[str, str] | None = None,
) -> Spot:  # fmt: skip
    return Spot(
        item.name,
        _balance(item),
        _coordinate_hooks(item),
        {**_motion(system, item), **(more or {})},
        {**UNITS[item.node.kind], "stribeck": UNITS[item.node.kind]["speed"]},
        _usual(system, item),
        parameters or {},
        _frictions(system, item),
        motion=_motion_channels(system, item),
    )


# --- roles -----------------------------------------------------------------------------------


def _friction(system: System) -> Iterator[Spot]:
    """Everything that moves: its friction."""
    for item in system.coordinates:
        if not system.inertias(item):
            continue
        parts = [part for part, term, _ in system.terms(item, Friction) if term.level is not None]
        slots: dict[str, str] = {}
        for name in ("coulomb", "static"):
            own = [key for part in parts if (key := system.slot_of.get(f"{part.name}.{name}"))]
            slots.update({name: own[0]} if own else {})
        yield _spot(system, item, parameters=slots)


def _pump_friction(system: System) -> Iterator[Spot]:
    """A shaft that turns a pump."""
    for item in system.coordinates:
        pumps = _on(system, item, "pump")
        if pumps and system.inertias(item):
            loads = [
                f"abs({system.ratio(part.element.ports['on']) or '1.0'} * "
                f"{system.parameter(part.name, 'displacement')} * "
                f"({system.pressure(part.element.ports['to'])} - "
                f"{system.pressure(part.element.ports['from'])}))"
                for part in pumps
            ]
            yield _spot(system, item, {"pump_load": shown_expression(system, " + ".join(loads))})


def _rod(system: System) -> Iterator[Spot]:
    """A rod that a cylinder moves."""
    for item in system.coordinates:
        for part in _on(system, item, "cylinder")[:1]:
            ports = part.element.ports
            ratio = system.ratio(ports["on"])
            yield _spot(
                system,
                item,
                {
                    "ratio": f"abs({shown_expression(system, ratio)})" if ratio else "1.0",
                    "p_a": shown_expression(system, system.pressure(ports["a"])),
                    "p_b": shown_expression(system, system.pressure(ports["b"])),
                    "area_a": str(system.parameter(part.name, "area_a")),
                    "area_b": str(system.parameter(part.name, "area_b")),
                },
            )


def _turning_motor(system: System) -> Iterator[Spot]:
    """A motor with a rotor, and the shaft that its gear turns."""
    for part, spot in _motors(system):
        if part.element.kind.id != "motor":
            continue
        yield spot
        node = part.element.ports["on"]
        item = system.leader_of(node)
        if item.name != node and item.node.kind is NodeKind.ROTATION:
            names = {"angle": f"X[{item.position}]", "ratio": "1.0"}
            yield replace(_spot(system, item, names), angle=system.channel_showing(item.position))


def _motor(system: System) -> Iterator[Spot]:
    """A motor: its torque, and the angle of its own shaft."""
    for _, spot in _motors(system):
        yield spot


def _motors(system: System) -> Iterator[tuple[BoundElement, Spot]]:
    for part in system.parts.values():
        if part.element.kind.id not in ("motor", "linear_motor"):
            continue
        node = part.element.ports["on"]
        item = system.leader_of(node)
        if not system.inertias(item):
            continue
        current = next(q for q in part.anatomy.quantities if q.name in ("current", "voltage"))
        ratio = system.ratio(node)
        names = {
            **_motion(system, item),
            "angle": shown_expression(system, system.position(node)),
            "current": shown_expression(system, system.call(part, current.law)),
            "ratio": shown_expression(system, ratio) if ratio else "1.0",
            "torque_constant": str(
                system.parameter(part.name, "torque_constant")
                or system.parameter(part.name, "force_constant")
            ),
        }
        yield part, Spot(
            part.name,
            Equation.ACTUATION,
            {
                "torque": (Hook(f"torque:{part.name}"),),
                "net": (Hook(f"net:{item.name}"),),
            },
            names,
            {"current": current.unit, "effort": UNITS[system.network.nodes[node].kind]["effort"],
             "per_current": f"1/{current.unit}"},
            {"effort": usual_effort(system, item) / _ratio(system, node),
             "per_current": 1.0 / _largest_current(system, part)},
            also=(node,),
        )  # fmt: skip


def _largest_current(system: System, part: BoundElement) -> float:
    """Return about the largest current (or voltage) of a motor."""
    resistance = _default(system, part.name, "resistance")
    if resistance:
        return (_default(system, part.name, "supply_voltage") or 12.0) / resistance
    limit = _default(system, part.name, "current_limit") or _default(
        system, part.name, "voltage_limit"
    )
    return limit if limit < 1e4 else 10.0


def _geared(system: System) -> Iterator[Spot]:
    """A coordinate that a motor drives: what loads its gear or its screw."""
    for item in system.coordinates:
        driven = [*_on(system, item, "motor"), *_on(system, item, "linear_motor")]
        if driven and system.inertias(item) and not _on(system, item, "pump"):
            yield _spot(system, item)


def _drives(system: System) -> Iterator[tuple[PlantInput, BoundElement]]:
    for column in system.columns:
        if column.command is not None and column.part is not None:
            yield column, column.part


def _motor_drive(system: System) -> Iterator[Spot]:
    """The drive of a motor."""
    for spot in _drive(system):
        part = system.parts[spot.name]
        if part.element.kind.id not in ("motor", "linear_motor"):
            continue
        # of a voltage, what is commanded is not what makes the torque
        words = {"place": ("drive",)} if _is_voltage_driven(part) else {}
        yield replace(spot, words=words)


def _voltage_drive(system: System) -> Iterator[Spot]:
    """The drive of a motor by a voltage: the current in its winding follows from that."""
    for spot in _drive(system):
        part = system.parts[spot.name]
        current = next((q for q in part.anatomy.quantities if q.name == "current"), None)
        if part.element.kind.id != "motor" or current is None or not _is_voltage_driven(part):
            continue
        winding = {
            "winding": shown_expression(system, system.call(part, current.law)),
            "torque_constant": str(system.parameter(part.name, "torque_constant")),
        }
        reads = tuple(
            Hook(f"reading:{item.channel}")
            for item in system.outputs
            if (item.of, item.quantity) == (part.name, "current")
        )
        yield replace(
            spot, names={**spot.names, **winding}, hooks={**spot.hooks, "read_current": reads}
        )


def _is_voltage_driven(part: BoundElement) -> bool:
    """Whether a motor's current follows from a voltage and its speed."""
    return "resistance" in {item.name for item in part.anatomy.parameters}


def _valve_drive(system: System) -> Iterator[Spot]:
    """The drive of a valve."""
    kinds = {part.name: part.element.kind.id for part in system.parts.values()}
    for spot in _drive(system):
        if kinds[spot.name] == "spool_valve":
            yield spot


def _drive(system: System) -> Iterator[Spot]:
    """A drive: the way of a command until it acts."""
    for column, part in _drives(system):
        assert column.command is not None
        name = part.name
        hooks = {
            "command": (Hook(f"command:{name}", {"t": "now", "commands": "inputs"}),),
            "demand": (Hook(f"demand:{name}"),),
            "drive": (Hook(f"drive:{name}"),),
        }
        usual = _usual_command(system, column, part)
        if any(item.channel == column.channel for item in system.outputs if item.command >= 0):
            hooks["asked"] = (Hook(f"asked:{column.channel}"),)
        if part.element.kind.id in ("motor", "linear_motor"):
            hooks["torque"] = (Hook(f"torque:{name}"),)
        if part.element.kind.id == "spool_valve":
            hooks["opening"] = (Hook(f"opening:{name}"),)
        yield Spot(
            name,
            Equation.ACTUATION,
            hooks,
            {
                "demanded": f"S[{system.demand(part, column.command)}]",
                "asked": f"S[{system.drive_demand(part, column.command)}]",
                "current": f"S[{column.signal}]",
                "t": "S[1]",
                "full": repr(float(usual)),
            },
            {"command": column.unit},
            {"command": usual},
        )


def _usual_command(system: System, column: PlantInput, part: BoundElement) -> float:
    """Return a command that matters, in its unit."""
    if column.command is not None and column.command.limit:
        limit = _default(system, part.name, column.command.limit)
        if 0.0 < limit < 1e3:
            return limit
    return 10.0


def _position_loop(system: System) -> Iterator[Spot]:
    """A position loop inside a drive or a smart servo, which is given a reference."""
    for number, (name, (part, loop, driven, command)) in enumerate(system.loops.items()):
        place = system.signals[f"{name}.{loop.reference}"]
        references = [c.channel for c in system.columns if c.part is part and c.signal == place]
        if not references:
            continue
        column = system.columns[system.column_for(driven, command)]
        node = part.element.ports[loop.reads]
        units = UNITS[system.network.nodes[node].kind]
        full = _usual_command(system, column, driven)
        # the error of which it asks for all that its drive gives
        error = full / (_gain_of_loop(system, name) or full)
        yield Spot(
            name,
            Equation.ACTUATION,
            {
                "reference": (Hook(f"reference:{name}", {"t": "now", "commands": "inputs"}),),
                "loop_command": (Hook(f"loop_command:{name}"),),
            },
            {
                "asked": f"S[{place}]",
                "error": f"S[{system.loop_error(name)}]",
                "by_law": f"S[{system.loop_law(name)}]",
                "holding": f"holding{number}(X, P, S)" if system.held_by(name) else "0.0",
                "t": "S[1]",
            },
            {"command": column.unit, "position": units["position"], "speed": units["speed"]},
            {"command": full, "position": error, "speed": _top_speed(system, driven, node)},
            also=(node,),
            motion=_motion_channels(system, system.leader_of(node)),
            reference=references[0],
        )


def _gain_of_loop(system: System, loop: str) -> float:
    """Return what a position loop asks for, by what its position is off; 0 where it has no gain."""
    cascade = _default(system, loop, "position_gain") * _default(system, loop, "velocity_gain")
    return cascade or _default(system, loop, "proportional")


def _top_speed(system: System, motor: BoundElement, node: str) -> float:
    """Return about the largest speed of a node that a motor drives, m/s or rad/s."""
    own = motor.element.ports["on"]
    constant = _default(system, motor.name, "torque_constant") or _default(
        system, motor.name, "force_constant"
    )
    supply = _default(system, motor.name, "supply_voltage") or 12.0
    turns = _ratio(system, own) / (_ratio(system, node) or 1.0)
    if _is_voltage_driven(motor) and constant and turns:
        return supply / (constant * turns)
    return 1.0 if system.network.nodes[node].kind is NodeKind.TRANSLATION else 10.0


def _valve(system: System) -> Iterator[Spot]:
    """A servo valve."""
    for part in system.parts.values():
        if part.element.kind.id != "spool_valve":
            continue
        ports = part.element.ports
        hooks: dict[str, tuple[Hook, ...]] = {"opening": (Hook(f"opening:{part.name}"),)}
        for port in ("supply", "tank", "a", "b"):
            volume = system.volume_of.get(ports[port])
            hooks[f"inflow_{port}"] = (Hook(f"inflow:{volume.name}"),) if volume else ()
            hooks[f"ground_{port}"] = (Hook(f"ground:{volume.name}"),) if volume else ()
        names = {
            f"p_{port}": shown_expression(system, system.pressure(node))
            for port, node in ports.items()
        }
        names |= {
            "opening": f"S[{system.signals[f'{part.name}.opening']}]",
            "flow_gain": str(system.parameter(part.name, "flow_gain")),
            "laminar_pressure": str(system.parameter(part.name, "laminar_pressure")),
            "t": "S[1]",
        }
        slots = {"null_bias": system.slot_of[f"{part.name}.null_bias"]}
        yield Spot(part.name, Equation.FLOW, hooks, names, parameters=slots)


def _volume(system: System) -> Iterator[Spot]:
    """A volume of oil under its own bulk modulus."""
    for item in system.volumes:
        if system.parameter(item.name, "bulk_modulus") is None:
            continue
        yield _volume_spot(system, item)


def _volume_spot(system: System, item: Volume) -> Spot:
    return Spot(
        item.name,
        Equation.FLOW,
        {
            "bulk": (Hook(f"bulk:{item.name}"),),
            "inflow": (Hook(f"inflow:{item.name}"),),
            "ground": (Hook(f"ground:{item.name}"),),
        },
        {
            "pressure": f"X[{item.pressure}]",
            "t": "S[1]",
            "low_pressure": _drain(system),
        },
    )


def _drain(system: System) -> str:
    """Return the pressure where the machine keeps its low-pressure oil.

    That is of a tank, of a charged volume, or what check valves charge the chambers to.
    """
    tanks = [node.name for node in system.network.nodes.values() if node.kind is NodeKind.RESERVOIR]
    if tanks:
        low = min(tanks, key=lambda name: system.network.nodes[name].values.get("pressure", 0.0))
        return system.pressure(low)
    charged = [item for item in system.volumes if system.compliances(item)]
    if charged:
        return f"X[{charged[0].pressure}]"
    return "@anti_cavitation.charge_pressure"


def _chamber(system: System) -> Iterator[Spot]:
    """A chamber of a cylinder, or a volume that a pump serves: where leakage and air matter."""
    found = {
        part.element.ports[port]
        for part in system.parts.values()
        for port in ("a", "b", "from", "to")
        if part.element.kind.id in ("cylinder", "pump") and port in part.element.ports
    }
    for item in system.volumes:
        if item.name in found and system.parameter(item.name, "bulk_modulus") is not None:
            yield _volume_spot(system, item)


def _chambers(system: System) -> Iterator[Spot]:
    """The two chambers of a cylinder, or the two sides of a pump, with what is between them."""
    seen = set()
    for part in system.parts.values():
        if part.element.kind.id not in ("cylinder", "pump"):
            continue
        keys = ("a", "b") if part.element.kind.id == "cylinder" else ("to", "from")
        first, second = (part.element.ports[key] for key in keys)
        pair = frozenset((first, second))
        if pair in seen or not pair <= set(system.volume_of) or len(pair) < 2:
            continue
        seen.add(pair)
        a, b = system.volume_of[first], system.volume_of[second]
        low, high = sorted((a, b), key=lambda item: item.number)
        yield Spot(
            part.name,
            Equation.FLOW,
            {
                "into_a": (Hook(f"inflow:{a.name}"),),
                "into_b": (Hook(f"inflow:{b.name}"),),
                "ground_a": (Hook(f"ground:{a.name}"),),
                "ground_b": (Hook(f"ground:{b.name}"),),
                "link": (Hook(f"link:{low.name}:{high.name}"),),
            },
            {
                "p_a": f"X[{a.pressure}]",
                "p_b": f"X[{b.pressure}]",
                "t": "S[1]",
            },
            also=tuple(name for name, other in system.parts.items()
                       if frozenset(other.element.ports.values()) == pair),
        )  # fmt: skip


def _pump(system: System) -> Iterator[Spot]:
    """A pump: what it delivers and what it asks of its shaft."""
    for part in system.parts.values():
        if part.element.kind.id != "pump":
            continue
        node = part.element.ports["on"]
        item = system.leader_of(node)
        ports = part.element.ports
        ratio = system.ratio(node)
        yield Spot(
            part.name,
            Equation.FLOW,
            {"delivery": (Hook(f"delivery:{part.name}"),), "net": (Hook(f"net:{item.name}"),)},
            {
                "angle": shown_expression(system, system.position(node)),
                "speed": shown_expression(system, system.speed(node)),
                "difference": shown_expression(
                    system,
                    f"({system.pressure(ports['to'])} - {system.pressure(ports['from'])})",
                ),
                "displacement": str(system.parameter(part.name, "displacement")),
                "ratio": shown_expression(system, ratio) if ratio else "1.0",
                "t": "S[1]",
            },
        )


def _cylinder(system: System) -> Iterator[Spot]:
    """A cylinder: its areas and volumes, which an effect may adjust."""
    for part in system.parts.values():
        if part.element.kind.id == "cylinder":
            keys = {
                name: system.slot_of[f"{part.name}.{name}"]
                for name in ("area_a", "area_b", "volume_a", "volume_b")
                if f"{part.name}.{name}" in system.slot_of
            }
            yield Spot(part.name, Equation.FLOW, {}, parameters=keys)


def _oil(system: System) -> Iterator[Spot]:
    """All that viscosity changes: viscous friction of everything that moves, and laminar gaps."""
    pumped = [i for i in system.coordinates if _on(system, i, "pump") or _on(system, i, "motor")]
    moved = [i for i in system.coordinates if i not in pumped]
    heavy = [item for item in system.coordinates if system.inertias(item)]
    turning = [item for item in heavy if item in pumped]
    sliding = [item for item in heavy if item in moved]
    leaks = [p for p in system.parts.values() if p.element.kind.id == "laminar_leakage"]
    if not heavy:
        return
    names = {"t": "S[1]", "oil_temperature": f"S[{system.signals['oil_temperature']}]"}
    yield Spot(
        (turning or sliding)[0].name,
        _balance((turning or sliding)[0]),
        {
            "turning": tuple(Hook(f"viscous:{item.name}") for item in turning),
            "sliding": tuple(Hook(f"viscous:{item.name}") for item in sliding),
            "leakage": tuple(Hook(f"laminar:{part.name}") for part in leaks),
            "leakage_slope": tuple(Hook(f"laminar_slope:{part.name}") for part in leaks),
        },
        names,
        words={
            "part": (
                *(("all",) if turning and sliding else ()),
                *(("shaft",) if turning else ()),
                *(("rod",) if sliding else ()),
                *(("oil",) if leaks else ()),
            )
        },
    )


def _pressure_sensor(system: System) -> Iterator[Spot]:
    """A sensor of a pressure that is a state."""
    for item in system.outputs:
        if item.unit == "Pa" and item.state >= 0:
            yield Spot(
                item.channel,
                Equation.MEASUREMENT,
                {
                    "reading": (Hook(f"reading:{item.channel}"),),
                    "initial": (Hook(f"initial:{item.channel}"),),
                },
                {"pressure": f"X[{item.state}]", "t": "S[1]"},
                also=(item.of,),
                sensors=(item.channel,),
            )


def _speed_sensor(system: System) -> Iterator[Spot]:
    """A sensor of a speed, of what has inertia or is geared to it."""
    return _motion_sensor(system, "speed")


def _position_sensor(system: System) -> Iterator[Spot]:
    """A sensor of a position, of what has inertia or is geared to it."""
    return _motion_sensor(system, "position")


def _motion_sensor(system: System, quantity: str) -> Iterator[Spot]:
    """A sensor of the speed or the position of what has inertia or is geared to it."""
    for output in system.outputs:
        node = system.network.nodes.get(output.of)
        if node is None or node.kind not in UNITS or output.unit != UNITS[node.kind][quantity]:
            continue
        item = system.leader_of(output.of)
        if not system.inertias(item):
            continue
        yield Spot(
            output.channel,
            Equation.MEASUREMENT,
            {"reading": (Hook(f"reading:{output.channel}"),)},
            {"speed": shown_expression(system, system.speed(output.of))},
            usual={"acceleration": _ratio(system, output.of) * _usual_acceleration(system, item)},
            sensors=(output.channel,),
        )


def _usual_acceleration(system: System, item: Coordinate) -> float:
    """Return an acceleration that a coordinate may have, 0 where no inertia is declared."""
    inertia = _inertia_of_nodes(system, item)
    if not inertia:
        # that of a pendulum, or of a load
        own = system.parameters
        inertia = system.declared_inertia(item, lambda key: own[system.index[key]].default).inertia
    effort = max(usual_effort(system, item), _driving_effort(system, item))
    return _STRONG * effort / inertia if inertia else 0.0


def _inertia_of_nodes(system: System, item: Coordinate) -> float:
    """Return what is declared of a coordinate's own nodes, kg*m^2 (or kg) at the coordinate."""
    declared = system.parameters
    return sum(
        share * declared[system.index[key]].default for key, share in system.declared_weights(item)
    )


def _loaded_shaft(system: System) -> Iterator[Spot]:
    """A shaft whose angle is measured and that carries masses: the joint between it and these."""
    for item in system.coordinates:
        own, carried = system.inertias_of_nodes(item), system.inertias_of_elements(item)
        if item.node.kind is not NodeKind.ROTATION or not own or not carried:
            continue
        for spot in _joint(system, item):
            call = [*system.state_names, "t", "X", "P", "S"]
            call[item.position], call[item.speed] = "@own.load_x", "@own.load_v"
            names = {
                **spot.names,
                "rod_mass": " + ".join(shown_expression(system, text) for text in own),
                "load_mass": " + ".join(shown_expression(system, text) for text in carried),
                "pulled_there": shown_expression(
                    system, f"outside{item.number}({', '.join(call)})"
                ),
            }
            stiffness = _CONTACT**2 * (_inertia_of_nodes(system, item) or 1.0)
            yield replace(spot, names=names, usual={**spot.usual, "stiffness": stiffness})


def _rigid_joint(system: System) -> Iterator[Spot]:
    """A joint that is taken for rigid, with masses on both sides: a gear's, or a load's."""
    for joint in rigid_joints(system):
        item = system.leader_of(joint.node)
        effort, turns = usual_effort(system, item), item.node.kind is NodeKind.ROTATION
        way = _BENT if turns else _BENT * _ARM
        yield Spot(
            joint.name,
            _balance(item),
            {},
            units={
                **UNITS[item.node.kind],
                "compliance": "rad/(N*m)" if turns else "m/N",
                "play": UNITS[item.node.kind]["position"],
            },
            usual={"compliance": way / effort, "play": 30.0 if turns else 1.0},
            motion=_motion_channels(system, item),
        )


def _elastic_coupling(system: System) -> Iterator[Spot]:
    """An elastic coupling between two parts, which may have play."""
    for part, (first, _) in system.elastic_joints():
        if (play := system.slot_of.get(f"{part.name}.play")) is None:
            continue
        units = UNITS[first.node.kind]
        turns = first.node.kind is NodeKind.ROTATION
        yield Spot(
            part.name,
            _balance(first),
            {},
            units={**units, "play": units["position"]},
            usual={"play": 30.0 if turns else 1.0},
            parameters={"play": play},
            motion=_motion_channels(system, first),
        )


def _sliding_joint(system: System) -> Iterator[Spot]:
    """A rod whose position is measured: the joint between it and what it moves."""
    for item in system.coordinates:
        if item.node.kind is NodeKind.TRANSLATION:
            yield from _joint(system, item)


def _turning_joint(system: System) -> Iterator[Spot]:
    """A shaft whose angle is measured: the coupling between it and its sensor."""
    for item in system.coordinates:
        if item.node.kind is NodeKind.ROTATION:
            yield from _joint(system, item)


def _joint(system: System, item: Coordinate) -> Iterator[Spot]:
    position, speed = system.channel_showing(item.position), system.channel_showing(item.speed)
    if not position or not system.inertias(item):
        return
    kind = item.node.kind
    play = 1.0 if kind is NodeKind.TRANSLATION else 30.0
    hooks = {
        **_coordinate_hooks(item),
        "read_position": (Hook(f"reading:{position}"),),
        "initial_position": (Hook(f"initial:{position}"),),
        "read_speed": (Hook(f"reading:{speed}"),) if speed else (),
        "longest": (Hook("longest"),),
    }
    call = ", ".join([*system.state_names, "t", "X", "P", "S"])
    frictions = [
        f"abs({ratio or '1.0'}) * {system.parameter(part.name, 'coulomb')}"
        for part, term, ratio in system.terms(item, Friction)
        if term.level is not None
    ]
    pulled = shown_expression(system, f"outside{item.number}({call})")
    names = {
        **_motion(system, item),
        "pushed": shown_expression(system, f"drive{item.number}({call})"),
        "pulled": pulled,
        "pulled_there": pulled,
        "viscous_force": _viscous(system, item),
        "load_mass": " + ".join(shown_expression(system, text) for text in system.inertias(item)),
        "coulomb": shown_expression(system, " + ".join(frictions)) or "0.0",
        "resting": repr(5e-3 * play),
    }
    units = {
        **UNITS[kind],
        "play": UNITS[kind]["position"],
        "stiffness": "N/m" if kind is NodeKind.TRANSLATION else "N*m/rad",
    }
    usual = {"play": play, "stiffness": _PIN}
    motion = _motion_channels(system, item)
    yield Spot(item.name, Equation.MEASUREMENT, hooks, names, units, usual, motion=motion)


def _viscous(system: System, item: Coordinate) -> str:
    terms = [
        at_coordinate(f"{system.parameter(part.name, term.viscous)} * X[{item.speed}]", ratio)
        for part, term, ratio in system.terms(item, Friction)
        if term.viscous
    ]
    return shown_expression(system, " + ".join(terms)) or "0.0"


def _hanging(system: System) -> Iterator[Spot]:
    """What a weight may turn: a joint behind a linkage, or a shaft that turns little."""
    for node in system.leaders:
        if system.network.nodes[node].kind is not NodeKind.ROTATION:
            continue
        part, _ = system._ties[node]
        if part.element.kind.id == "gear":
            continue
        item = system.leader_of(node)
        yield Spot(
            node,
            _balance(item),
            {"net": (Hook(f"net:{item.name}"),)},
            {
                "angle": shown_expression(system, system.position(node)),
                "turns": shown_expression(system, system.ratio(node)),
            },
            {"weight": "N*m"},
            {"weight": 1.0},
            also=(item.name,),
        )
    if any(system.network.nodes[n].kind is NodeKind.ROTATION for n in system.leaders
           if system._ties[n][0].element.kind.id != "gear"):  # fmt: skip
        return
    for item in system.coordinates:
        turning = item.node.kind is NodeKind.ROTATION and not _on(system, item, "pump")
        if turning and system.inertias(item):
            yield Spot(
                item.name,
                _balance(item),
                {"net": (Hook(f"net:{item.name}"),)},
                {"angle": f"X[{item.position}]", "turns": "-1.0"},
                {"weight": "N*m"},
                {"weight": 5.0 * usual_effort(system, item) / 20.0},
                words={"posture": ("link",)},
            )


def _slide(system: System) -> Iterator[Spot]:
    """A mass that moves along a straight line."""
    for item in system.coordinates:
        if item.node.kind is not NodeKind.TRANSLATION or not system.inertias(item):
            continue
        loads = [system.slot_of[f"{part.name}.force"] for part in _on(system, item, "load")
                 if f"{part.name}.force" in system.slot_of]  # fmt: skip
        yield Spot(
            item.name,
            _balance(item),
            {"net": (Hook(f"net:{item.name}"),)},
            units=UNITS[item.node.kind],
            usual={"effort": usual_effort(system, item)},
            parameters={"load": loads[0]} if loads else {},
        )


def _supply(system: System) -> Iterator[Spot]:
    """A reservoir that oil is drawn from through a line or a valve, its pressure no input."""
    logged = {column.signal for column in system.pressure_inputs}
    for node in system.network.nodes.values():
        if node.kind is not NodeKind.RESERVOIR:
            continue
        if system.signals[f"{node.name}.pressure"] in logged:
            continue
        pressure = node.values.get("pressure", 0.0)
        others = [
            other.values.get("pressure", 0.0)
            for other in system.network.nodes.values()
            if other.kind is NodeKind.RESERVOIR and other is not node
        ]
        if not others or pressure <= max(others):
            continue
        drawn = []
        for part, flow in system.flows():
            source, sink = system.ends(part, flow)
            if node.name in (source, sink):
                sign = "" if source == node.name else "-"
                drawn.append(f"{sign}({system.through(part, flow, flow.law)})")
        yield Spot(
            node.name,
            Equation.FLOW,
            {"pressure": (Hook(f"pressure:{node.name}"),)},
            {"drawn": shown_expression(system, " + ".join(drawn)) if drawn else "0.0", "t": "S[1]",
             "pressure": f"S[{system.signals[f'{node.name}.pressure']}]"},
            usual={"pressure": pressure},
        )  # fmt: skip


def variables_of(system: System) -> dict[str, str]:
    """Return what a learned curve may follow, by name, as expressions."""
    found = {"time": "S[1]"}
    for item in system.outputs:
        if item.state >= 0:
            found[item.channel] = f"X[{item.state}]"
        elif item.command < 0:
            found[item.channel] = shown_expression(system, item.expression)
    pair = facing_volumes(system)
    if pair is not None:
        a, b = (f"X[{volume.pressure}]" for volume in pair)
        found["pressure_difference"] = f"{a} - {b}"
        found["pressure_sum"] = f"{a} + {b}"
    for moving in system.coordinates:
        if moving.node.kind is NodeKind.ROTATION and not any(
            out.state == moving.position for out in system.outputs
        ):
            found[f"{moving.name}_angle"] = f"X[{moving.position}]"
    for column in system.columns:
        if column.command is not None and column.part is not None:
            found.setdefault(column.channel, f"S[{system.demand(column.part, column.command)}]")
        elif column.channel not in found:
            found[column.channel] = f"S[{column.signal}]"
    names = {place: name for name, place in places_of_states(system).items()}
    for moving in system.coordinates:
        if _has_slope(system, moving):
            found.setdefault(names[moving.speed], f"X[{moving.speed}]")
    return found


def _has_slope(system: System, item: Coordinate) -> bool:
    """Whether a channel shows a position, its own or behind a gear, and none shows the speed."""
    if item.speed in system.shown:
        return False
    geared = any(
        own is item and output.quantity in ("angle", "position")
        for output, own in system.geared_channels()
    )
    return item.position in system.shown or geared


def _joined(system: System, item: Coordinate) -> list[Coordinate]:
    """Return a coordinate, and those at the other ends of its elastic joints."""
    ends = [pair for _, pair in system.elastic_joints() if item in pair]
    return [item, *(other for pair in ends for other in pair if other is not item)]


def _motion_channels(system: System, item: Coordinate) -> tuple[str, str]:
    """Return the channels that show a position and a speed, "" for none.

    Through an elastic joint, what moves at its other end shows them as well.
    """
    shown = [
        (system.shown.get(one.position, ""), system.shown.get(one.speed, ""))
        for one in _joined(system, item)
    ]
    return (
        next((position for position, _ in shown if position), ""),
        next((speed for _, speed in shown if speed), ""),
    )


def _speeds(system: System, item: Coordinate) -> tuple[str, ...]:
    """Return the speed that a channel shows, and those that are a shown position's slope."""
    names = {place: name for name, place in places_of_states(system).items()}
    slopes = [names[one.speed] for one in _joined(system, item) if _has_slope(system, one)]
    return (_motion_channels(system, item)[1], *slopes)


def _anything(system: System) -> Iterator[Spot]:
    """Every place where something unknown may act.

    What it may follow is what that part of a machine can know: mechanics and oil do not know the
    time, but a rod's load and a leak may change with it; only a drive knows its command.
    """
    known = variables_of(system)
    names_of_states = {place: name for name, place in places_of_states(system).items()}
    names = {"u": "variable(@learned.variable, X, P, S)"}
    vocabulary = {"variable": tuple(known)}
    logged = [column.channel for column in system.pressure_inputs]

    def spot(
        name: str,
        equation: Equation,
        hooks: Mapping[str, tuple[Hook, ...]],
        follows: Mapping[str, tuple[str, ...]],
        size: float = 1.0,
        sensors: tuple[str, ...] = (),
        torque_constant: str = "1.0",
    ) -> Spot:
        every = {
            key: hooks.get(key, ())
            for key in ("added", "taken", "changed", "torque", "level", "delivered")
        }
        return Spot(
            name,
            equation,
            every,
            {"torque_constant": torque_constant, **names},
            usual={"size": size},
            vocabulary=vocabulary,
            follows={
                form: tuple(dict.fromkeys(name for name in wanted if name in known))
                for form, wanted in follows.items()
            },
            sensors=sensors,
        )

    for part, motor in _motors(system):
        acting = [item.channel for item in system.outputs if item.of == part.name]
        asked = [column.channel for column in system.columns if column.part is part]
        follows = ("time", *(acting or asked)[:1])
        yield spot(
            part.name,
            Equation.ACTUATION,
            {"torque": motor.hooks["torque"]},
            {"gain": follows, "additive": follows},
            torque_constant=motor.names["torque_constant"],
        )
    for column, part in _drives(system):
        drive = next(item for item in _drive(system) if item.name == part.name)
        yield spot(
            f"{part.name}.drive",
            Equation.ACTUATION,
            {"changed": drive.hooks.get("asked", drive.hooks["demand"])},
            {"additive": ("time", column.channel)},
        )
    for item in system.coordinates:
        if system.inertias(item):
            own = _motion_channels(system, item)[0], *_speeds(system, item)
            pumped = (*own, "pressure_difference", "pressure_sum")
            turns = bool(_on(system, item, "pump"))
            yield spot(
                item.name,
                _balance(item),
                {"added": (Hook(f"net:{item.name}"),), "level": (Hook(f"dry:{item.name}"),)},
                {
                    "additive": pumped if turns else ("time", *own),
                    "friction": pumped
                    if turns
                    else ("time", own[0], "pressure_sum", *logged, "oil_temperature"),
                },
                0.1 * usual_effort(system, item),
            )
    for pair in _chambers(system):
        pumps = [part for part in system.parts.values() if part.element.kind.id == "pump"]
        speeds = tuple(
            names_of_states[system.leader_of(part.element.ports["on"]).speed] for part in pumps
        )
        flows = {"additive": ("time", "pressure_difference", *speeds)}
        if pumps:
            flows["gain"] = ("time", *speeds, "pressure_difference")
        yield spot(
            pair.name,
            Equation.FLOW,
            {
                "taken": pair.hooks["into_a"],
                "added": pair.hooks["into_b"],
                "delivered": tuple(Hook(f"delivery:{part.name}") for part in pumps),
            },
            flows,
            usual_flow(system),
        )
    for volume in system.volumes:
        yield spot(
            volume.name,
            Equation.FLOW,
            {"added": (Hook(f"inflow:{volume.name}"),)},
            {"additive": ("time", system.shown.get(volume.pressure, ""))},
            usual_flow(system),
        )
    for supply in _supply(system):
        pressure = system.network.nodes[supply.name].values.get("pressure", 0.0)
        yield spot(
            supply.name,
            Equation.FLOW,
            {"changed": supply.hooks["pressure"]},
            {"additive": ("time",)},
            0.01 * pressure,
        )
    sensors = [item for item in system.outputs if item.command < 0]
    for sensor in sensors:
        follows = ("time", sensor.channel)
        yield spot(
            f"{sensor.channel}.sensor",
            Equation.MEASUREMENT,
            {"changed": (Hook(f"reading:{sensor.channel}"),)},
            {"additive": follows, "gain": follows},
            sensors=(sensor.channel,),
        )
    pressures = tuple(item.channel for item in sensors if item.unit == "Pa" and item.state >= 0)
    if len(pressures) > 1:
        # sensors of one kind share supply, amplifier and oil
        yield spot(
            "pressures",
            Equation.MEASUREMENT,
            {"changed": tuple(Hook(f"reading:{name}") for name in pressures)},
            {"gain": ("time", "pressure_sum"), "additive": ("time", "pressure_sum")},
            sensors=pressures,
        )


_ROLES: Mapping[str, Callable[[System], Iterator[Spot]]] = {
    "friction": _friction,
    "pump_friction": _pump_friction,
    "rod": _rod,
    "geared": _geared,
    "motor": _motor,
    "turning_motor": _turning_motor,
    "drive": _drive,
    "motor_drive": _motor_drive,
    "voltage_drive": _voltage_drive,
    "valve_drive": _valve_drive,
    POSITION_LOOP: _position_loop,
    "valve": _valve,
    "volume": _volume,
    "chamber": _chamber,
    "chambers": _chambers,
    "pump": _pump,
    "cylinder": _cylinder,
    "oil": _oil,
    "pressure_sensor": _pressure_sensor,
    "speed_sensor": _speed_sensor,
    "position_sensor": _position_sensor,
    "sliding_joint": _sliding_joint,
    "loaded_shaft": _loaded_shaft,
    "turning_joint": _turning_joint,
    "rigid_joint": _rigid_joint,
    "elastic_coupling": _elastic_coupling,
    "hanging": _hanging,
    "slide": _slide,
    "supply": _supply,
    "anything": _anything,
}
