"""A cursor over one serialized ROS message: finds numbers by their paths.

CDR: OMG DDS-XTypes 1.3, section 7.4 (XCDR1, and plain XCDR2).
ROS 1: https://wiki.ros.org/ROS/Technical%20Overview
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from eha_bench.recordings.budget import budget
from eha_bench.recordings.encodings.definitions import (
    Array,
    Definitions,
    Nested,
    Primitive,
    Sequence,
    Text,
    Type,
    resolve,
)
from eha_bench.recordings.encodings.field_path import (
    ALIASES,
    ArrayItem,
    Attribute,
    FieldPath,
    NamedElement,
    Step,
    lists_names,
)

_DEEPEST = 32
_MOST_ELEMENTS = 250_000
_TICK = 1024
_XCDR1, _XCDR2 = (0, 1), (6, 7, 16, 17)
_OTHERS = {
    **dict.fromkeys((2, 3, 10, 11, 18, 19), "a parameter list"),
    **dict.fromkeys((8, 9, 20, 21), "delimited XCDR2"),
}


class PayloadError(Exception):
    """A message's bytes do not fit its definition; says why."""


@dataclass(frozen=True)
class Leaf:
    """A number: its offset in the payload and its NumPy type."""

    offset: int
    code: str


_Wanted = list[tuple[int, tuple[Step, ...]]]
"""(number of the path, steps that are left)."""


@dataclass
class _Scope:
    """A message being walked: the names that it lists, the name that it has, what it lies in."""

    parent: _Scope | None
    labels: list[str] = field(default_factory=list)
    name: str | None = None


@dataclass(frozen=True)
class _Pending:
    """An element asked for by name, to be found when all names are known."""

    name: str
    scope: _Scope
    at: Callable[[int], _Found]

    def leaf(self) -> Leaf | None:
        """Find it by the nearest list of names that has its name."""
        scope: _Scope | None = self.scope
        while scope is not None:
            if self.name in scope.labels:
                found = self.at(scope.labels.index(self.name))
                return found.leaf() if isinstance(found, _Pending) else found
            scope = scope.parent
        return None


_Found = Leaf | _Pending | None


def _nth(found: list[_Found], index: int) -> _Found:
    return found[index] if index < len(found) else None


