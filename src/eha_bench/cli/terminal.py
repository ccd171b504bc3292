"""Colour and columns for people at a terminal; plain text in a pipe, a file or under NO_COLOR."""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Sequence
from enum import Enum
from typing import TextIO

_NARROWEST = 20
"""Characters of a column below which its cells are not wrapped."""


class Paint(Enum):
    """What a piece of text means, and the terminal's code for it."""

    GOOD = "32"
    BAD = "31"
    WARN = "33"
    UNSURE = "35"
    QUIET = "2"


def shows_colour(stream: TextIO | None = None) -> bool:
    """Whether a stream (standard error by default) shows colour."""
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR"):
        return True
    return (stream or sys.stderr).isatty() and os.environ.get("TERM", "") != "dumb"


def paint(text: str, colour: Paint, *, on: bool) -> str:
    """Return text in a colour where colour is shown."""
    return f"\x1b[{colour.value}m{text}\x1b[0m" if on and text else text


def columns(rows: Sequence[Sequence[str]], *, right: Sequence[int] = ()) -> list[list[str]]:
    """Return the cells padded to their column's width, those of `right` to the right edge.

    The last column is left as it is, so that no line ends in spaces.
    """
    if not rows:
        return []
    widths = [max(len(row[place]) for row in rows) for place in range(len(rows[0]))]
    return [
        [
            cell.rjust(width) if place in right
            else cell if place == len(row) - 1 else cell.ljust(width)
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        for row in rows
    ]  # fmt: skip


def fitted_rows(rows: Sequence[Sequence[str]], width: int) -> list[list[str]]:
    """Return rows of three cells as lines that fit a width: long cells go on in their column."""
    natural = [max(len(row[place]) for row in rows) for place in range(3)]
    rest = width - natural[0] - 4
    second = min(natural[1], max(2 * rest // 5, rest - natural[2]))
    third = rest - second
    if second + third < 2 * _NARROWEST:
        return columns(rows)
    lines = []
    for name, about, text in rows:
        parts = [textwrap.wrap(about, second) or [""], textwrap.wrap(text, third) or [""]]
        for place in range(max(map(len, parts))):
            cells = [part[place] if place < len(part) else "" for part in parts]
            lines.append(["" if place else name, *cells])
    return columns(lines)


def more(count: int) -> str:
    """Return the line that stands for what is not shown."""
    return f"  ... and {count} more: --verbose shows all"
