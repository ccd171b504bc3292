"""Reads the numeric arrays of a MAT v5 file, whatever may be wrong with it.

SciPy's reader crashes the process on some damaged files, so that its errors cannot be caught.
Format: MathWorks, MAT-File Format, R2023a, chapter 1 (Level 5).
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eha_bench.recordings.budget import budget

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_STORED = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"
}  # fmt: skip
_CELL, _STRUCT, _OBJECT, _TEXT, _SPARSE = 1, 2, 3, 4, 5
_NUMBERS = {
    6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"
}  # fmt: skip
_COMPLEX, _LOGICAL = 0x0800, 0x0200
_KINDS = {_TEXT: "text", _SPARSE: "a sparse array"}
_DEEPEST = 32
_MOST = 10_000
"""No file is expected to hold more arrays than these."""
_RATIO = 1100  # no deflate stream grows by more than 1032


class DamagedMat(Exception):
    """A MAT file is not what it says; says why."""


@dataclass
class MatArrays:
    """The arrays of a file.

    Attributes:
        numbers: name -> real array of one or two dimensions, those of length 1 left out.
        others: name -> what it holds instead.
        damage: why the rest of the file cannot be read, empty if all was read.
    """

    numbers: dict[str, NDArray[Any]] = field(default_factory=dict)
    others: dict[str, str] = field(default_factory=dict)
    damage: str = ""


def read_mat5(content: memoryview) -> MatArrays:
    """Return all arrays up to the first that is damaged; fields and cells get their own names.

    Raises:
        DamagedMat: it is not a MAT file of version 5.
    """
    mark = bytes(content[124:128])
    if mark not in {b"\x00\x01IM", b"\x01\x00MI"}:
        raise DamagedMat("its header is not that of MAT v5")
    reader = _ArrayReader("<" if mark.endswith(b"IM") else ">")
    try:
        for kind, data in reader.elements(content[_HEADER:], padded=False):
            if kind == _COMPRESSED:
                for inner, unpacked in reader.elements(_inflated(data)):
                    reader.variable(inner, unpacked)
            else:
                reader.variable(kind, data)
    except (DamagedMat, struct.error, ValueError) as error:
        reader.found.damage = str(error)
    return reader.found


class _ArrayReader:
    """Walks the elements of a file and keeps the arrays."""

    def __init__(self, order: str) -> None:
        self._order = order
        self.found = MatArrays()

    def elements(
        self, data: memoryview, *, padded: bool = True
    ) -> Iterator[tuple[int, memoryview]]:
        """Yield (type, content) of elements that lie one behind the other."""
        position = 0
        while position + 8 <= len(data):
            kind, size = struct.unpack_from(self._order + "II", data, position)
            start = position + 8
            if kind >> 16:  # a small element holds its size and content in the tag itself
                start, size, kind = position + 4, min(kind >> 16, 4), kind & 0xFFFF
            if start + size > len(data):
                raise DamagedMat(
                    f"an array declares {size} bytes where {len(data) - start} are left"
                )
            yield kind, data[start : start + size]
            position = max(start + size, position + 8)
            if padded or kind != _COMPRESSED:
                position += -position % 8

    def variable(self, kind: int, data: memoryview) -> None:
        """Keep a variable of the file."""
        if kind != _MATRIX:
            raise DamagedMat(f"data of type {kind} where an array is expected")
        self._array("", data, 0)

    def _array(self, name: str, data: memoryview, depth: int) -> None:
        """Keep an array; one without a name goes by its own."""
        if not data:
            self.found.others[name] = "an empty array"  # an empty cell may be no bytes at all
            return
        if depth > _DEEPEST:
            raise DamagedMat(f"its arrays are nested deeper than {_DEEPEST}")
        parts = self.elements(data)
        flags, shape, own = (self._next(parts) for _ in range(3))
        word = struct.unpack_from(self._order + "I", flags[1])[0]
        kind = word & 0xFF
        name = name or bytes(own[1]).decode("latin-1")
        if not name or len(self.found.numbers) + len(self.found.others) > _MOST:
            return  # a function's workspace has no name
        if name in self.found.numbers or name in self.found.others:
            raise DamagedMat(f"'{name}' occurs in it twice")
        if kind == 17:  # an object of a class: it has no shape
            self.found.others[name] = "an object"
            return
        sizes = self._numbers(shape)
        if sizes.dtype.kind not in "iu":
            raise DamagedMat(f"'{name}' has a shape that is not made of whole numbers")
        dimensions = sizes.tolist()
        count = math.prod(dimensions)
        if min(dimensions, default=0) < 0 or count > 8 * len(data):
            raise DamagedMat(f"'{name}' declares {count} elements in {len(data)} bytes")
        if kind in _NUMBERS:
            self._numeric(name, word, dimensions, self._next(parts) if count else (1, data[:0]))
        elif kind == _CELL:
            for place in range(count):
                self._inner(f"{name}[{place}]", self._next(parts), depth)
        elif kind in (_STRUCT, _OBJECT):
            self._struct(name, kind, count, parts, depth)
        else:
            self.found.others[name] = _KINDS.get(kind, "an object")

    def _struct(
        self, name: str, kind: int, count: int, parts: Iterator[tuple[int, memoryview]], depth: int
    ) -> None:
        if kind == _OBJECT:
            self._next(parts)  # the name of its class
        width = int(self._numbers(self._next(parts)).sum())
        names = bytes(self._next(parts)[1])
        if width <= 0:
            raise DamagedMat(f"the fields of '{name}' have no names")
        fields = [
            names[start : start + width].split(b"\0")[0].decode("latin-1")
            for start in range(0, len(names), width)
        ]
        for place in range(count if fields else 0):
            owner = name if count == 1 else f"{name}[{place}]"
            for title in fields:
                self._inner(f"{owner}.{title}", self._next(parts), depth)

    def _inner(self, name: str, element: tuple[int, memoryview], depth: int) -> None:
        kind, data = element
        if kind != _MATRIX:
            raise DamagedMat(f"data of type {kind} where '{name}' is expected")
        self._array(name, data, depth + 1)

    def _numeric(
        self, name: str, word: int, dimensions: list[int], element: tuple[int, memoryview]
    ) -> None:
        values = self._numbers(element)
        if values.size != math.prod(dimensions):
            raise DamagedMat(f"'{name}' holds {values.size} numbers, not {dimensions}")
        array = values.astype(_NUMBERS[word & 0xFF]).reshape(dimensions, order="F").squeeze()
        if word & _COMPLEX:
            self.found.others[name] = "complex numbers"
        elif array.ndim == 0 or not array.size:
            self.found.others[name] = "a single value" if array.size else "an empty array"
        elif array.ndim > 2:
            self.found.others[name] = f"an array of {array.ndim} dimensions"
        else:
            self.found.numbers[name] = array.astype(np.float64) if word & _LOGICAL else array

    def _numbers(self, element: tuple[int, memoryview]) -> NDArray[Any]:
        kind, data = element
        if kind not in _STORED:
            raise DamagedMat(f"data of type {kind} where numbers are expected")
        return np.frombuffer(data, self._order + _STORED[kind])

    @staticmethod
    def _next(parts: Iterator[tuple[int, memoryview]]) -> tuple[int, memoryview]:
        found = next(parts, None)
        if found is None:
            raise DamagedMat("an array ends too early")
        return found


def _inflated(data: memoryview) -> memoryview:
    stream = zlib.decompressobj()
    limit = min(len(data) * _RATIO + 1024, budget().memory)
    try:
        content = stream.decompress(data, limit)
    except zlib.error as error:
        raise DamagedMat(f"an array cannot be decompressed ({error})") from error
    if stream.unconsumed_tail:
        raise DamagedMat(f"an array decompresses to more than {limit} bytes")
    return memoryview(content)
