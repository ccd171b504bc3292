"""Where the wanted numbers stand in a serialized ROS message, and which others have that layout."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from eha_bench.recordings.encodings.definitions import Definitions
from eha_bench.recordings.encodings.field_path import FieldPath
from eha_bench.recordings.encodings.ros_walker import Leaf, PayloadError, Walker

_WIDE = (2, 4, 1)
"""Bytes that a wide string takes by count: by the book, as Fast CDR 1 has it, counted in bytes."""
_PADDING = 3
"""Bytes that may stand behind the last field of a CDR message."""


@dataclass(frozen=True)
class MessageLayout:
    """Where the numbers stand in every message that has the same size and the same `guards`.

    Attributes:
        leaves: one a path, None where this message has no such element.
        guards: (offset, bytes) that decide where everything stands: lengths, and looked-up names.
        names: the names of elements that were met, where some are asked for by name.
    """

    leaves: tuple[Leaf | None, ...]
    guards: tuple[tuple[int, bytes], ...]
    names: frozenset[str] = frozenset()

    @cached_property
    def words(self) -> tuple[tuple[int, str, int], ...]:
        """The guards as numbers to compare: (offset, NumPy type, value)."""
        return tuple(
            (offset + start, f"<u{width}", int.from_bytes(raw[start : start + width], "little"))
            for offset, raw in self.guards
            for start, width in _widths(len(raw))
        )


def layout_of(
    payload: memoryview,
    definitions: Definitions,
    name: str,
    paths: tuple[FieldPath, ...],
    *,
    ros1: bool,
) -> MessageLayout:
    """Walk one message and return where `paths` stand in it.

    Raises:
        PayloadError: the bytes end too early or too late, a length is impossible, or the encoding
            is another.
        DefinitionError: a nested type is not defined.
    """
    walker = _walk(payload, definitions, name, paths, ros1)
    leaves = tuple(walker.leaves)
    # what stands behind the last wanted number does not matter, unless a number was not there
    last = max((leaf.offset for leaf in leaves if leaf), default=0)
    lengths = [guard for guard in walker.guards if guard[0] < last or None in leaves]
    return MessageLayout(leaves, (*lengths, *walker.names), frozenset(walker.labels))


def _walk(
    payload: memoryview,
    definitions: Definitions,
    name: str,
    paths: tuple[FieldPath, ...],
    ros1: bool,
) -> Walker:
    """Walk a message; writers differ in wide strings, but it must end where its data end."""
    first: PayloadError | None = None
    for wide in _WIDE:
        walker = Walker(payload, definitions, paths, ros1=ros1, wide=wide)
        try:
            walker.walk(name, 0 if ros1 else _PADDING)
        except PayloadError as error:
            if not walker.has_wide:
                raise
            first = first or error
            continue
        return walker
    raise first or PayloadError("it is empty")


def _widths(size: int) -> list[tuple[int, int]]:
    """Return how to cut `size` bytes into words: (start, width)."""
    words = []
    start = 0
    while start < size:
        width = next(width for width in (8, 4, 2, 1) if width <= size - start)
        words.append((start, width))
        start += width
    return words
