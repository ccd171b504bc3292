"""A matplotlib figure that is drawn on directly, without axes.

A run has up to nine panels, and matplotlib takes 40 ms for a pair of axes, nearly all of it for
ticks: without them a whole run takes no more.

Positions are points (1/72 inch) from the upper left corner; a colour is the name of a shade of
`embed_svg.SHADES`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle
from matplotlib.text import Text
from matplotlib.transforms import IdentityTransform

from eha_bench.core.arrays import FloatArray
from eha_bench.report.embed_svg import SHADES
from eha_bench.report.figures import render_svg

_THIN = 0.6


class Drawing:
    """Collects artists on a figure; what is drawn later lies above. Use within `plot_style`."""

    def __init__(self, width: float, height: float) -> None:
        self.height = height
        self._figure = Figure(figsize=(width / 72.0, height / 72.0), dpi=72)
        self._place = IdentityTransform()  # at 72 dpi a dot is a point

    def curve(
        self, points: FloatArray, shade: str, *, width: float, dash: Sequence[float] = ()
    ) -> None:
        """Draw lines through `points` (n, 2); where one is not finite there is a gap."""
        line = Line2D(
            points[:, 0], self.height - points[:, 1],
            color=SHADES[shade], linewidth=width, transform=self._place,
            linestyle=(0.0, tuple(dash)) if dash else None,
        )  # fmt: skip
        self._figure.add_artist(line)

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
        """Draw thin lines (x1, y1, x2, y2): a grid, or the marks of an axis."""
        gap = (np.nan, np.nan)
        places = [place for x1, y1, x2, y2 in lines for place in ((x1, y1), (x2, y2), gap)]
        # one path for all of them: a LineCollection would write an element a line
        self.curve(np.array(places).reshape(-1, 2), shade, width=_THIN)

    def rectangle(
        self, left: float, top: float, right: float, bottom: float, shade: str, *, opacity: float
    ) -> None:
        """Fill a rectangle."""
        patch = Rectangle(
            (left, self.height - bottom), right - left, bottom - top,
            facecolor=SHADES[shade], alpha=opacity, linewidth=0, transform=self._place,
        )  # fmt: skip
        self._figure.add_artist(patch)

    def ring(self, x: float, y: float, radius: float, shade: str) -> None:
        """Draw a circle filled with the colour of the paper."""
        patch = Circle(
            (x, self.height - y), radius, facecolor=SHADES["paper"], edgecolor=SHADES[shade],
            linewidth=1.2, transform=self._place,
        )  # fmt: skip
        self._figure.add_artist(patch)

    def text(
        self,
        words: str,
        x: float,
        y: float,
        shade: str,
        *,
        size: float,
        anchor: Literal["left", "center", "right"] = "left",
        bold: bool = False,
    ) -> None:
        """Write words on the base line `y`; `anchor` is left, center or right."""
        weight = "bold" if bold else "normal"
        text = Text(
            x, self.height - y, words, color=SHADES[shade], fontsize=size, fontweight=weight,
            horizontalalignment=anchor, verticalalignment="baseline", transform=self._place,
        )  # fmt: skip
        self._figure.add_artist(text)

    def svg(self, key: str, *, title: str) -> Markup:
        """Return the drawing as an element; `key` is unique on its page, `title` is read aloud."""
        return render_svg(self._figure, key, title=title)
