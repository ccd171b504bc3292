"""Drawings as inline `<svg>`, written directly: small, quick, in the page's colours.

Positions are points (1/72 inch) from the upper left corner. A colour is the name of a shade of
`embed_svg.SHADES`; in the page it is the variable `--<name>`, so that one drawing serves light,
dark and paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Canvas:
    """Collects the elements of a drawing; what is drawn later lies above."""

    def __init__(self, width: float, height: float) -> None:
        self.width = width
        self.height = height
        self._elements: list[str] = []

    def curve(
        self, points: FloatArray, shade: str, *, width: float, dash: Sequence[float] = ()
    ) -> None:
        """Draw lines through `points` (n, 2); where one is not finite there is a gap."""
        path = path_through(points)
        if path:
            self._add("path", _stroke(shade, width, dash) + f' fill="none" d="{path}"')

    def line(
        self,
        start: tuple[float, float],
        stop: tuple[float, float],
        shade: str,
        *,
        width: float = 1.0,
        dash: Sequence[float] = (),
    ) -> None:
        """Draw one straight line."""
        self.curve(np.array([start, stop]), shade, width=width, dash=dash)

    def ruling(self, lines: Sequence[tuple[float, float, float, float]], shade: str) -> None:
        """Draw thin lines (x1, y1, x2, y2) as one element: a grid, or the marks of an axis."""
        path = "".join(
            f"M{_short(x1)} {_short(y1)}L{_short(x2)} {_short(y2)}" for x1, y1, x2, y2 in lines
        )
        if path:
            self._add("path", _stroke(shade, 0.6, ()) + f' fill="none" d="{path}"')

    def rectangle(
        self, left: float, top: float, right: float, bottom: float, shade: str, *, opacity: float
    ) -> None:
        """Fill a rectangle."""
        self._add(
            "rect",
            f' x="{_short(left)}" y="{_short(top)}" width="{_short(max(right - left, 0.0))}"'
            f' height="{_short(max(bottom - top, 0.0))}" fill="var(--{shade})"'
            f' fill-opacity="{opacity:g}"',
        )

    def ring(self, x: float, y: float, radius: float, shade: str) -> None:
        """Draw a circle filled with the colour of the paper."""
        self._add(
            "circle",
            f' cx="{_short(x)}" cy="{_short(y)}" r="{radius:g}" fill="var(--paper)"'
            + _stroke(shade, 1.2, ()),
        )

    def text(
        self,
        words: str,
        x: float,
        y: float,
        shade: str,
        *,
        size: float,
        anchor: str = "start",
        bold: bool = False,
    ) -> None:
        """Write words on the base line `y`; `anchor` is start, middle or end."""
        more = "" if anchor == "start" else f' text-anchor="{anchor}"'
        more += ' font-weight="bold"' if bold else ""
        self._elements.append(
            f'<text x="{_short(x)}" y="{_short(y)}" font-size="{size:g}" '
            f'fill="var(--{shade})"{more}>{escape(words)}</text>'
        )

    def svg(self, key: str, *, title: str) -> Markup:
        """Return the drawing as an element; `key` is unique on its page, `title` is read aloud."""
        return Markup(
            f'<svg viewBox="0 0 {_short(self.width)} {_short(self.height)}" role="img" '
            f'aria-labelledby="{key}-title"><title id="{key}-title">{escape(title)}</title>'
            + "".join(self._elements)
            + "</svg>"
        )

    def _add(self, tag: str, attributes: str) -> None:
        self._elements.append(f"<{tag}{attributes}/>")


def path_through(points: FloatArray) -> str:
    """Return the path data of lines through points (n, 2), in tenths of a point.

    Each point is relative to the last, which is shorter, and all are rounded before the
    difference is taken, so that no rounding adds up. Points that fall on the last one are left out.
    """
    finite: NDArray[np.bool_] = np.logical_and(*np.isfinite(points).T)
    tenths = np.zeros(points.shape, dtype=np.int64)
    tenths[finite] = np.rint(points[finite] * 10.0).astype(np.int64)
    steps = np.diff(tenths, axis=0, prepend=tenths[:1])
    starts = finite.copy()
    starts[1:] &= ~finite[:-1]
    drawn = finite & (starts | np.any(steps != 0, axis=1))
    parts: list[str] = []
    for index in np.flatnonzero(drawn).tolist():
        if starts[index]:
            x, y = tenths[index].tolist()
            parts.append(f"M{_tenths(x)} {_tenths(y)}")
        else:
            x, y = steps[index].tolist()
            parts.append(f"l{_tenths(x)}{_tenths(y)}" if y < 0 else f"l{_tenths(x)} {_tenths(y)}")
    return "".join(parts)


def _stroke(shade: str, width: float, dash: Sequence[float]) -> str:
    dashes = f' stroke-dasharray="{" ".join(f"{d:g}" for d in dash)}"' if dash else ""
    return f' stroke="var(--{shade})" stroke-width="{width:g}"{dashes}'


def _short(value: float) -> str:
    return _tenths(round(value * 10.0))


@lru_cache(maxsize=65536)
def _tenths(value: int) -> str:
    whole, tenth = divmod(abs(value), 10)
    text = f"{whole or ''}.{tenth}" if tenth else f"{whole}"
    return f"-{text}" if value < 0 else text
