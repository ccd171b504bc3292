"""The reports' plot style, and matplotlib's figures as SVG that stands inside a page."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import matplotlib as mpl
from markupsafe import Markup
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from eha_bench.report.embed_svg import SHADES, embed_svg

_STYLE: Final[Any] = {
    "svg.fonttype": "none",
    "text.parse_math": False,
    "axes.unicode_minus": True,
    "axes.formatter.use_mathtext": False,
    "axes.formatter.useoffset": False,
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 5.0,
    "axes.edgecolor": SHADES["axis"],
    "axes.labelcolor": SHADES["muted"],
    "axes.titlecolor": SHADES["text"],
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": SHADES["grid"],
    "grid.linewidth": 0.6,
    "xtick.color": SHADES["axis"],
    "ytick.color": SHADES["axis"],
    "xtick.labelcolor": SHADES["muted"],
    "ytick.labelcolor": SHADES["muted"],
    "xtick.major.size": 3.0,
    "ytick.left": False,
    "lines.linewidth": 1.3,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "legend.labelcolor": SHADES["muted"],
    "path.simplify": False,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
}


@contextmanager
def plot_style() -> Iterator[None]:
    """Draw in the reports' style; text is taken as it is, never as mathematics."""
    with mpl.rc_context(_STYLE), warnings.catch_warnings():
        # The browser has the glyphs that matplotlib's font lacks.
        warnings.filterwarnings("ignore", message=r"Glyph .* missing from font")
        yield


def render_svg(figure: Figure, key: str, *, title: str) -> Markup:
    """Return a figure as an inline `<svg>`: its ids begin with `key`, equal input gives equal text.

    Args:
        figure: drawn within `plot_style`, in colours of `SHADES`.
        key: unique on its page; letters, digits and dashes.
        title: what a screen reader says.
    """
    FigureCanvasSVG(figure)
    for patch in (figure.patch, *(axes.patch for axes in figure.axes)):
        patch.set_visible(False)
    buffer = io.StringIO()
    nothing = {"Date": None, "Creator": None, "Format": None, "Type": None}
    with mpl.rc_context({"svg.hashsalt": key}):
        figure.savefig(buffer, format="svg", metadata=nothing)
    return embed_svg(buffer.getvalue(), key, title=title)
