"""How objects show themselves in a notebook: a heading and a table, everything escaped."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import Final

MOST_ROWS: Final = 20


def html_table(title: str, headings: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a heading and a table as HTML; of many rows the first, and how many more there are."""
    listed = list(rows)
    head = "".join(f"<th>{escape(name)}</th>" for name in headings)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(_text(cell))}</td>" for cell in row) + "</tr>"
        for row in listed[:MOST_ROWS]
    )
    left = len(listed) - MOST_ROWS
    more = f"<p>... and {left} more</p>" if left > 0 else ""
    return (
        f"<p><b>{escape(title)}</b></p><table><thead><tr>{head}</tr></thead>"
        f"<tbody>{body}</tbody></table>{more}"
    )


def _text(cell: object) -> str:
    if isinstance(cell, float):
        return f"{cell:.6g}" if math.isfinite(cell) else ""
    return str(cell)
