"""The pages of a Parquet column, by their own headers: how many values they hold, and their size.

A library takes memory by what a page's header says, not by what the index at the file's end says of
the whole column. Both are compared before a column is read. A header is a `PageHeader` of the
format (https://github.com/apache/parquet-format), in Thrift's compact protocol
(https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md).
"""

from __future__ import annotations

import mmap
from dataclasses import dataclass
from typing import Final, TypeAlias, Union

from eha_bench.recordings.budget import budget

_UNCOMPRESSED: Final = 2
_COMPRESSED: Final = 3
_DATA: Final = (5, 8)
"""Fields of a page's header: its sizes, and what heads a data page of version 1 or 2."""
_COUNT: Final = 1
_BINARY: Final = 8
_LISTS: Final = (9, 10)
_MAP: Final = 11
_STRUCT: Final = 12
_INTEGERS: Final = (4, 5, 6)
_WIDTHS: Final = {1: 0, 2: 0, 3: 1, 7: 8}
"""Bytes of values of one size: booleans in a struct, a byte, a double."""
_DEEPEST: Final = 8
_LONGEST: Final = 10
"""Bytes of a number."""


class MissingPage(ValueError):
    """There is no page where one has to be."""


@dataclass(frozen=True)
class Pages:
    """What the pages of a column hold.

    Attributes:
        values: how many, nulls too.
        size: bytes of all pages once decompressed.
    """

    values: int
    size: int


def pages_of(content: mmap.mmap | bytes, start: int, end: int) -> Pages:
    """Return what the pages that begin from `start` to `end` of a file hold.

    Raises:
        MissingPage: something else lies there, or a page reaches beyond the file.
    """
    view = memoryview(content)
    found = size = 0
    place = start
    while place < end:
        budget().tick()
        header = _Reader(view, place)
        fields = header.struct(0)
        packed, whole = fields.get(_COMPRESSED), fields.get(_UNCOMPRESSED)
        if not isinstance(packed, int) or not isinstance(whole, int) or min(packed, whole) < 0:
            raise MissingPage("a page has no size")
        place = header.place + packed
        if place > len(view):
            raise MissingPage("a page reaches beyond the file")
        size += whole
        for key in _DATA:
            head = fields.get(key)
            count = head.get(_COUNT) if isinstance(head, dict) else 0
            if not isinstance(count, int) or count < 0:
                raise MissingPage("a page has no count")
            found += count
    return Pages(found, size)


_Fields: TypeAlias = dict[int, Union[int, "_Fields"]]


class _Reader:
    """Reads structs at a place; only their integers and structs are kept."""

    def __init__(self, view: memoryview, place: int) -> None:
        self._view = view
        self.place = place

    def struct(self, depth: int) -> _Fields:
        """Return the fields of a struct by their numbers."""
        if depth > _DEEPEST:
            raise MissingPage("a header is nested too deeply")
        fields: _Fields = {}
        number = 0
        while head := self._byte():
            kind, step = head & 0x0F, head >> 4
            number = number + step if step else self._signed()
            match kind:
                case kind if kind in _INTEGERS:
                    fields[number] = self._signed()
                case kind if kind == _STRUCT:
                    fields[number] = self.struct(depth + 1)
                case _:
                    self._skip(kind, depth)
        return fields

    def _skip(self, kind: int, depth: int) -> None:
        if kind in _WIDTHS:
            self._pass(_WIDTHS[kind])
        elif kind in _INTEGERS:
            self._unsigned()
        elif kind == _BINARY:
            self._pass(self._unsigned())
        elif kind == _STRUCT:
            self.struct(depth + 1)
        elif kind in _LISTS:
            head = self._byte()
            count = head >> 4
            self._elements(count if count < 15 else self._unsigned(), (head & 0x0F,), depth)
        elif kind == _MAP:
            count = self._unsigned()
            kinds = self._byte() if count else 0
            self._elements(count, (kinds >> 4, kinds & 0x0F), depth)
        else:
            raise MissingPage("a header is damaged")

    def _elements(self, count: int, kinds: tuple[int, ...], depth: int) -> None:
        if depth > _DEEPEST or count > len(self._view) - self.place:
            raise MissingPage("a header is damaged")
        for _ in range(count):
            budget().tick()
            for kind in kinds:
                # a boolean in a list takes a byte, in a struct none
                self._pass(1) if kind in (1, 2) else self._skip(kind, depth + 1)

    def _byte(self) -> int:
        if not 0 <= self.place < len(self._view):
            raise MissingPage("a page lies beyond the file")
        self.place += 1
        return self._view[self.place - 1]

    def _pass(self, count: int) -> None:
        self.place += count
        if self.place > len(self._view):
            raise MissingPage("a header reaches beyond the file")

    def _unsigned(self) -> int:
        value = 0
        for shift in range(_LONGEST):
            byte = self._byte()
            value |= (byte & 0x7F) << 7 * shift
            if byte < 0x80:
                return value
        raise MissingPage("a header is damaged")

    def _signed(self) -> int:
        value = self._unsigned()
        return value >> 1 ^ -(value & 1)
