"""Checks the sizes that a MAT v5 file declares, before SciPy takes memory for them.

Format: MathWorks, MAT-File Format, R2023a, chapter 1 (Level 5).
"""

from __future__ import annotations

import struct
import zlib

from eha_bench.recordings.decompress import LARGEST

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_CONTAINERS = {1, 2, 3, 16, 17}  # cell, struct, object, function handle, opaque
_DEEPEST = 32
_RATIO = 1100  # no deflate stream grows by more than 1032


class ImpossibleSize(Exception):
    """A MAT file declares more than it holds; says what."""


def check_sizes(content: memoryview) -> None:
    """Check a MAT v5 file.

    Raises:
        ImpossibleSize: an element is longer than what holds it, or it is not of version 5.
    """
    version = bytes(content[124:128])
    # SciPy takes a file for v4, which has no such checks, if one of its first bytes is zero
    if version not in {b"\x00\x01IM", b"\x01\x00MI"} or 0 in bytes(content[:4]):
        raise ImpossibleSize("its header is not that of MAT v5")
    order = "<" if bytes(content[126:128]) == b"IM" else ">"
    _check(content[_HEADER:], order, 0)


def _check(data: memoryview, order: str, depth: int) -> None:
    if depth > _DEEPEST:
        raise ImpossibleSize(f"its arrays are nested deeper than {_DEEPEST}")
    position = 0
    while position + 8 <= len(data):
        kind, start, size = _tag(data, position, order)
        if start + size > len(data):
            raise ImpossibleSize(
                f"an array declares {size} bytes where {len(data) - start} are left"
            )
        inside = data[start : start + size]
        if kind == _COMPRESSED:
            _check(_inflated(inside), order, depth + 1)
        elif kind == _MATRIX:
            _matrix(inside, order, depth)
        position = start + size
        if kind != _COMPRESSED:
            position += -position % 8


def _tag(data: memoryview, position: int, order: str) -> tuple[int, int, int]:
    """Return an element's type, where its data start, and their size."""
    kind, size = struct.unpack_from(order + "II", data, position)
    if kind >> 16:  # a small element holds its size and data in the tag itself
        return kind & 0xFFFF, position + 4, min(kind >> 16, 4)
    return kind, position + 8, size


def _matrix(data: memoryview, order: str, depth: int) -> None:
    """Check an array: its flags, its dimensions, and what it holds."""
    if len(data) < 16:
        return
    _, flags, size = _tag(data, 0, order)
    kind = struct.unpack_from(order + "I", data, flags)[0] & 0xFF if size >= 4 else 0
    position = flags + size + -(flags + size) % 8
    if position + 8 > len(data):
        return
    _, start, size = _tag(data, position, order)
    if start + size > len(data):
        raise ImpossibleSize("the dimensions of an array are cut off")
    count = 1
    for dimension in struct.unpack_from(f"{order}{size // 4}I", data, start):
        count *= dimension
    # every element of a container takes at least a tag, every number at least a byte
    if count * (8 if kind in _CONTAINERS else 1) > max(len(data), 1) and kind != 5:
        raise ImpossibleSize(f"an array declares {count} elements in {len(data)} bytes")
    _check(data[start + size + -(start + size) % 8 :], order, depth + 1)


def _inflated(data: memoryview) -> memoryview:
    stream = zlib.decompressobj()
    limit = min(len(data) * _RATIO + 1024, LARGEST)
    try:
        content = stream.decompress(data, limit)
    except zlib.error as error:
        raise ImpossibleSize(f"an array cannot be decompressed ({error})") from error
    if stream.unconsumed_tail:
        raise ImpossibleSize(f"an array decompresses to more than {limit} bytes")
    return memoryview(content)
