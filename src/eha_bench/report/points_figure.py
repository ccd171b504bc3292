"""Operating points as measured, with their uncertainty, and what two models make of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from eha_bench.diagnosis.replay.replay import Replay
from eha_bench.plants.model import Model
from eha_bench.plants.static_plant import StaticPlant
from eha_bench.report.embed_svg import SHADES
from eha_bench.report.engineering import channel_name, display_unit
from eha_bench.report.figure_view import FigureView
from eha_bench.report.figures import plot_style, render_svg

_WIDTH: Final = 662.0 / 72.0
_DRAWN: Final = 100


def points_view(
    replays: Sequence[Replay],
    plant: StaticPlant,
    models: tuple[Model, ...],
    floors: dict[str, float],
    *,
    key: str,
) -> FigureView:
    """Draw the first output of a static plant against its first input.

    Args:
        replays: runs with their points. plant: of the models.
        models: recalibrated, and revised where that differs. floors: channel -> uncertainty, SI.
        key: unique on its page.
    """
    across, along = plant.inputs[0], plant.outputs[0]
    x = np.concatenate([item.inputs[across] for item in replays])
    y = np.concatenate([item.measured[along] for item in replays])
    x_unit = display_unit(plant.units[across], x.tolist())
    y_unit = display_unit(plant.units[along], y.tolist())
    with plot_style():
        figure = Figure(figsize=(_WIDTH, 3.4), layout="constrained")
        axes = figure.subplots()
        names = ("recalibrated", "revised")
        for model, shade, label in zip(models, ("vermilion", "blue"), names, strict=False):
            inputs = {name: np.concatenate([item.inputs[name] for item in replays])
                      for name in plant.inputs}  # fmt: skip
            order = np.argsort(inputs[across])
            if len(plant.inputs) == 1:
                inputs = {across: np.linspace(0.0, 1.1 * float(x.max()), _DRAWN)}
                order = np.arange(_DRAWN)
            values = plant.respond(model.vector(), inputs)[order, 0]
            axes.plot(
                x_unit.factor * inputs[across][order] + x_unit.offset,
                y_unit.factor * values + y_unit.offset,
                color=SHADES[shade], label=label,
            )  # fmt: skip
        axes.errorbar(
            x_unit.factor * x + x_unit.offset,
            y_unit.factor * y + y_unit.offset,
            yerr=y_unit.difference(floors.get(along, 0.0)),
            fmt="o", color=SHADES["text"], markersize=4.0, capsize=3.0, label="measured",
        )  # fmt: skip
        axes.set_title(f"{channel_name(along)} / {y_unit.symbol}")
        axes.set_xlabel(f"{channel_name(across)} / {x_unit.symbol}")
        axes.legend(loc="upper left")
        title = f"{channel_name(along)} at {y.size} operating points"
        return FigureView(key, render_svg(figure, key, title=title))
