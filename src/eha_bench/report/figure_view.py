"""A plot as a page embeds it: static for every reader, with the data of its charts."""

from __future__ import annotations

from dataclasses import dataclass, replace

from markupsafe import Markup

from eha_bench.report.charts import ChartData, chart_data
from eha_bench.report.scene import Scene
from eha_bench.report.scene_figure import POINTS, scene_svg


@dataclass(frozen=True)
class FigureView:
    """What the macro `plot` of `parts/figure.html.j2` shows.

    Attributes:
        key: unique on its page.
        svg: the static plot.
        data: of the charts that take its place where scripts run; None for a static plot only.
    """

    key: str
    svg: Markup
    data: ChartData | None = None


def figure_of(
    scene: Scene, *, key: str, title: str, points: int = POINTS, static_panels: int | None = None
) -> FigureView:
    """Draw a scene and pack its curves.

    Args:
        scene: of at least one panel.
        key: unique on its page; letters, digits and dashes.
        title: what a screen reader says.
        points: kept of each static curve, about.
        static_panels: how many panels, from the top, are drawn for readers without scripts.
    """
    telling = tuple(panel for panel in scene.panels if not panel.quiet) or scene.panels
    drawn = replace(scene, panels=telling[:static_panels])
    svg = scene_svg(drawn, key=key, title=title, points=points)
    return FigureView(key, svg, chart_data(scene))
