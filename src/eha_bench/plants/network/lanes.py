"""Writes the kernel of a sweep: many parameter sets over the same input, in step.

LANES sets advance together. One loop over them holds a whole step without branches, so LLVM turns
it into vector instructions: the terms are those of the scalar kernel, with every number of `P`, `S`
and `Y` in a row of one block, a set a column. The rows are at distances that are known when it is
compiled, or LLVM could not tell that they do not overlap. A set in which something stops, reaches
an end, in which a valve switches, or whose numbers leave the range of `vector_math`, is marked and
left as it was, and its step is done by the scalar kernel's `substep`.

Without effects and without friction that creeps: such sets are simulated one by one.

Results differ from the scalar kernel's by rounding: products and sums are fused, quotients of one
divisor become products, and `vector_math` stands for the C library.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from eha_bench.plants.network.element import Law
from eha_bench.plants.network.hooks import Hooks
from eha_bench.plants.network.integration import LANES
from eha_bench.plants.network.source import Writer
from eha_bench.plants.network.system import Coordinate, PlantInput, System
from eha_bench.plants.network.vector_math import vectorised_law

_HEAD = '''"""Generated: the kernel of a plant's sweeps."""

import math

import numba
import numpy as np

from {scalar} import substep
from eha_bench.plants.compiled import njit as inner
from eha_bench.plants.network import integration
from eha_bench.plants.network.integration import FINE, GAMMA
from eha_bench.plants.network.vector_math import vectorised_law
from eha_bench.plants.pointer import pointer


def njit(function=None, **options):
    kind = numba.njit if "cache" in options else inner
    mark = kind(error_model="numpy", fastmath={{"contract", "arcp"}}, **options)
    return mark if function is None else mark(function)


def lane(law):
    return njit(vectorised_law(law), forceinline=True)