class Walker:
    """Walks one message once.

    Attributes:
        leaves: where each path leads to, None where this message has no such element.
        guards: (offset, bytes) of the lengths that were met.
        names: (offset, bytes) of the names that elements were looked up by.
        labels: these names.
        has_wide: whether a wide string was met.
    """

    def __init__(
        self,
        payload: memoryview,
        definitions: Definitions,
        paths: tuple[FieldPath, ...],
        *,
        ros1: bool,
        wide: int,
    ) -> None:
        self._payload = payload
        self._definitions = definitions
        self._paths = paths
        self._ros1 = ros1
        self._wide = wide
        self._named = any(isinstance(step, NamedElement) for path in paths for step in path.steps)
        self._order = "<"
        self._origin = 0
        self._widest = 8
        self._visited = 0
        self._position = 0
        self._pending: dict[int, _Found] = {}
        self._fixed: dict[str, bool] = {}
        self._budget = budget()
        self.leaves: list[Leaf | None] = [None] * len(paths)
        self.guards: list[tuple[int, bytes]] = []
        self.names: list[tuple[int, bytes]] = []
        self.labels: set[str] = set()
        self.has_wide = False

    def walk(self, name: str, padding: int) -> None:
        """Walk a message of a type, behind which at most `padding` bytes may stand.

        Raises:
            PayloadError: the bytes do not fit.
            DefinitionError: a nested type is not defined.
        """
        if not self._ros1:
            self._encapsulation()
        self._message(name, [(k, path.steps) for k, path in enumerate(self._paths)], None, 0)
        left = len(self._payload) - self._position
        if left > padding:
            raise PayloadError(f"it is {left} bytes longer than its type")
        for path, found in self._pending.items():
            self.leaves[path] = found.leaf() if isinstance(found, _Pending) else found

    def _encapsulation(self) -> None:
        head = bytes(self._payload[:4])
        kind = head[1] if len(head) == 4 and head[0] == 0 else -1
        if kind in _OTHERS:
            raise PayloadError(f"it is serialized as {_OTHERS[kind]}; only plain CDR is read")
        if kind not in (*_XCDR1, *_XCDR2):
            raise PayloadError(
                f"its first bytes are {head.hex() or 'missing'}, not those of plain CDR"
            )
        self._order = "<" if kind & 1 else ">"
        self._widest = 4 if kind in _XCDR2 else 8
        self._origin = self._position = 4
        self.guards.append((0, head))

    def _message(self, name: str, wanted: _Wanted, parent: _Scope | None, depth: int) -> _Scope:
        """Walk the fields of a message."""
        if depth > _DEEPEST:
            raise PayloadError(f"type '{name}' is nested deeper than {_DEEPEST} messages")
        scope = _Scope(parent)
        for title, kind in resolve(self._definitions, name):
            if self._named and lists_names(title) and _of_texts(kind):
                scope.labels = self._labels(kind)
                continue
            if self._named and title == "name" and kind == Text():
                scope.name = self._label()
                continue
            inner = [
                (path, steps[1:])
                for path, steps in wanted
                if isinstance(steps[0], Attribute)
                and (steps[0].name == title or ALIASES.get(steps[0].name) == title)
            ]
            self._value(kind, inner, scope, depth)
        return scope

    def _value(self, kind: Type, wanted: _Wanted, scope: _Scope, depth: int) -> None:
        match kind:
            case Primitive():
                self._align(kind.size)
                for path, _ in wanted:
                    self.leaves[path] = self._leaf(self._position, kind)
                self._skip(kind.size)
            case Text(wide):
                self.has_wide |= wide
                self._skip(self._length() * (self._wide if wide else 1))
            case Nested(name):
                self._message(name, wanted, scope, depth + 1)
            case Array(element, length):
                self._header(element)
                self._elements(element, length, wanted, scope, depth)
            case Sequence(element):
                self._header(element)
                self._elements(element, self._length(), wanted, scope, depth)

    def _header(self, element: Type) -> None:
        """Skip the size that XCDR2 writes before elements that are not numbers."""
        if self._widest == 4 and not isinstance(element, Primitive):
            self._length()

    def _elements(
        self,
        element: Primitive | Text | Nested,
        count: int,
        wanted: _Wanted,
        scope: _Scope,
        depth: int,
    ) -> None:
        if isinstance(element, Primitive):
            self._numbers(element, count, wanted, scope)
            return
        if isinstance(element, Nested) and self._is_fixed(element):
            last = max((s[0].index for _, s in wanted if isinstance(s[0], ArrayItem)), default=-1)
            if not any(isinstance(steps[0], NamedElement) for _, steps in wanted):
                walked = min(count, last + 1)
                self._each(element, walked, wanted, scope, depth)
                start = self._position - self._origin
                end = self._end_of_repeated(element, count - walked, start) + self._origin
                if end > len(self._payload):
                    raise self._too_many(count)
                self._position = end
                return
        self._each(element, count, wanted, scope, depth)

    def _each(
        self,
        element: Text | Nested,
        count: int,
        wanted: _Wanted,
        scope: _Scope,
        depth: int,
    ) -> None:
        """Walk elements one by one."""
        named = [(path, steps) for path, steps in wanted if isinstance(steps[0], NamedElement)]
        found: dict[int, list[_Found]] = {path: [] for path, _ in named}
        chosen: dict[int, _Found] = {}
        for index in range(self._bounded(count, 4 if isinstance(element, Text) else 0)):
            if not index % _TICK:
                self._budget.tick()
            inner = [(path, steps[1:]) for path, steps in wanted if steps[0] == ArrayItem(index)]
            inner += [(path, steps[1:]) for path, steps in named]
            if not isinstance(element, Nested):
                self._value(element, inner, scope, depth)
                continue
            own = self._message(element.name, inner, scope, depth + 1).name
            for path, steps in named:
                found[path].append(self._take_found(path))
                if own is not None and NamedElement(own) == steps[0]:
                    chosen.setdefault(path, found[path][-1])
        for path, steps in named:
            assert isinstance(steps[0], NamedElement)
            one = _Pending(steps[0].name, scope, partial(_nth, found[path]))
            self._pending[path] = chosen.get(path, one)

    def _is_fixed(self, kind: Type) -> bool:
        """Whether a type takes no more than its alignment and constant sizes, whatever it holds."""
        match kind:
            case Primitive():
                return True
            case Nested(name):
                known = self._fixed.get(name)
                if known is None:
                    self._fixed[name] = False  # a type inside of itself is none
                    inner = resolve(self._definitions, name)
                    known = self._fixed[name] = all(self._is_fixed(one) for _, one in inner)
                return known
            case Array(element):
                # XCDR2 writes a size before elements that are not numbers
                plain = isinstance(element, Primitive) or self._widest == 8
                return plain and self._is_fixed(element)
            case _:
                return False

    def _past(self, kind: Type, position: int) -> int:
        """Return where a value of a fixed type ends that begins at a position behind the origin."""
        match kind:
            case Primitive():
                return self._aligned(kind.size, position) + kind.size
            case Nested(name):
                for _, inner in resolve(self._definitions, name):
                    position = self._past(inner, position)
                return position
            case Array(element, length):
                return self._end_of_repeated(element, length, position)
            case _:
                raise PayloadError("a type of no fixed size")

    def _end_of_repeated(self, element: Type, count: int, position: int) -> int:
        """Return where so many values of a fixed type end; takes as long for a million as for ten.

        How far a value reaches depends on where it begins within eight bytes only, so that their
        lengths repeat.
        """
        seen: dict[int, tuple[int, int]] = {}
        done = 0
        while done < count:
            before = seen.get(position % 8)
            if before is not None:
                cycles = (count - done) // (done - before[0])
                position += cycles * (position - before[1])
                done += cycles * (done - before[0])
                for _ in range(done, count):
                    position = self._past(element, position)
                return position
            seen[position % 8] = done, position
            position = self._past(element, position)
            done += 1
        return position

    def _take_found(self, path: int) -> _Found:
        """Return what a path led to within an element, and forget it."""
        leaf, self.leaves[path] = self.leaves[path], None
        return self._pending.pop(path, leaf)

    def _numbers(self, element: Primitive, count: int, wanted: _Wanted, scope: _Scope) -> None:
        if count:
            self._align(element.size)
        start = self._position
        self._skip(count * element.size)

        def at(index: int) -> Leaf | None:
            place = start + index * element.size
            return self._leaf(place, element) if index < count else None

        for path, steps in wanted:
            match steps[0]:
                case ArrayItem(index):
                    self.leaves[path] = at(index)
                case NamedElement(name):
                    self._pending[path] = _Pending(name, scope, at)
                case _:
                    pass

    def _leaf(self, place: int, kind: Primitive) -> Leaf:
        return Leaf(place, ("" if kind.size == 1 else self._order) + kind.code)

    def _labels(self, kind: Type) -> list[str]:
        """Read an array of names; its bytes decide which element is which."""
        start = self._position
        self._header(Text())
        count = kind.length if isinstance(kind, Array) else self._length()
        labels = [self._text() for _ in range(self._bounded(count, 4))]
        self.names.append((start, bytes(self._payload[start : self._position])))
        return labels

    def _label(self) -> str:
        """Read the name of a message; its bytes decide whether it is the one."""
        start = self._position
        text = self._text()
        self.names.append((start, bytes(self._payload[start : self._position])))
        return text

    def _text(self) -> str:
        text = self._take(self._length()).rstrip(b"\0").decode("utf-8", "replace")
        self.labels.add(text)
        return text

    def _bounded(self, count: int, least: int) -> int:
        """Return a number of elements that can be true: no loop is longer than the message."""
        self._visited += count
        room = len(self._payload) - self._position
        if count * max(least, 1) > room or self._visited > _MOST_ELEMENTS:
            raise self._too_many(count)
        return count

    def _too_many(self, count: int) -> PayloadError:
        room = len(self._payload) - self._position
        return PayloadError(f"an array claims {count} elements in {room} bytes")

    def _align(self, size: int) -> None:
        self._position = self._origin + self._aligned(size, self._position - self._origin)

    def _aligned(self, size: int, position: int) -> int:
        """Return where a number of so many bytes begins that may not begin before a position."""
        return position if self._ros1 else position + -position % min(size, self._widest)

    def _length(self) -> int:
        self._align(4)
        start = self._position
        raw = self._take(4)
        self.guards.append((start, raw))
        return int(struct.unpack(self._order + "I", raw)[0])

    def _take(self, size: int) -> bytes:
        start = self._position
        self._skip(size)
        return bytes(self._payload[start : start + size])

    def _skip(self, size: int) -> None:
        self._position += size
        if self._position > len(self._payload):
            raise PayloadError(f"it ends after {len(self._payload)} bytes, too early for its type")


def _of_texts(kind: Type) -> bool:
    return isinstance(kind, (Array, Sequence)) and kind.element == Text()
