"""Where the wanted numbers stand in one serialized ROS message, and what makes others alike.

CDR: OMG DDS-XTypes 1.3, section 7.4 (XCDR1). ROS 1: https://wiki.ros.org/ROS/Technical%20Overview
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cached_property

from eha_bench.recordings.definitions import (
    Array,
    DefinitionError,
    Definitions,
    Nested,
    Primitive,
    Sequence,
    Text,
    Type,
    standard,
)
from eha_bench.recordings.field_path import (
    ALIASES,
    Attribute,
    Element,
    FieldPath,
    NamedElement,
    Step,
)

_DEEPEST = 32
_MOST_ELEMENTS = 1_000_000


class PayloadError(Exception):
    """A message's bytes do not fit its definition; says why."""


@dataclass(frozen=True)
class Leaf:
    """A number: its offset in the payload and its NumPy type."""

    offset: int
    code: str


@dataclass(frozen=True)
class Layout:
    """Where the numbers stand in every message that has the same size and the same `guards`.

    Attributes:
        leaves: one a path, None where this message has no such element.
        guards: (offset, bytes) that decide where everything stands: lengths, and looked-up names.
    """

    leaves: tuple[Leaf | None, ...]
    guards: tuple[tuple[int, bytes], ...]

    @cached_property
    def words(self) -> tuple[tuple[int, str, int], ...]:
        """The guards as numbers to compare: (offset, NumPy type, value)."""
        return tuple(
            (offset + start, f"<u{width}", int.from_bytes(raw[start : start + width], "little"))
            for offset, raw in self.guards
            for start, width in _widths(len(raw))
        )


def resolve(definitions: Definitions, name: str) -> tuple[tuple[str, Type], ...]:
    """Return the fields of a message type, from the log or from the standard ones.

    Raises:
        DefinitionError: nobody defines it.
    """
    fields = definitions.get(name)
    if fields is None:
        fields = standard().get(name)
    if fields is None:
        raise DefinitionError(f"type '{name}' is not defined in the recording")
    return fields


def check_path(definitions: Definitions, name: str, path: FieldPath) -> None:
    """Check that a path leads to a number of message type `name`.

    Raises:
        DefinitionError: no such field, not an array, or not a number; says what there is.
    """
    kind: Type = Nested(name)
    for step in path.steps:
        match step, kind:
            case Attribute(attribute), Nested(owner):
                fields = dict(resolve(definitions, owner))
                found = fields.get(attribute) or fields.get(ALIASES.get(attribute, ""))
                if found is None:
                    listed = ", ".join(fields) or "none"
                    raise DefinitionError(
                        f"{owner} has no field '{attribute}'; its fields are {listed}"
                    )
                kind = found
            case ((Element() | NamedElement()), (Array() | Sequence())):
                kind = kind.element
            case Attribute(attribute), _:
                raise DefinitionError(f"'.{attribute}' of something that has no fields")
            case _:
                raise DefinitionError(f"'{path}' takes an element of something that is no array")
    if not isinstance(kind, Primitive):
        what = "an array: add an index, e.g. [0]" if isinstance(kind, (Array, Sequence)) else "text"
        what = "a message" if isinstance(kind, Nested) else what
        raise DefinitionError(f"'{path}' is not a number but {what}")


def layout_of(
    payload: memoryview,
    definitions: Definitions,
    name: str,
    paths: tuple[FieldPath, ...],
    *,
    ros1: bool,
) -> Layout:
    """Walk one message and return where `paths` stand in it.

    Raises:
        PayloadError: the bytes end too early, a length is impossible, or the encoding is another.
        DefinitionError: a nested type is not defined.
    """
    walker = _Walker(payload, definitions, ros1, len(paths))
    wanted = [(index, path.steps) for index, path in enumerate(paths)]
    walker.message(name, wanted, 0)
    leaves = tuple(walker.leaves)
    # what stands behind the last wanted number does not matter, unless a number was not there
    last = max((leaf.offset for leaf in leaves if leaf), default=0)
    guards = tuple(g for g in walker.guards if g[0] < last or None in leaves)
    return Layout(leaves, guards)


def _widths(size: int) -> list[tuple[int, int]]:
    """Return how to cut `size` bytes into words: (start, width)."""
    words = []
    start = 0
    while start < size:
        width = next(width for width in (8, 4, 2, 1) if width <= size - start)
        words.append((start, width))
        start += width
    return words


_Wanted = list[tuple[int, tuple[Step, ...]]]