'''
_HELPERS = ("breaks_away", "limited", "switches")
"""Functions of `integration` that a lane calls."""
_PARAMETER = re.compile(r"\bP\[(\d+)\]")
_SIGNAL = re.compile(r"\bS\[(\d+)\]")
_STATE = re.compile(r"\bY\[(\d+)\]")
_SCALAR = re.compile(r"\bX, P, S(, Y)?\b")
_BLOCK = "lane, B"
_INLINE = "@njit(forceinline=True)"


def sweep_source(system: System, hooks: Hooks, scalar: str, parameters: int) -> str | None:
    """Return the source of a system's sweep, None where a law of it cannot be vectorised.

    Args:
        system: the network. hooks: without effects. scalar: name of the scalar kernel's module.
        parameters: length of `P`.
    """
    writer = LaneWriter(system, hooks, scalar, parameters)
    text = writer.text()
    return text if all(vectorised_law(law) is not None for law in writer.laws) else None


class LaneWriter(Writer):
    """Writes a kernel that advances LANES parameter sets in step.

    Args:
        system: the network. hooks: without effects. scalar: name of the scalar kernel's module.
        parameters: length of `P`.
    """

    def __init__(self, system: System, hooks: Hooks, scalar: str, parameters: int) -> None:
        super().__init__(system, hooks)
        self.scalar = scalar
        self.mark = system.size
        self.first_parameter = system.size + 1
        self.first_signal = self.first_parameter + parameters
        self.signals = len(system.signals)
        self.rows = self.first_signal + self.signals

    @property
    def laws(self) -> list[Law]:
        """The laws that the source calls."""
        text = "\n".join(self.lines)
        return [law for law, name in self.system.laws.items() if f"{name}(" in text]

    def text(self) -> str:
        """Return the source."""
        system = self.system
        for item in system.coordinates:
            self._coordinate(item)
            if self._has_friction(item):
                self._direction(item)
        self._slopes()
        self._rates()
        self._step()
        self._advance_signals()
        self._before()
        self._lanes()
        if self._moves_signals:
            self._after()
        self._readings()
        self._write_marked_step()
        self._sweep()
        head = [_HEAD.format(scalar=self.scalar)]
        for law in self.laws:
            name = system.laws[law]
            head += [
                f"from {law.__module__} import {law.__name__} as {name}_py",
                f"{name} = lane({name}_py)",
            ]
        head += [f"{name} = lane(integration.{name})" for name in _HELPERS]
        return "\n".join([*head, *self.lines, ""])

    # --- lanes -------------------------------------------------------------------------------

    def function(self, name: str, arguments: str, body: Iterable[str], mark: str = _INLINE) -> None:
        """Write a function of one lane, or of all where a `mark` says how it is compiled."""
        mark = _INLINE if mark == "@njit" else mark
        super().function(
            name, self._in_block(arguments), [self._in_block(line) for line in body], mark
        )

    def _whole(self, name: str, arguments: str, body: Iterable[str], mark: str = "@njit()") -> None:
        """Write a function of all lanes."""
        super().function(name, arguments, body, mark)

    def _in_block(self, text: str) -> str:
        """Return a text over `P`, `S` and `Y` as one over a lane of the block."""
        text = _PARAMETER.sub(lambda m: self._at(self.first_parameter + int(m[1])), text)
        text = _SIGNAL.sub(lambda m: self._at(self.first_signal + int(m[1])), text)
        text = _STATE.sub(lambda m: self._at(int(m[1])), text)
        return _SCALAR.sub(_BLOCK, text)

    @staticmethod
    def _at(row: int) -> str:
        return f"B[{row * LANES} + lane]"

    def _each_lane(self, body: Iterable[str]) -> list[str]:
        return [f"for lane in range({LANES}):", *(f"    {self._in_block(line)}" for line in body)]

    # --- terms without branches --------------------------------------------------------------

    def _direction(self, item: Coordinate) -> None:
        n = item.number
        against, away = self._breaks_away(item)
        moving = [f"away = {away}", f"along = 1.0 if v{n} > 0.0 else -1.0"]
        result = f"return along if v{n} != 0.0 else away"
        self.function(f"direction{n}", self.arguments, [*against, *moving, result])

    def _acceleration(self, item: Coordinate) -> list[str]:
        n = item.number
        acting, acceleration = self._balance(item)
        return [
            *acting,
            f"rate = {acceleration}",
            f"dv{n}, sv{n} = rate if d{n} != 0.0 else 0.0, 0.0",
        ]

    def _lanes(self) -> None:
        """Write a step of all lanes; a lane that has to be done by `substep` is left as it was."""
        system = self.system
        names = system.state_names
        body = [*self._locals(), "mark = False"]
        late: list[str] = []
        for item in system.coordinates:
            n = item.number
            stopping = self._has_friction(item)
            body.append(f"d{n} = {f'direction{n}({self.arguments})' if stopping else '1.0'}")
            if n in system.locked_coordinates:
                body.append(f"d{n} = 0.0 if locked else d{n}")
            stroke = system.stroke(item)
            if stroke is not None:
                body.append(f"low{n}, high{n} = {stroke[0]}, {stroke[1]}")
                push = f"d{n}" if stopping else f"net{n}(0.0, {self.arguments})"
                body += [
                    f"push = {push}",
                    f"ends = (x{n} >= high{n}) & (push > 0.0) | (x{n} <= low{n}) & (push < 0.0)",
                    f"d{n} = 0.0 if (v{n} == 0.0) & ends else d{n}",
                ]
                late.append(f"mark = mark | (x{n}_ > high{n}) | (x{n}_ < low{n})")
            if stopping:
                late.append(f"mark = mark | (d{n} != 0.0) & (d{n} * v{n}_ <= 0.0)")
        ends_ = [f"{name}_" for name in names]
        total = " + ".join(ends_)
        # not finite: its difference to itself is not a number
        late += [f"total = {total}", "mark = mark | (total - total != 0.0)"]
        if self.switching:
            met, tests = self._switches()
            late += [*met, f"mark = mark | fine & ({' | '.join(tests)})"]
        body += [self._call_step("h"), *late]
        for place, name in enumerate(names):
            body.append(f"Y[{place}] = {name} if mark else {name}_")
        body.append(f"Y[{self.mark}] = 1.0 if mark else 0.0")
        self._whole("step_lanes", "h, t, locked, B", ["fine = h > FINE", *self._each_lane(body)])
        marks = " + ".join(f"B[{self.mark * LANES + lane}]" for lane in range(LANES))
        self._whole("any_marked", "B", [f"return {marks} != 0.0"])

    # --- between steps -----------------------------------------------------------------------

    def _input(self, number: int, column: PlantInput, k: str, middle: str | None) -> str:
        default = "math.nan" if column.default == -2 else "0.0"
        if column.default >= 0:
            default = f"P[{column.default}]"
        return f"u{number} if given{number} else {default}"

    @property
    def _driving_columns(self) -> list[int]:
        """Columns that set a signal in every step."""
        return [n for n, c in enumerate(self.system.columns) if c.command is None]

    @property
    def _uniform(self) -> list[str]:
        """What all lanes have in common within a step."""
        names = []
        for number, column in enumerate(self.system.columns):
            names += [f"u{number}", *([f"given{number}"] if column.command is None else [])]
        return names

    def _uniform_lines(self) -> list[str]:
        lines = []
        for number, column in enumerate(self.system.columns):
            value = f"inputs[k, {number}]"
            if column.command is None and not column.held:
                value = f"{value} + middle * (inputs[k + 1, {number}] - inputs[k, {number}])"
            lines.append(f"u{number} = {value} if given[{number}] else 0.0")
            if column.command is None:
                lines.append(f"given{number} = given[{number}]")
        return lines

    @property
    def _moves_signals(self) -> bool:
        return self._warms_up

    def _before(self) -> None:
        """Write what the signals are within a step."""
        body = []
        for number in self._driving_columns:
            column = self.system.columns[number]
            body.append(f"S[{column.signal}] = {self._input(number, column, 'k', 'middle')}")
        for number, column in self._commands:
            body += self._asked_lines(number, column, f"u{number}")
            body.append(f"S[{column.signal}] = asked{number}")
        body.append("advance_signals(0.5 * h, t, X, P, S, Y)")
        if self._factors:
            self._whole(
                "signals_prepared", "h, B", self._each_lane(["prepare_signals(h, X, P, S)"])
            )
        arguments = ", ".join(["h", "t", *self._uniform, "B"])
        self._whole("signals_before", arguments, self._each_lane(body))

    def _after(self) -> None:
        """Write how the signals move on to the end of a step."""
        body = ["advance_signals(0.5 * h, t, X, P, S, Y)"]
        self._whole("signals_after", "h, t, B", self._each_lane(body))

    def _readings(self) -> None:
        """Write what is read at a tick."""
        body = self._locals()
        for place, item in enumerate(self.system.outputs):
            value = f"u{item.command}" if item.command >= 0 else item.expression
            body.append(f"out[{place * LANES} + lane] = {value}")
        commands = [f"u{item.command}" for item in self.system.outputs if item.command >= 0]
        arguments = ", ".join(["t", *commands, "B", "out"])
        self._whole("readings", arguments, self._each_lane(body))

    def _write_marked_step(self) -> None:
        """Write the step of the marked lanes, by the scalar kernel."""
        size, signals = self.system.size, self.signals
        copies = [
            f"for row in range({size}):",
            f"    Y[row] = B[row * {LANES} + lane]",
            f"for row in range({signals}):",
            f"    S[row] = B[({self.first_signal} + row) * {LANES} + lane]",
            "P = pointer(parameters[lane])",
            "substep(h, t, locked, is_imposed, X, P, S, Y)",
            f"for row in range({size}):",
            f"    B[row * {LANES} + lane] = Y[row]",
        ]
        body = [
            f"for lane in range({LANES}):",
            f"    if {self._at(self.mark)} != 0.0:",
            *(f"        {line}" for line in copies),
        ]
        self._whole("redo_marked", "h, t, locked, is_imposed, parameters, X, S, Y, B", body)

    def _sweep(self) -> None:
        system = self.system
        size, signals = system.size, self.signals
        shown = [item.command for item in system.outputs if item.command >= 0]
        commands = "".join(f"inputs[k, {number}], " for number in shown)
        inside = [
            "now = t + n * h",
            "middle = (n + 0.5) / count",
            *self._uniform_lines(),
            f"signals_before({', '.join(['h', 'now', *self._uniform, 'B'])})",
            "step_lanes(h, now, locked, B)",
            "if any_marked(B):",
            "    redo_marked(h, now, locked, is_imposed, parameters, X, S, Y, B)",
        ]
        if self._moves_signals:
            inside.append("signals_after(h, now + 0.5 * h, B)")
        body = [
            '"""Advance LANES sets from tick `first` to the last; see `NetworkPlant.sweep`."""',
            f"block, memory, shown = np.zeros({self.rows * LANES}), np.zeros({signals}), "
            f"np.zeros({size + 1})",
            f"state, imposes = np.zeros({size}), np.zeros({size + 1}, dtype=np.uint8)",
            "B, S, X, Y = pointer(block), pointer(memory), pointer(shown), pointer(state)",
            "is_imposed = pointer(imposes)",
            f"for lane in range({LANES}):",
            f"    for row in range({size}):",
            f"        B[row * {LANES} + lane] = states[lane, row]",
            f"    for row in range({self.first_signal - self.first_parameter}):",
            f"        B[({self.first_parameter} + row) * {LANES} + lane] = parameters[lane, row]",
            f"    for row in range({signals}):",
            f"        B[({self.first_signal} + row) * {LANES} + lane] = memories[lane, row]",
            "last = times.size - 1",
            "for k in range(first, last + 1):",
            "    t = times[k]",
            f"    readings(t, {commands}B, pointer(out[k]))",
            "    if k == last:",
            "        break",
            "    span = times[k + 1] - t",
            "    count = max(1, math.ceil(span / h_max - 1e-6))",
            "    h = span / count",
            *(["    signals_prepared(0.5 * h, B)"] if self._factors else []),
            "    for n in range(count):",
            *(f"        {line}" for line in inside),
        ]
        self._whole(
            "sweep",
            "first, times, inputs, given, locked, h_max, parameters, memories, states, out",
            body,
            "@njit(cache=True, nogil=True)",
        )
