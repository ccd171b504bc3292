"""Writes the source of a plant's kernel: its network as straight code, effects in their places.

The text is compiled once and cached on disk; no number of the plant stands in it, so another value
is another vector and never another compilation. Functions of elements and effects are imported and
compiled into it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from eha_bench.plants.network.element import BalanceSide, Effort, Friction, HeldSignal
from eha_bench.plants.network.hooks import CONDUCTANCES, STATES, Hooks
from eha_bench.plants.network.roles import variables_of
from eha_bench.plants.network.system import (
    BYPASS,
    BoundElement,
    Coordinate,
    PlantInput,
    System,
    Volume,
    at_coordinate,
)
from eha_bench.plants.plant import AT_ONCE

# Dividing needs no test for zero: all of them together take long to compile. What is cached is what
# Python calls; the rest is compiled into it.
_HEAD = '''"""Generated: the kernel of a plant."""

import math

import numba
import numpy as np

from eha_bench.plants.compiled import njit as inner
from eha_bench.plants.network.integration import (
    FINE, GAMMA, MAX_SPLITS, MOST_STEPS, RESOLVED, breaks_away, creep, limited, switches,
)
from eha_bench.plants.pointer import behind, pointer


def njit(function=None, **options):
    kind = numba.njit if "cache" in options else inner
    mark = kind(error_model="numpy", **options)
    return mark if function is None else mark(function)

'''


def kernel_source(system: System, hooks: Hooks) -> str:
    """Return the source of the kernel of a system with effects in its hooks."""
    return Writer(system, hooks).text()


class _Asked(NamedTuple):
    """What a controller inside the plant asks its motor for, as expressions of the kernel.

    Attributes:
        reference: number of the column that it follows. of: number and column of the command.
        reading, speed: of what it controls. period: s.
        lines: those that work out its law. command: by its law.
    """

    reference: int
    of: tuple[int, PlantInput]
    reading: str
    speed: str
    period: str
    lines: list[str]
    command: str


class Writer:
    """Writes a kernel that advances one parameter set.

    Args:
        system: the network. hooks: the effects in it.
    """

    def __init__(self, system: System, hooks: Hooks) -> None:
        self.system = system
        self.hooks = hooks
        self.states = ", ".join(system.state_names)
        self.arguments = ", ".join([*system.state_names, "t", "X", "P", "S"])
        self.lines: list[str] = []
        self.links = self._links()

    def text(self) -> str:
        """Return the source."""
        body = self._body()
        laws = [
            line
            for function, name in self.system.laws.items()
            for line in (
                f"from {function.__module__} import {function.__name__} as {name}_py",
                f"{name} = njit({name}_py)",
            )
        ]
        return "\n".join([_HEAD, *laws, *self.hooks.lines(), *body, ""])

    def _body(self) -> list[str]:
        system = self.system
        for item in system.coordinates:
            self._coordinate(item)
        self._resolve()
        self._slopes()
        self._rates()
        for item in system.coordinates:
            self._direction(item)
        self._step()
        self._split_step()
        self._substep()
        self._variable()
        self._holding()
        self._measure()
        self._advance()
        self._settle()
        self._simulate()
        return self.lines

    # --- small helpers -----------------------------------------------------------------------

    def function(self, name: str, arguments: str, body: Iterable[str], mark: str = "@njit") -> None:
        """Write a function."""
        self.lines += ["", "", mark, f"def {name}({arguments}):", *(f"    {line}" for line in body)]

    def _lines_that_show(self, names: Sequence[str]) -> list[str]:
        """Lines that show the effects a state; nothing where there are none."""
        if self.hooks.is_empty:
            return []
        return [
            "if S[2] != 0.0:",
            *(f"    X[{place}] = {name}" for place, name in enumerate(names)),
            "    S[1] = t",
        ]

    # --- coordinates -------------------------------------------------------------------------

    def _sum(self, terms: Sequence[str]) -> str:
        return " + ".join(terms) if terms else "0.0"

    def _coordinate(self, item: Coordinate) -> None:
        system, n = self.system, item.number
        sides: dict[BalanceSide, list[str]] = {BalanceSide.DRIVE: [], BalanceSide.LOAD: []}
        for part, term, ratio in system.terms(item, Effort):
            value = system.call(part, term.law)
            if term.hook == "torque":
                value = self.hooks.apply(f"torque:{part.name}", value, ())
            sides[term.side].append(f"({ratio}) * {value}" if ratio else value)
        sides[BalanceSide.LOAD] += system.forces_of_bends(item)
        inertia = self._sum(system.inertias(item))
        self.function(
            f"mass{n}",
            self.arguments,
            [f"return {self.hooks.apply(f'inertia:{item.name}', inertia, ())}"],
        )
        for side, terms in sides.items():
            if side is BalanceSide.LOAD:
                # what loads it from outside, and what of that reaches it
                self.function(f"outside{n}", self.arguments, [f"return {self._sum(terms)}"])
                raw = f"outside{n}({self.arguments})"
                whole = self.hooks.apply(f"load:{item.name}", raw, ())
            else:
                whole = self._sum(terms)
            self.function(f"{side.value}{n}", self.arguments, [f"return {whole}"])
        viscous: list[str] = []
        levels: list[str] = []
        for part, term, ratio in system.terms(item, Friction):
            if term.level is not None:
                level = system.call(part, term.level)
                levels.append(f"abs({ratio}) * {level}" if ratio else level)
            if term.viscous:
                own = str(system.parameter(part.name, term.viscous))
                viscous.append(at_coordinate(own, ratio))
        coefficient = self._sum(viscous)
        total = [
            f"total = drive{n}({self.arguments}) + load{n}({self.arguments})",
            f"coefficient = {self.hooks.apply(f'viscous:{item.name}', coefficient, ())}",
            f"total = total - coefficient * v{n}",
            f"return {self.hooks.apply(f'net:{item.name}', 'total', ('level',))}",
        ]
        self.function(f"net{n}", f"level, {self.arguments}", total)
        level = self.hooks.apply(f"dry:{item.name}", "level", ("direction",))
        self.function(
            f"level{n}",
            f"direction, {self.arguments}",
            [f"level = {self._sum(levels)}", f"return {level}"],
        )

    def _resolve(self) -> None:
        """Write the longest step that resolves what swings on springs, of all coordinates.

        The fastest swing is at most sqrt(2 k / m) of the stiffest coordinate (Gershgorin: a spring
        between two masses is felt by both). What swings faster still, on a mass that a fit makes
        next to nothing, is not followed: the integration damps it.
        """
        body = []
        for item in self.system.coordinates:
            terms = self.system.stiffnesses(item)
            if terms:
                body += [
                    f"stiffness = {self._sum(terms)}",
                    f"mass = mass{item.number}({self.arguments})",
                    "if stiffness > 0.0 and mass > 0.0:",
                    "    h = min(h, RESOLVED * math.sqrt(0.5 * mass / stiffness))",
                ]
        if body:
            body = ["shortest = h / MOST_STEPS", *body, "return max(h, shortest)"]
            self.function("resolved", f"h, {self.arguments}", body)

    def _sticks(self, item: Coordinate, level: str) -> str:
        return self.hooks.apply(f"sticks:{item.name}", level, ())

    def _has_friction(self, item: Coordinate) -> bool:
        dry = any(term.level is not None for _, term, _ in self.system.terms(item, Friction))
        return dry or not self.hooks.is_empty

    def _creep(self, item: Coordinate) -> str:
        """Expression of the coordinate's speed over which friction creeps, "" where it never does.

        Of several frictions on one coordinate that creep, the softest one: each lets it move.
        """
        speeds = [
            f"{speed} / abs({ratio})" if ratio else speed
            for part, term, ratio in self.system.terms(item, Friction)
            if term.creep and (speed := self.system.parameter(part.name, term.creep))
        ]
        return f"max({', '.join(speeds)})" if len(speeds) > 1 else "".join(speeds)

    def _direction(self, item: Coordinate) -> None:
        n = item.number
        against, away = self._breaks_away(item)
        body = [f"if v{n} != 0.0:", f"    return 1.0 if v{n} > 0.0 else -1.0", *against]
        if creep := self._creep(item):
            body += [f"if {creep} > 0.0:", "    return 1.0 if net >= 0.0 else -1.0"]
        body.append(f"return {away}")
        self.function(f"direction{n}", self.arguments, body)

    def _breaks_away(self, item: Coordinate) -> tuple[list[str], str]:
        """Lines of what acts on a coordinate at rest, and the direction in which it breaks away."""
        n, call = item.number, self.arguments
        against = [
            f"up = level{n}(1.0, {call})",
            f"down = level{n}(-1.0, {call})",
            f"net = net{n}(up, {call})",
        ]
        up, down = self._sticks(item, "up"), self._sticks(item, "down")
        return against, f"breaks_away(net, {up}, {down})"

    # --- flows -------------------------------------------------------------------------------

    def _links(self) -> dict[tuple[int, int], list[tuple[str, bool]]]:
        """Return the conductances between volumes, or from one to the ground, with who switches."""
        found: dict[tuple[int, int], list[tuple[str, bool]]] = {}
        system = self.system
        for part, flow in system.flows():
            if flow.slope is None:
                continue
            ends = sorted(
                (system.volume_of[name].number for name in system.ends(part, flow)
                 if name in system.volume_of),
            )  # fmt: skip
            if not ends or (len(ends) == 2 and ends[0] == ends[1]):
                continue
            key = (ends[0], ends[1]) if len(ends) == 2 else (ends[0], -1)
            value = system.through(part, flow, flow.slope)
            if part.anatomy.opens_with_bypass:
                value = f"S[{system.signals[BYPASS]}] * {value}"
            if flow.hook:
                value = self.hooks.apply(f"{flow.hook}_slope:{part.name}", value, ())
            found.setdefault(key, []).append((value, flow.switches))
        for i, volume in enumerate(system.volumes):
            if self.hooks.uses(f"ground:{volume.name}"):
                found.setdefault((i, -1), [])
        for i, a in enumerate(system.volumes):
            for j, b in enumerate(system.volumes):
                if i < j and self.hooks.uses(f"link:{a.name}:{b.name}"):
                    found.setdefault((i, j), [])
        return dict(sorted(found.items()))

    def _link_hook(self, key: tuple[int, int]) -> str:
        volumes = self.system.volumes
        if key[1] < 0:
            return f"ground:{volumes[key[0]].name}"
        return f"link:{volumes[key[0]].name}:{volumes[key[1]].name}"

    def _slopes(self) -> None:
        if not self.links:
            return
        values = []
        for key, terms in self.links.items():
            value = self._sum([text for text, _ in terms])
            values.append(self.hooks.apply(self._link_hook(key), value, ()))
        self.function("slopes", self.arguments, [f"return ({', '.join(values)},)"])

    @property
    def switching(self) -> list[int]:
        """Places among the links of those whose conductance may come and go."""
        return [
            place
            for place, (key, terms) in enumerate(self.links.items())
            if any(may for _, may in terms) or self.hooks.uses(self._link_hook(key))
        ]

    def _volume_lines(self) -> list[str]:
        system = self.system
        lines = []
        into: dict[str, list[str]] = {item.name: [] for item in system.volumes}
        for number, (part, flow) in enumerate(system.flows()):
            source, sink = system.ends(part, flow)
            if source not in into and sink not in into:
                continue
            value = system.through(part, flow, flow.law)
            if part.anatomy.opens_with_bypass:
                value = f"S[{system.signals[BYPASS]}] * {value}"
            if flow.hook:
                value = self.hooks.apply(f"{flow.hook}:{part.name}", value, ())
            lines.append(f"q{number} = {value}")
            if sink in into:
                into[sink].append(f"+ q{number}")
            if source in into:
                into[source].append(f"- q{number}")
        for item in system.volumes:
            j = item.number
            lines += self._stiffness(item)
            total = " ".join(into[item.name]).removeprefix("+ ") or "0.0"
            summed = self.hooks.apply(f"inflow:{item.name}", total, ())
            lines.append(f"dp{j} = c{j} * ({summed})")
        return lines

    def _stiffness(self, item: Volume) -> list[str]:
        """Lines of c = dp/dV of a volume."""
        system, j = self.system, item.number
        oils = []
        for part, term in system.oils(item):
            value = system.call(part, term.law)
            if term.low is not None:
                value = f"max({value}, {system.call(part, term.low)})"
            oils.append(value)
        own = system.parameter(item.name, "volume")
        if own is not None:
            oils.insert(0, own)
        gives = [system.call(part, term.law) for part, term in system.compliances(item)]
        modulus = system.parameter(item.name, "bulk_modulus")
        if modulus is None or not oils:
            return [f"c{j} = 1.0 / ({self._sum(gives)})"]
        bulk = self.hooks.apply(f"bulk:{item.name}", modulus, ())
        if not gives:
            return [f"c{j} = {bulk} / ({self._sum(oils)})"]
        return [f"c{j} = 1.0 / (({self._sum(oils)}) / {bulk} + {self._sum(gives)})"]

    def _rates(self) -> None:
        system = self.system
        names = system.state_names
        directions = ", ".join(f"d{item.number}" for item in system.coordinates)
        body = self._lines_that_show(names)
        results = []
        for item in system.coordinates:
            n = item.number
            body += self._acceleration(item)
            results += [f"dv{n}", f"sv{n}"]
        body += self._volume_lines()
        for volume in system.volumes:
            results += [f"dp{volume.number}", f"c{volume.number}"]
        body.append(f"return ({', '.join(results)},)")
        self.function("rates", f"h, {directions}{', ' if directions else ''}{self.arguments}", body)

    def _acceleration(self, item: Coordinate) -> list[str]:
        """Lines of a coordinate's acceleration `dv`, and its slope `sv` where friction creeps."""
        n = item.number
        acting, acceleration = self._balance(item)
        lines = [f"dv{n}, sv{n} = 0.0, 0.0", f"if d{n} != 0.0:", *(f"    {a}" for a in acting)]
        if not (creep := self._creep(item)):
            return [*lines, f"    dv{n} = {acceleration}"]
        return [
            *lines,
            f"    if {creep} > 0.0:",
            f"        dv{n}, sv{n} = creep("
            f"level, net, mass{n}({self.arguments}), v{n}, {creep}, h)",
            "    else:",
            f"        dv{n} = {acceleration}",
        ]

    def _balance(self, item: Coordinate) -> tuple[list[str], str]:
        """Lines of what acts on a coordinate that moves, and the acceleration that follows."""
        n, call = item.number, self.arguments
        if not self._has_friction(item):
            return [], f"net{n}(0.0, {call}) / mass{n}({call})"
        acting = [f"level = level{n}(d{n}, {call})", f"net = net{n}(level, {call})"]
        sticks = self._sticks(item, "level")
        if sticks != "level":
            acting.append(f"level = {sticks}")
        return acting, f"(net - d{n} * level) / mass{n}({call})"

    # --- a step ------------------------------------------------------------------------------

    def _implicit(self) -> tuple[list[str], list[list[str]]]:
        """Lines that set up the matrix of the volumes, and its entries ("" for 0)."""
        count = len(self.system.volumes)
        lines = []
        entries = [["" for _ in range(count)] for _ in range(count)]
        places = {key: place for place, key in enumerate(self.links)}
        if self.links:
            names = ", ".join(f"g{place}" for place in places.values())
            lines.append(f"{names}, = slopes({self.arguments})")
        for i in range(count):
            own = [f"g{place}" for key, place in places.items() if i in key]
            entries[i][i] = f"m{i}_{i}"
            lines.append(
                f"m{i}_{i} = 1.0 + s * c{i} * ({' + '.join(own)})" if own else f"m{i}_{i} = 1.0"
            )
            for j in range(count):
                key = (min(i, j), max(i, j))
                if i != j and key in places:
                    entries[i][j] = f"m{i}_{j}"
                    lines.append(f"m{i}_{j} = -(s * c{i} * g{places[key]})")
        return lines, entries

    def _solver(self, entries: list[list[str]]) -> tuple[list[str], list[tuple[int, int]]]:
        """Lines that eliminate below the diagonal, and which entries were eliminated.

        The matrix is diagonally dominant, so nothing has to be exchanged.
        """
        count = len(entries)
        lines: list[str] = []
        factors: list[tuple[int, int]] = []
        if self._cramer(entries):
            return ["det = m0_0 * m1_1 - m0_1 * m1_0"], []
        for k in range(count):
            for i in range(k + 1, count):
                if not entries[i][k]:
                    continue
                lines.append(f"f{i}_{k} = {entries[i][k]} / {entries[k][k]}")
                factors.append((i, k))
                for j in range(k + 1, count):
                    if not entries[k][j]:
                        continue
                    old = entries[i][j]
                    entries[i][j] = f"m{i}_{j}"
                    lines.append(f"m{i}_{j} = {old or '0.0'} - f{i}_{k} * {entries[k][j]}")
                entries[i][k] = ""
        return lines, factors

    @staticmethod
    def _cramer(entries: list[list[str]]) -> bool:
        return len(entries) == 2 and bool(entries[0][1]) and bool(entries[1][0])

    def _solution_lines(
        self, entries: list[list[str]], factors: list[tuple[int, int]], right: str, out: str
    ) -> list[str]:
        """Lines that solve for one right side: names `<right><i>` -> `<out><i>`."""
        count = len(entries)
        if self._cramer(entries) and not factors:
            return [
                f"{out}0 = (m1_1 * {right}0 - m0_1 * {right}1) / det",
                f"{out}1 = (m0_0 * {right}1 - m1_0 * {right}0) / det",
            ]
        lines = [f"y{i} = {right}{i}" for i in range(count)]
        lines += [f"y{i} = y{i} - f{i}_{k} * y{k}" for i, k in sorted(factors, key=lambda f: f[1])]
        for i in reversed(range(count)):
            rest = "".join(
                f" - {entries[i][j]} * {out}{j}" for j in range(i + 1, count) if entries[i][j]
            )
            lines.append(f"{out}{i} = (y{i}{rest}) / {entries[i][i]}")
        return lines

    def _step(self) -> None:
        system = self.system
        coordinates, volumes = system.coordinates, system.volumes
        directions = "".join(f"d{item.number}, " for item in coordinates)
        results: list[str] = []
        for item in coordinates:
            results += [f"fv{item.number}", f"sv{item.number}"]
        for volume in volumes:
            results += [f"fp{volume.number}", f"c{volume.number}"]
        body = [f"{', '.join(results)}, = rates(h, {directions}{self.arguments})", "s = GAMMA * h"]
        lines, entries = self._implicit()
        body += lines
        lines, factors = self._solver(entries)
        body += lines
        for item in coordinates:
            n = item.number
            body += [f"mv{n} = 1.0 + s * sv{n}", f"kv{n} = fv{n} / mv{n}"]
        body += self._solution_lines(entries, factors, "fp", "kp")
        body += [
            f"b{volume.number} = p{volume.number} + h * kp{volume.number}" for volume in volumes
        ]
        later = []
        for item in coordinates:
            n = item.number
            later += [f"v{n} + h * kv{n}", f"x{n} + h * v{n}"]
        later += [f"b{volume.number}" for volume in volumes]
        results = []
        for item in coordinates:
            results += [f"ev{item.number}", "_"]
        for volume in volumes:
            results += [f"ep{volume.number}", "_"]
        body.append(
            f"{', '.join(results)}, = rates(h, {directions}{', '.join(later)}, t + h, X, P, S)"
        )
        body += [f"r{v.number} = ep{v.number} - 2.0 * kp{v.number}" for v in volumes]
        body += self._solution_lines(entries, factors, "r", "lp")
        out = []
        for item in coordinates:
            n = item.number
            body.append(f"lv{n} = (ev{n} - 2.0 * kv{n}) / mv{n}")
            out += [
                f"v{n} + h * (1.5 * kv{n} + 0.5 * lv{n})",
                f"x{n} + h * (v{n} + 0.5 * h * kv{n})",
            ]
        out += [f"p{v.number} + h * (1.5 * kp{v.number} + 0.5 * lp{v.number})" for v in volumes]
        out += [f"b{v.number}" for v in volumes]
        body.append(f"return ({', '.join(out)},)")
        self.function("step", f"h, {directions}{self.arguments}", body)

    def _call_step(self, length: str) -> str:
        system = self.system
        left = [f"{name}_" for name in system.state_names]
        left += [f"b{volume.number}" for volume in system.volumes]
        directions = "".join(f"d{item.number}, " for item in system.coordinates)
        return f"{', '.join(left)}, = step({length}, {directions}{self.arguments})"

    def _split_step(self) -> None:
        system = self.system
        coordinates = system.coordinates
        stopping = [item for item in coordinates if self._has_friction(item)]
        body = ["switched = False", "left = h"]
        for item in coordinates:
            n = item.number
            hold = [f"is_imposed[{item.speed}]", f"is_imposed[{item.position}]"]
            if n in system.locked_coordinates:
                hold.insert(0, "locked")
            body.append(f"hold{n} = {' or '.join(hold)}")
            if item in stopping:
                creep = self._creep(item)
                body.append(f"stops{n} = {f'{creep} <= 0.0' if creep else 'True'}")
        body.append("for split in range(MAX_SPLITS):")
        inside = [f"{', '.join(system.state_names)}, = {', '.join(self._from_y())},"]
        inside += self._lines_that_show(system.state_names)
        for item in coordinates:
            n = item.number
            inside.append(f"d{n} = 0.0")
            if item in stopping:
                inside += [f"if not hold{n}:", f"    d{n} = direction{n}({self.arguments})"]
            else:
                inside += [f"if not hold{n}:", f"    d{n} = 1.0"]
            stroke = system.stroke(item)
            if stroke is not None:
                low, high = stroke
                inside += [f"low{n}, high{n} = {low}, {high}"]
                net = "" if item in stopping else f"net{n}(0.0, {self.arguments})"
                up = f"d{n} > 0.0" if item in stopping else f"{net} > 0.0"
                down = f"d{n} < 0.0" if item in stopping else f"{net} < 0.0"
                ends = f"(x{n} >= high{n} and {up}) or (x{n} <= low{n} and {down})"
                inside += [f"if v{n} == 0.0 and ({ends}):", f"    d{n} = 0.0"]
        inside.append(self._call_step("left"))
        inside.append("part = 1.0")
        for item in stopping:
            n = item.number
            inside += [f"stop{n} = stops{n} and d{n} != 0.0 and d{n} * v{n}_ <= 0.0"]
        for item in stopping:
            n = item.number
            inside += [
                f"if stop{n}:",
                f"    part = min(part, v{n} / (v{n} - v{n}_) if v{n} != 0.0 else 0.0)",
            ]
        if stopping:
            inside += ["if split == MAX_SPLITS - 1:", "    part = 1.0", "if part <= 0.0:"]
            # breaks away and is driven back within the step: it stays at rest
            for item in stopping:
                n = item.number
                inside.append(f"    d{n} = 0.0 if stop{n} and v{n} == 0.0 else d{n}")
            inside += [f"    {self._call_step('left')}", "    part = 1.0"]
            for item in stopping:
                n = item.number
                inside.append(f"    stop{n} = stops{n} and d{n} != 0.0 and d{n} * v{n}_ <= 0.0")
            inside.append("elif part < 1.0:")
            for item in stopping:
                n = item.number
                inside.append(f"    first{n} = stop{n} and v{n} / (v{n} - v{n}_) <= part")
            inside.append(f"    {self._call_step('part * left')}")
            for item in stopping:
                inside.append(f"    stop{item.number} = first{item.number}")
            for item in stopping:
                n = item.number
                inside += [f"if stop{n}:", f"    v{n}_ = 0.0"]
        for item in coordinates:
            n = item.number
            if system.stroke(item) is not None:
                inside += [
                    f"if x{n}_ > high{n}:",
                    f"    x{n}_ = high{n}",
                    f"    v{n}_ = min(v{n}_, 0.0)",
                    f"elif x{n}_ < low{n}:",
                    f"    x{n}_ = low{n}",
                    f"    v{n}_ = max(v{n}_, 0.0)",
                ]
        inside.append(
            f"{', '.join(self._from_y())}, = {', '.join(f'{n}_' for n in system.state_names)},"
        )
        inside += self._switching_lines()
        inside += [
            "t += part * left",
            "left *= 1.0 - part",
            "if left <= 1e-9 * h:",
            "    break",
        ]
        body += [f"    {line}" for line in inside]
        body.append("return switched")
        self.function(
            "split_step",
            "h, t, locked, is_imposed, X, P, S, Y",
            body,
            mark="@njit(forceinline=True)",
        )

    def _switching_lines(self) -> list[str]:
        if not self.switching:
            return []
        met, tests = self._switches()
        own = any(may for terms in self.links.values() for _, may in terms)
        on = "" if own else f" and {self.hooks.is_on(CONDUCTANCES)}"
        return [
            f"if h > FINE and not switched{on}:",
            *(f"    {line}" for line in met),
            f"    switched = {' or '.join(tests)}",
        ]

    def _switches(self) -> tuple[list[str], list[str]]:
        """Lines of the conductances that a step meets, and the tests for one that comes or goes."""
        system = self.system
        before = [f"g{k}" for k in range(len(self.links))]
        middle = [f"e{k}" for k in range(len(self.links))]
        after = [f"i{k}" for k in range(len(self.links))]
        at_middle = [
            *(name for name in system.state_names if not name.startswith("p")),
            *(f"b{volume.number}" for volume in system.volumes),
        ]
        ends = [f"{name}_" for name in system.state_names]
        met = [
            *self._lines_that_show(system.state_names),
            f"{', '.join(before)}, = slopes({self.arguments})",
            *self._lines_that_show(at_middle),
            f"{', '.join(middle)}, = slopes({', '.join(at_middle)}, t, X, P, S)",
            *self._lines_that_show(ends),
            f"{', '.join(after)}, = slopes({', '.join(ends)}, t, X, P, S)",
        ]
        tests = [
            test
            for k in self.switching
            for test in (f"switches(g{k}, e{k})", f"switches(g{k}, i{k})")
        ]
        return met, tests

    def _from_y(self) -> list[str]:
        return [f"Y[{place}]" for place in range(self.system.size)]

    def _substep(self) -> None:
        names = self.system.state_names
        if not self.switching:
            body = ["split_step(h, t, locked, is_imposed, X, P, S, Y)"]
        else:
            body = [
                f"{', '.join(names)}, = {', '.join(self._from_y())},",
                "piece = h",
                "part = count = 1",
                "while part <= count:",
                "    now = t + (part - 1) * piece",
                "    part += 1",
                "    switched = split_step(piece, now, locked, is_imposed, X, P, S, Y)",
                "    if switched and count == 1:",
                f"        {', '.join(self._from_y())}, = {', '.join(names)},",
                "        part, count = 1, max(2, math.ceil(h / FINE - 1e-6))",
                "        piece = h / count",
            ]
        self.function("substep", "h, t, locked, is_imposed, X, P, S, Y", body)

    # --- what goes on between steps ----------------------------------------------------------

    def _show_y(self) -> list[str]:
        """Lines that show the effects the state in Y."""
        if self.hooks.is_empty:
            return []
        count = self.system.size
        return ["if S[2] != 0.0:", f"    for k_ in range({count}):", "        X[k_] = Y[k_]",
                "    S[1] = t"]  # fmt: skip

    def _locals(self) -> list[str]:
        names = self.system.state_names
        return [f"{', '.join(names)}, = {', '.join(self._from_y())},"] if names else []

    def _variable(self) -> None:
        """Write what a learned curve may follow, by its number."""
        if self.hooks.is_empty:
            return
        body = []
        for number, expression in enumerate(variables_of(self.system).values()):
            body += [f"if which == {float(number)!r}:", f"    return {expression}"]
        self.function("variable", "which, X, P, S", [*body, "return S[1]"])

    def _holding(self) -> None:
        """Write the command of a controller's motor that holds what it moves at rest.

        A motor's effort is a straight line of its command.
        """
        system = self.system
        for number, (name, (_, _, driven, command)) in enumerate(system.loops.items()):
            item = system.held_by(name)
            if self.hooks.is_empty or item is None:
                continue
            acts = f"S[{system.columns[system.column_for(driven, command)].signal}]"
            n = item.number
            shown = ", ".join(f"X[{place}]" for place in range(system.size))
            values = self._values([driven])
            body = [
                f"{', '.join(system.state_names)}, = {shown},",
                f"t, v{n}, acting = S[1], 0.0, {acts}",
                *(f"{acts} = 0.0", *values),
                f"pulled = drive{n}({self.arguments}) + load{n}({self.arguments})",
                *(f"{acts} = 1.0", *values),
                f"gain = drive{n}({self.arguments}) + load{n}({self.arguments}) - pulled",
                *(f"{acts} = acting", *values),
                "return -pulled / gain if gain != 0.0 else 0.0",
            ]
            self.function(f"holding{number}", "X, P, S", body)

    def _measure(self) -> None:
        body = [*self._locals(), *self._show_y()]
        for place, item in enumerate(self.system.outputs):
            if item.command >= 0:
                continue
            value = self.hooks.apply(f"reading:{item.channel}", item.expression, ())
            body.append(f"out[{place}] = {value}")
        self.function("measure", "t, X, P, S, Y, out", body or ["pass"])

    def _values(self, parts: Iterable[BoundElement] | None = None) -> list[str]:
        """Lines that work out the signals that follow from others, of some elements or of all."""
        system = self.system
        lines = []
        for part in system.parts.values() if parts is None else parts:
            for item in part.anatomy.signals:
                if item.value is not None:
                    place = system.signals[f"{part.name}.{item.name}"]
                    value = system.call(part, item.value)
                    if item.hook:
                        value = self.hooks.apply(f"{item.hook}:{part.name}", value, ())
                    lines.append(f"S[{place}] = {value}")
        return lines

    def _advance(self) -> None:
        """Write how elements' own signals move on, and how effects' states do."""
        self._advance_signals()
        system = self.system
        self.function(
            "advance_effects",
            "h, t, X, P, S, Y",
            [*self._show_y(), *self.hooks.advance()] or ["pass"],
        )
        if self.hooks.remember():
            begin = self.hooks.remember("start")
            self.function("forget_commands", "t, X, P, S, Y", begin)
            self.function("remember_commands", "h, t, X, P, S, Y", self.hooks.remember())
        if kept := self.hooks.remember(of_loops=True):
            begin = self.hooks.remember("start", of_loops=True)
            self.function("forget_references", "t, X, P, S, Y", begin)
            self.function("remember_references", "h, t, X, P, S, Y", kept)
        start = [*self._locals(), *self._show_y()]
        for part in system.parts.values():
            for item in part.anatomy.signals:
                if item.start is not None:
                    place = system.signals[f"{part.name}.{item.name}"]
                    start.append(f"S[{place}] = {system.call(part, item.start)}")
        start += self._values()
        self.function("start_signals", "t, X, P, S, Y", start or ["pass"])
        self.function(
            "start_effects", "t, X, P, S, Y", [*self._show_y(), *self.hooks.start()] or ["pass"]
        )

    @property
    def _factors(self) -> list[tuple[BoundElement, HeldSignal]]:
        """Signals that follow from parameters and the length of a step alone."""
        return [
            (part, item)
            for part in self.system.parts.values()
            for item in part.anatomy.signals
            if item.factor is not None
        ]

    def _prepare_signals(self) -> None:
        """Write what `advance_signals` needs of the length of a step."""
        body = []
        for part, item in self._factors:
            assert item.factor is not None
            place = self.system.signals[f"{part.name}.{item.name}"]
            body.append(f"S[{place}] = {self.system.call(part, item.factor, h='h')}")
        if body:
            self.function("prepare_signals", "h, X, P, S", body)

    def _advance_signals(self) -> None:
        self._prepare_signals()
        system = self.system
        body = list(self._locals())
        for part in system.parts.values():
            moving = [item for item in part.anatomy.signals if item.advance is not None]
            for number, item in enumerate(moving):
                assert item.advance is not None
                body.append(f"n{number} = {system.call(part, item.advance, h='h')}")
            for number, item in enumerate(moving):
                body.append(f"S[{system.signals[f'{part.name}.{item.name}']}] = n{number}")
        body += self._values()
        self.function("advance_signals", "h, t, X, P, S, Y", body or ["pass"])

    def _settle(self) -> None:
        """Write how first readings become the states behind them."""
        system = self.system
        body = ["P = pointer(parameters)", "S = pointer(memory)", "X = pointer(shown)"]
        body += ["Y = pointer(state)", "t = 0.0"]
        body += self._activate()
        body += self._show_y()
        for item in system.outputs:
            hook = f"initial:{item.channel}"
            if item.state >= 0 and self.hooks.uses(hook):
                value = self.hooks.apply(hook, f"Y[{item.state}]", ())
                body += [f"if read[{item.state}]:", f"    Y[{item.state}] = {value}"]
        self.function(
            "settle", "read, parameters, memory, shown, state", body, mark="@njit(cache=True)"
        )

    def _activate(self) -> list[str]:
        return [] if self.hooks.is_empty else ["activate(P, S)"]

    # --- the whole simulation ----------------------------------------------------------------

    def _input(self, number: int, column: PlantInput, k: str, middle: str | None) -> str:
        """Return the value of an input column at a tick or within the span after it."""
        at = f"inputs[{k}, {number}]"
        if column.held or middle is None:
            value = at
        else:
            value = f"{at} + {middle} * (inputs[{k} + 1, {number}] - {at})"
        default = "math.nan" if column.default == -2 else "0.0"
        if column.default >= 0:
            default = f"P[{column.default}]"
        return f"({value}) if given[{number}] else {default}"

    def _signal_lines(self, k: str, middle: str | None) -> list[str]:
        lines = []
        for number, column in enumerate(self.system.columns):
            if column.command is None:
                value = self._input(number, column, k, middle)
                lines.append(f"S[{column.signal}] = {value}")
        lines += self._reservoirs()
        return lines

    def _reservoirs(self) -> list[str]:
        """Lines for reservoirs that no input drives."""
        system = self.system
        driven = {column.signal for column in system.columns}
        lines = []
        for node in system.network.nodes.values():
            key = f"{node.name}.pressure"
            if node.kind.value != "reservoir":
                continue
            place = system.signals[key]
            value = f"S[{place}]" if place in driven else str(system.parameter(*key.split(".")))
            hooked = self.hooks.apply(f"pressure:{node.name}", value, ())
            if place not in driven or hooked != value:
                lines.append(f"S[{place}] = {hooked}")
        return lines

    def _asked_lines(self, number: int, column: PlantInput, value: str) -> list[str]:
        """Lines from a command's value to what its drive is asked for."""
        assert column.command is not None
        assert column.part is not None
        system = self.system
        lines = [f"value = {value}"]
        if column.command.limit:
            bound = system.parameter(column.part.name, column.command.limit)
            lines.append(f"value = limited(value, {bound})")
        place = system.demand(column.part, column.command)
        lines.append(f"S[{place}] = value")
        hooked = self.hooks.apply(f"demand:{column.part.name}", "value", ())
        lines.append(f"asked{number} = {hooked}")
        lines.append(f"S[{system.drive_demand(column.part, column.command)}] = asked{number}")
        return lines

    def _commanded(self, number: int, column: PlantInput, now: str, h: str) -> str:
        """Return the expression of a command as it arrives over a time `h` within tick `k`."""
        assert column.part is not None
        known = {"k": "k", "now": now, "h": h, "times": "times", "inputs": f"commands{number}"}
        at = f"command:{column.part.name}"
        return self.hooks.apply(at, f"inputs[k, {number}]", (), known)

    def _acting(self, number: int, column: PlantInput) -> str:
        assert column.part is not None
        return self.hooks.apply(f"drive:{column.part.name}", f"asked{number}", ())

    @property
    def _commands(self) -> list[tuple[int, PlantInput]]:
        return [(k, c) for k, c in enumerate(self.system.columns) if c.command is not None]

    def _imposable(self) -> list[tuple[int, int]]:
        """(column of `imposed`, place in S) of signals that a measured channel may set."""
        found: list[tuple[int, int]] = []
        for item in self.system.outputs:
            if item.signal >= 0:
                found.append((self.system.size + len(found), item.signal))
        return found

    def _bow(self, place: int) -> int:
        """Column of `imposed` that says how a speed bends after each tick (`between`)."""
        return self.system.size + len(self._imposable()) + place

    def _simulate(self) -> None:
        system = self.system
        body = ['"""Advance from tick `first` to tick `last`; see `NetworkPlant.advance`."""',
                "if fresh:",
                # what a first state says of them comes on top of what they begin at
                *(f"    more{place} = memory[{place}]" for place in self.hooks.unread.values()),
                "    memory[:] = 0.0",
                "P = pointer(parameters)", "S = pointer(memory)", "X = pointer(shown)",
                "Y = pointer(state)", "is_imposed = pointer(imposes.view(np.uint8))",
                *self._activate(), f"S[{system.signals[BYPASS]}] = 1.0 if bypass_open else 0.0",
                "t = times[first]"]  # fmt: skip
        for number, column in self._commands:
            body.append(f"asked{number} = 0.0")
            assert column.part is not None
            if self.hooks.uses(f"command:{column.part.name}"):
                body.append(f"commands{number} = inputs[:, {number}]")
        body += self._past_references()
        body += ["if fresh:", *(f"    {line}" for line in self._fresh())]
        body.append("for k in range(first, last + 1):")
        body += [f"    {line}" for line in self._tick()]
        self.function(
            "simulate",
            "first, last, times, inputs, given, imposed, imposes, locked, bypass_open, h_max, "
            "fresh, parameters, memory, shown, state, out",
            body,
            mark="@njit(cache=True, nogil=True)",
        )

    def _past_references(self) -> list[str]:
        """Lines that name what each controller inside the plant is asked for at all ticks."""
        return [
            f"references{number} = inputs[:, {number}]"
            for number, column in enumerate(self.system.columns)
            if self.system.is_followed(column)
            and self.hooks.uses(f"reference:{column.part.name if column.part else ''}")
        ]

    def _fresh(self) -> list[str]:
        """Lines that begin a simulation: what is held, then elements' signals, then effects'."""
        system = self.system
        lines = []
        for place in range(system.size):
            lines += [f"if is_imposed[{place}]:", f"    Y[{place}] = imposed[first, {place}]"]
        lines += self._signal_lines("first", None)
        measured = {signal: column for column, signal in self._imposable()}
        if self.hooks.remember():
            lines += self._forgotten("max(first - 1, 0)")
        lines += self._references_begin()
        for number, column in self._commands:
            assert column.command is not None
            assert column.part is not None
            if column.signal in measured:
                # what flows at the first sample was read there; without a reading nothing does
                lines.append(f"S[{column.signal}] = Y[{measured[column.signal]}]")
            else:
                at = f"inputs[max(first - 1, 0), {number}] if given[{number}] else 0.0"
                lines += self._asked_lines(number, column, at)
                lines.append(f"S[{column.signal}] = asked{number}")
        lines += self._loops_begin()
        lines += self._references_go_on()
        lines.append("start_signals(t, X, P, S, Y)")
        for column_, signal in self._imposable():
            name = next(key for key, place in system.signals.items() if place == signal)
            if not any(c.signal == signal for _, c in self._commands):
                # read at the first sample, or else as its command has it
                lines += [f"if not math.isnan(Y[{column_}]):", f"    S[{signal}] = Y[{column_}]"]
            del name
        lines.append("start_effects(t, X, P, S, Y)")
        lines += [f"S[{place}] += more{place}" for place in self.hooks.unread.values()]
        if self._warms_up:
            lines += self._warm_up()
        return lines

    @property
    def _warms_up(self) -> bool:
        """Whether anything remembers what was asked for before the first tick."""
        return bool(self.hooks.remember()) or any(
            item.advance is not None
            for part in self.system.parts.values()
            for item in part.anatomy.signals
        )

    def _forgotten(self, row: str) -> list[str]:
        """Lines that begin what follows from commands alone at those of a row."""
        lines = []
        for number, column in self._commands:
            at = f"inputs[{row}, {number}] if given[{number}] else 0.0"
            lines += self._asked_lines(number, column, at)
        return [*lines, "forget_commands(t, X, P, S, Y)"]

    def _warm_up(self) -> list[str]:
        lines = self._forgotten("0") if self.hooks.remember() else []
        lines += ["for k in range(first):", "    h = times[k + 1] - times[k]"]
        remembered = bool(self.hooks.remember())
        if remembered:
            # what a spool follows moves within a tick where an effect lags before it, and else is
            # exact in one; who asks for a microsecond looks at what begins, and not at what was
            lines += ["    within = math.ceil(h / max(h_max, FINE))",
                      f"    parts = max(1, within) if {self.hooks.is_remembering()} else 1",
                      "    h = h / parts"]  # fmt: skip
        if self._factors:
            lines.append("    prepare_signals(h, X, P, S)")
        for number, column in self._commands:
            assert column.part is not None
            if again := self.hooks.restart(f"command:{column.part.name}"):
                # before the oldest row was what stood there, and turns of long ago have all arrived
                lines += [f"    if k == 0 or times[k + 1] - times[k] < {10.0 * AT_ONCE!r}:",
                          f"        S[{column.signal}] = inputs[k, {number}]",
                          *(f"        {line}" for line in again)]  # fmt: skip
            # a spool follows what has arrived
            value = self._commanded(number, column, "times[k]", "(times[k + 1] - times[k])")
            value = f"{value} if given[{number}] else 0.0"
            lines += [f"    {line}" for line in self._asked_lines(number, column, value)]
        step = ["remember_commands(h, t, X, P, S, Y)"] if remembered else []
        step += [f"S[{column.signal}] = {self._acting(n, column)}" for n, column in self._commands]
        step.append("advance_signals(h, t, X, P, S, Y)")
        if remembered:
            lines.append("    for part in range(parts):")
        lines += [f"    {'    ' * remembered}{line}" for line in step]
        return lines

    def _references_begin(self) -> list[str]:
        """Lines that bring what follows from references to the tick before the first one."""
        if not self.hooks.remember(of_loops=True):
            return []
        return [
            f"if {self.hooks.is_remembering(of_loops=True)}:",
            *(f"    {line}" for line in self._show_y()),
            *(f"    {line}" for line in self._references_at("0")),
            "    forget_references(t, X, P, S, Y)",
            "    for k in range(first - 1):",
            *(f"        {line}" for line in self._reference_moves()),
        ]

    def _references_go_on(self) -> list[str]:
        """Lines that bring what follows from references to the first tick."""
        if not self.hooks.remember(of_loops=True):
            return []
        return [
            f"if {self.hooks.is_remembering(of_loops=True)}:",
            "    for k in range(max(first - 1, 0), first):",
            *(f"        {line}" for line in self._reference_moves()),
            *(f"    {line}" for line in self._references_at("first")),
        ]

    def _reference_moves(self) -> list[str]:
        """Lines that move on what follows from references over tick `k`."""
        return [
            *self._references_at("k"),
            "remember_references(times[k + 1] - times[k], t, X, P, S, Y)",
        ]

    def _references_at(self, row: str) -> list[str]:
        """Lines that show the effects what controllers are asked for at a row of the inputs."""
        followed = [
            (number, column)
            for number, column in enumerate(self.system.columns)
            if self.system.is_followed(column)
        ]
        return [
            f"S[{column.signal}] = {self._input(number, column, row, None)}"
            for number, column in followed
        ]

    def _loop_lines(self) -> list[str]:
        """Lines of the controllers inside the plant, once a tick."""
        lines = []
        for name in self.system.loops:
            asked = self._asked_by(name, "k", "speed")
            if asked is None:
                continue
            before, older = f"S[{self._memory_of(name, 0)}]", f"S[{self._memory_of(name, 1)}]"
            lines += [
                f"if given[{asked.reference}]:",
                *(f"    {line}" for line in self._show_y()),
                f"    reading = {asked.reading}",
                "    if k == first and fresh:",
                f"        {before} = reading - {asked.period} * {asked.speed}",
                f"        {older} = {before} - {asked.period} * {asked.speed}",
                f"    speed = (reading - {older}) / (2.0 * {asked.period})",
                *(f"    {line}" for line in asked.lines),
                f"    inputs[k, {asked.of[0]}] = {asked.command}",
                # a last moment is read again where a session goes on
                "    if k < last:",
                f"        {older} = {before}",
                f"        {before} = reading",
            ]
        return lines

    def _loops_begin(self) -> list[str]:
        """Lines of what the controllers inside the plant had asked for before the first tick.

        A window may begin in the midst of a motion: a motor without its command would jerk there.
        """
        lines = []
        read = {signal for _, signal in self._imposable()}
        for name in self.system.loops:
            asked = self._asked_by(name, "max(first - 1, 0)", "speed")
            if asked is None:
                continue
            # what flows at the first sample may have been read there
            is_read = asked.of[1].signal in read
            if asked.lines or not is_read:
                lines += [
                    f"if given[{asked.reference}]:",
                    *(f"    {line}" for line in self._show_y()),
                    f"    speed = {asked.speed}",
                    # a period ago
                    f"    reading = {asked.reading} - {asked.period} * speed",
                    *(f"    {line}" for line in asked.lines),
                ]
            if not is_read:
                lines += [
                    *(f"    {line}" for line in self._asked_lines(*asked.of, asked.command)),
                    f"    S[{asked.of[1].signal}] = asked{asked.of[0]}",
                    # what is delayed looks back at it
                    "    for j in range(first):",
                    f"        inputs[j, {asked.of[0]}] = asked{asked.of[0]}",
                ]
        return lines

    def _asked_by(self, name: str, row: str, speed: str) -> _Asked | None:
        """Return what a controller inside the plant asks for; None where nothing is its reference.

        Args:
            name: of the controller. row: of the inputs. speed: what it takes for its speed.
        """
        system = self.system
        part, loop, driven, command = system.loops[name]
        number = system.column_for(driven, command)
        node = part.element.ports[loop.reads]
        coordinate = system.leader_of(node)
        shown = system.channel_showing(coordinate.position)
        reading = system.position(node).replace(
            f"x{coordinate.number}", f"Y[{coordinate.position}]"
        )
        if shown:
            reading = self.hooks.apply(f"reading:{shown}", reading, ())
        own = {
            signal: [
                k for k, column in enumerate(system.columns)
                if column.part is part and column.signal == system.signals[f"{name}.{signal}"]
            ]
            for signal in (loop.reference, loop.added)
        }  # fmt: skip
        if not own[loop.reference]:
            return None
        reference, period = own[loop.reference][0], system.parameter(part.name, loop.period)
        assert period is not None
        followed, lines = f"inputs[{row}, {reference}]", []
        known = ("reading", "period", "speed")
        by_reference, by_command = f"reference:{part.name}", f"loop_command:{part.name}"
        if self.hooks.uses(by_reference) or self.hooks.uses(by_command):
            past = {"k": row, "now": f"times[{row}]", "h": "period", "times": "times",
                    "inputs": f"references{reference}"}  # fmt: skip
            hooked = self.hooks.apply(by_reference, followed, known, past)
            error = system.loop_error(name)
            lines = [f"period = {period}", f"reference = {hooked}"]
            lines.append(f"S[{error}] = reference - reading")
            followed = "reference"
        value = system.call(part, loop.law, reading="reading", speed=speed, reference=followed)
        if self.hooks.uses(by_command):
            law = f"S[{system.loop_law(name)}]"
            lines.append(f"{law} = {value}")
            value = self.hooks.apply(by_command, law, known)
        for added in own[loop.added][:1]:
            value += f" + (inputs[{row}, {added}] if given[{added}] else 0.0)"
        return _Asked(
            reference,
            (number, system.columns[number]),
            reading,
            f"Y[{coordinate.speed}]",
            period,
            lines,
            value,
        )

    def _memory_of(self, loop: str, which: int) -> int:
        """Place in S of a loop's earlier readings."""
        return self.system.loop_memory(loop) + which

    def _tick(self) -> list[str]:
        system = self.system
        lines = ["t = times[k]"]
        for place in range(system.size):
            lines += [f"if is_imposed[{place}]:", f"    Y[{place}] = imposed[k, {place}]"]
        for column, signal in self._imposable():
            lines += [f"if is_imposed[{column}]:", f"    S[{signal}] = imposed[k, {column}]"]
        lines += self._loop_lines()
        for place, shown in enumerate(system.outputs):
            if shown.command >= 0:
                number = shown.command
                value = f"inputs[k, {number}]"
                hooked = self.hooks.apply(f"asked:{shown.channel}", value, ())
                if hooked != value:
                    lines += [*self._show_y(), f"inputs[k, {number}] = {hooked}"]
                lines.append(f"out[k, {place}] = {value}")
        lines += [
            "measure(t, X, P, S, Y, pointer(out[k]))",
            "if k == last:",
            "    break",
            "span = times[k + 1] - t",
        ]
        longest = "h_max"
        if system.has_springs:
            longest = f"resolved(h_max, {', '.join(self._from_y())}, t, X, P, S)"
        longest = self.hooks.apply("longest", longest, ("locked",))
        lines += [f"count = max(1, math.ceil(span / {longest} - 1e-6))", "h = span / count"]
        for item in system.coordinates:
            lines += [
                f"if is_imposed[{item.position}] and not is_imposed[{item.speed}]:",
                f"    Y[{item.speed}] = (imposed[k + 1, {item.position}] - "
                f"imposed[k, {item.position}]) / span",
            ]
        if self._factors:
            lines.append("prepare_signals(0.5 * h, X, P, S)")
        lines.append("for n in range(count):")
        lines += [f"    {line}" for line in self._within()]
        return lines

    def _effects_move(self, now: str) -> list[str]:
        """Lines that move the effects' own states on by half a substep."""
        if self.hooks.is_empty:
            return []
        return [
            f"if {self.hooks.is_on(STATES)}:",
            f"    advance_effects(0.5 * h, {now}, X, P, S, Y)",
        ]

    def _within(self) -> list[str]:
        """Lines of one substep."""
        system = self.system
        lines = ["now = t + n * h", "middle = (n + 0.5) / count"]
        lines += self._signal_lines("k", "middle")
        for item in system.coordinates:
            lines += [
                f"if is_imposed[{item.speed}]:",
                f"    Y[{item.speed}] = imposed[k, {item.speed}] + middle * "
                f"(imposed[k + 1, {item.speed}] - imposed[k, {item.speed}])",
                # the mean over the substep: what a pump moves is right with any number of them
                "    bow = middle * (1.0 - middle) - 1.0 / (12.0 * count * count)",
                f"    Y[{item.speed}] += bow * imposed[k, {self._bow(item.speed)}]",
            ]
        for number, column in self._commands:
            assert column.part is not None
            value = self._commanded(number, column, "now", "h")
            looped = any(
                system.column_for(driven, command) == number
                for _, _, driven, command in system.loops.values()
            )
            if not looped:
                value = f"{value} if given[{number}] else 0.0"
            lines += self._asked_lines(number, column, value)
        lines += self._effects_move("now")
        imposable = {signal: column for column, signal in self._imposable()}
        for number, column in self._commands:
            value = self._acting(number, column)
            if column.signal in imposable:
                at = imposable[column.signal]
                # a logged current is what flowed until its sample
                value = f"imposed[k + 1, {at}] if is_imposed[{at}] else {value}"
            lines.append(f"S[{column.signal}] = {value}")
        lines += [
            "advance_signals(0.5 * h, now, X, P, S, Y)",
            "substep(h, now, locked, is_imposed, X, P, S, Y)",
        ]
        for volume in system.volumes:
            j = volume.pressure
            lines += [
                f"if is_imposed[{j}]:",
                "    share = (n + 1.0) / count",
                f"    Y[{j}] = imposed[k, {j}] + share * (imposed[k + 1, {j}] - imposed[k, {j}])",
            ]
        lines += self._effects_move("now + 0.5 * h")
        for number, column in self._commands:
            lines.append(f"S[{column.signal}] = {self._acting(number, column)}")
        lines.append("advance_signals(0.5 * h, now + 0.5 * h, X, P, S, Y)")
        return lines