class _Walker:
    """A cursor over one message."""

    def __init__(
        self, payload: memoryview, definitions: Definitions, ros1: bool, count: int
    ) -> None:
        self.payload = payload
        self.definitions = definitions
        self.leaves: list[Leaf | None] = [None] * count
        self.guards: list[tuple[int, bytes]] = []
        self.order = "<"
        self.origin = 0
        self.ros1 = ros1
        self.visited = 0
        if not ros1:
            self._encapsulation()
        self.position = self.origin

    def _encapsulation(self) -> None:
        head = bytes(self.payload[:4])
        if len(head) < 4 or head[0] != 0 or head[1] not in (0, 1):
            raise PayloadError(
                f"its first bytes are {head.hex() or 'missing'}, not those of plain CDR"
            )
        self.order = "<" if head[1] else ">"
        self.origin = 4
        self.guards.append((0, head))

    def message(self, name: str, wanted: _Wanted, depth: int) -> None:
        """Walk the fields of a message."""
        if depth > _DEEPEST:
            raise PayloadError(f"type '{name}' is nested deeper than {_DEEPEST} messages")
        fields = resolve(self.definitions, name)
        names = next((i for i, field in enumerate(fields) if field[0] == "name"), None)
        by_name = [item for item in wanted if _looks_up_name(item[1])]
        labels: list[str] = []
        for index, (field, kind) in enumerate(fields):
            inner = [
                (leaf, steps[1:])
                for leaf, steps in wanted
                if isinstance(steps[0], Attribute)
                and (steps[0].name == field or ALIASES.get(steps[0].name) == field)
            ]
            if by_name and index == names:
                labels = self._labels(kind)
                continue
            if labels:
                inner = [(leaf, _by_index(steps, labels)) for leaf, steps in inner]
            self._value(kind, inner, depth)

    def _labels(self, kind: Type) -> list[str]:
        """Read the array of names; its bytes decide which element is which."""
        if not isinstance(kind, (Array, Sequence)) or not isinstance(kind.element, Text):
            raise PayloadError("elements are asked for by name, but 'name' is not a list of texts")
        start = self.position
        count = kind.length if isinstance(kind, Array) else self._length()
        labels = []
        for _ in range(self._bounded(count, 4)):
            size = self._length()
            labels.append(self._take(size).rstrip(b"\0").decode("utf-8", "replace"))
        self.guards.append((start, bytes(self.payload[start : self.position])))
        return labels

    def _value(self, kind: Type, wanted: _Wanted, depth: int) -> None:
        match kind:
            case Primitive():
                self._align(kind.size)
                for leaf, _ in wanted:
                    order = "" if kind.size == 1 else self.order
                    self.leaves[leaf] = Leaf(self.position, order + kind.code)
                self._skip(kind.size)
            case Text(wide):
                self._skip(self._length() * (2 if wide else 1))
            case Nested(name):
                self.message(name, wanted, depth + 1)
            case Array(element, length):
                self._elements(element, length, wanted, depth)
            case Sequence(element):
                self._elements(element, self._length(), wanted, depth)

    def _elements(
        self, element: Primitive | Text | Nested, count: int, wanted: _Wanted, depth: int
    ) -> None:
        if isinstance(element, Primitive):
            if count:
                self._align(element.size)
            start = self.position
            self._skip(count * element.size)
            order = "" if element.size == 1 else self.order
            for leaf, steps in wanted:
                step = steps[0]
                if isinstance(step, Element) and step.index < count:
                    offset = start + step.index * element.size
                    self.leaves[leaf] = Leaf(offset, order + element.code)
            return
        for index in range(self._bounded(count, 0)):
            inner = [(leaf, steps[1:]) for leaf, steps in wanted if steps[0] == Element(index)]
            self._value(element, inner, depth)

    def _bounded(self, count: int, least: int) -> int:
        """Return a number of elements that can be true: no loop is longer than the message."""
        self.visited += count
        room = len(self.payload) - self.position
        if count * max(least, 1) > room or self.visited > _MOST_ELEMENTS:
            raise PayloadError(f"an array claims {count} elements in {room} bytes")
        return count

    def _align(self, size: int) -> None:
        if not self.ros1:
            self.position += -(self.position - self.origin) % size

    def _length(self) -> int:
        self._align(4)
        start = self.position
        raw = self._take(4)
        self.guards.append((start, raw))
        return int(struct.unpack(self.order + "I", raw)[0])

    def _take(self, size: int) -> bytes:
        start = self.position
        self._skip(size)
        return bytes(self.payload[start : start + size])

    def _skip(self, size: int) -> None:
        self.position += size
        if self.position > len(self.payload):
            raise PayloadError(f"it ends after {len(self.payload)} bytes, too early for its type")


def _looks_up_name(steps: tuple[Step, ...]) -> bool:
    return len(steps) > 1 and isinstance(steps[1], NamedElement)


def _by_index(steps: tuple[Step, ...], labels: list[str]) -> tuple[Step, ...]:
    if steps and isinstance(steps[0], NamedElement) and steps[0].name in labels:
        return (Element(labels.index(steps[0].name)), *steps[1:])
    return steps
