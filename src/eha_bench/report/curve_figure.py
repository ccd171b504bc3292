"""The curve that stands for something unknown: what it adds, against what it depends on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from eha_bench.core.arrays import FloatArray
from eha_bench.core.channels import unit_of
from eha_bench.plants.model import Model
from eha_bench.report.embed_svg import SHADES
from eha_bench.report.engineering import DisplayUnit, channel_name, display_unit
from eha_bench.report.figure_view import FigureView
from eha_bench.report.figures import plot_style, render_svg

_LEARNED: Final = "learned"
_WIDTH: Final = 662.0 / 72.0
_UNITS: Final = {"time": "s", "pressure_sum": "Pa", "shaft_angle": "rad"}
_AMOUNTS: Final = {
    "torque": ("Torque", "N*m"),
    "flow": ("Flow", "m^3/s"),
    "force": ("Force", "N"),
    "actuation": ("Added to the command", ""),
}


@dataclass(frozen=True)
class DrawnCurve:
    """A learned curve with its axes.

    Attributes:
        variable, amount: what it depends on and what it gives, with SI units.
        at, values: (k,) knots and what it gives there, SI.
        periodic: whether it goes round and round.
    """

    variable: tuple[str, str]
    amount: tuple[str, str]
    at: FloatArray
    values: FloatArray
    periodic: bool


def learned_curve(model: Model) -> DrawnCurve | None:
    """Return the curve of a model's `learned` effect, None where it has none."""
    for effect in model.effects:
        if effect.id != _LEARNED:
            continue
        values_of: dict[str, Any] = dict(effect.values)
        values = float(values_of.get("scale", 1.0)) * np.asarray(
            values_of["values"], dtype=np.float64
        )
        period = float(values_of.get("period", 0.0))
        if period > 0.0:
            at = np.linspace(0.0, period, values.size + 1)
            values = np.append(values, values[0])
        else:
            at = np.linspace(float(values_of["low"]), float(values_of["high"]), values.size)
        name = str(values_of["variable"])
        unit = model.plant.units.get(name) or _UNITS.get(name, unit_of(name))
        variable = (_name(name), unit)
        return DrawnCurve(variable, _amount(values_of, model), at, values, period > 0.0)
    return None


def curve_view(curve: DrawnCurve, *, key: str, title: str) -> FigureView:
    """Draw a learned curve as a static plot."""
    across = display_unit(curve.variable[1], curve.at.tolist())
    along = display_unit(curve.amount[1], curve.values.tolist())
    with plot_style():
        figure = Figure(figsize=(_WIDTH, 2.9), layout="constrained")
        axes = figure.subplots()
        axes.axhline(0.0, color=SHADES["axis"], linewidth=0.8)
        axes.plot(
            across.factor * curve.at + across.offset, along.factor * curve.values,
            color=SHADES["blue"], marker="o", markersize=3.0,
        )  # fmt: skip
        axes.set_title(_axis_label(curve.amount[0], along))
        once = " (one period)" if curve.periodic else ""
        axes.set_xlabel(_axis_label(curve.variable[0], across) + once)
        return FigureView(key, render_svg(figure, key, title=title))


def _axis_label(name: str, unit: DisplayUnit) -> str:
    return f"{name} / {unit.symbol}" if unit.symbol else name


def _name(variable: str) -> str:
    return channel_name(variable).replace("_", " ").capitalize()


def _amount(values_of: dict[str, Any], model: Model) -> tuple[str, str]:
    if values_of.get("form") == "gain":
        return "Change of the gain, share of 1", ""
    effect = model.plant.layout.effect(_LEARNED)
    equation, at = effect.equation(values_of).value, effect.place(values_of)
    if equation == "measurement":
        sensor = at.removesuffix(".sensor")
        if sensor == "pressures":
            return "Added to what the pressure sensors read", unit_of("pressure_a")
        unit = model.plant.units.get(sensor) or unit_of(sensor)
        return f"Added to what the sensor of {_name(sensor).lower()} reads", unit
    name, unit = _AMOUNTS[equation]
    if equation == "actuation":
        unit = model.plant.units.get(model.plant.command, unit)
    if values_of.get("form") == "friction":
        name = f"Dry friction ({name.lower()})"
    return name, unit
