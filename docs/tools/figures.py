"""Figures of the explanation, drawn from what the product measured, computed and wrote.

Needs the folder that gallery.py filled; writes SVG files into `figures` beside it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

import eha_bench as eb
from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive
from eha_bench.plants.registry import get_plant

BLUE, ORANGE, GREEN, RED, GREY = "#0068b5", "#b26a00", "#0a7d5d", "#bd2217", "#59636f"
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "eha",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e7ec",
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "legend.frameon": False,
    "figure.facecolor": "white",
    "text.parse_math": False,
}
DEFAULT = {item.name: item.default for item in get_plant("eha_knee").layout.parameters}


def make(gallery: Path) -> None:
    """Draw every figure."""
    folder = gallery.parent / "figures"
    folder.mkdir(exist_ok=True)
    with mpl.rc_context(_STYLE):
        for name, figure in (
            ("holding", holding()),
            ("friction", friction()),
            ("cavitation", cavitation(gallery)),
            ("causes", causes(gallery)),
            ("held_out", held_out(gallery)),
        ):
            figure.savefig(folder / f"{name}.svg", metadata={"Date": None}, bbox_inches="tight")


def holding() -> Figure:
    """The current that holds a pressure: Eq. (21) as printed and corrected, and as measured."""
    pressure = np.array([15.0, 20.0, 30.0])
    measured = np.array([11.0, 15.8, 24.0])
    push = DEFAULT["pump_displacement"] * 1e6 * pressure
    printed = (DEFAULT["static_torque"] + push) / DEFAULT["torque_constant"]
    opposed = (push - DEFAULT["coulomb_torque"]) / DEFAULT["torque_constant"]
    figure = Figure(figsize=(6.4, 2.9))
    axes = figure.add_subplot(title="Current that holds a pressure")
    axes.plot(pressure, printed, "s--", color=RED, label="Eq. (21) as printed")
    axes.plot(pressure, opposed, "o-", color=BLUE, label="friction opposes motion")
    axes.plot(pressure, measured, "kx", markersize=9, markeredgewidth=2, label="published")
    for x, y, m in zip(pressure, printed, measured, strict=True):
        axes.annotate(f"{100 * (y / m - 1):+.0f} %", (x, y), (0, 6), textcoords="offset points",
                      ha="center", color=RED)  # fmt: skip
    axes.set(xlabel="pressure difference / MPa", ylabel="current / A", ylim=(8, 31))
    axes.legend(loc="upper left")
    return figure


def friction() -> Figure:
    """Friction of the pump against its speed, ports connected: what the model does at rest."""
    model = load_model(gallery_model())
    torque = DEFAULT["torque_constant"]
    levels = np.concatenate((np.linspace(0.5, 2.2, 18), np.linspace(2.4, 8.0, 12)))
    time = np.arange(0.0, 6.0, 1e-3)
    speeds = []
    for level in levels:
        # from above: a push gets it going, then the current comes down to the level
        current = np.where(time < 0.3, 8.0, level)
        drive = Drive(time, {"current_command": current}, locked=True, bypass_open=True)
        found = model.plant.simulate(model.vector(), drive, 5e-5)
        speeds.append(found[-1, model.plant.outputs.index("motor_speed")])
    figure = Figure(figsize=(6.4, 2.6))
    axes = figure.add_subplot(title="Friction of the pump, ports connected")
    axes.plot(speeds, torque * levels, ".-", color=BLUE, label="simulated, settled")
    axes.axhline(DEFAULT["static_torque"], color=GREY, linestyle=":", label="T_sf: holds at rest")
    axes.axhline(DEFAULT["coulomb_torque"], color=GREY, linestyle="--", label="T_cf")
    axes.set(xlabel="shaft speed / (rad/s)", ylabel="K_T i / (N m)")
    axes.legend(loc="lower right")
    return figure


def gallery_model() -> Path:
    """The physically complete model that ships."""
    return Path(__file__).resolve().parents[2] / "suites" / "models" / "physical.yaml"


def cavitation(gallery: Path) -> Figure:
    """Chamber pressures of the 30 MPa step: as printed, and with check valves."""
    figure = Figure(figsize=(6.4, 2.6))
    both = figure.subplots(1, 2, sharey=True)
    pairs = (("paper", "the model as printed"), ("physical", "with check valves"))
    for axes, (name, title) in zip(both, pairs, strict=True):
        rec = eb.read(gallery / name / "recordings" / "pressure_step-30MPa-0.mcap")
        part = (rec.time >= 0) & (rec.time <= 0.2)
        milliseconds = 1e3 * rec.time[part]
        axes.plot(milliseconds, rec["pressure_a"][part] / 1e6, color=ORANGE, label="chamber A")
        axes.plot(milliseconds, rec["pressure_b"][part] / 1e6, color=BLUE, label="chamber B")
        axes.axhline(0, color="black", linewidth=0.8)
        axes.set(title=title, xlabel="time / ms")
    both[0].set_ylabel("pressure / MPa")
    both[1].legend()
    figure.subplots_adjust(wspace=0.08)
    return figure


def causes(gallery: Path) -> Figure:
    """What each candidate explains of the excess, on runs left out of its fit."""
    ranking = _diagnosis(gallery)["ranking"][:6]
    names = [item["id"] for item in ranking]
    shares = [100.0 * max(0.0, item["score"]) for item in ranking]
    figure = Figure(figsize=(6.4, 2.2))
    axes = figure.add_subplot(title="Share of the excess that a cause takes, on runs left out")
    bars = axes.barh(names[::-1], shares[::-1], color=GREY)
    bars[-1].set_color(GREEN)
    axes.axvline(25, color=RED, linestyle="--", linewidth=1)
    axes.set(xlabel="%", xlim=(0, 105))
    axes.grid(visible=False, axis="y")
    return figure


def held_out(gallery: Path) -> Figure:
    """Residual on the run that was never fitted: re-calibrated model, revised model."""
    dataset = gallery / "work" / "dataset.yaml"
    rec = eb.read(gallery / "work" / "recorded" / "recordings" / "sine-0.mcap")
    figure = Figure(figsize=(6.4, 2.4))
    axes = figure.add_subplot(title="Held-out sine: measured minus predicted pressure difference")
    kinds: Iterable[tuple[str, str, str]] = (
        ("recalibrated", RED, "re-calibrated, without the effect"),
        ("revised", GREEN, "revised"),
    )
    for name, colour, label in kinds:
        model = gallery / "diagnosis" / f"{name}.yaml"
        found = eb.predict(dataset, model, gallery / "work" / f"predicted_{name}")
        run = next(item for item in found if "sine" in item.run)
        predicted = run.values["pressure_a"] - run.values["pressure_b"]
        error = (rec["pressure_difference"] - predicted) / 1e6
        axes.plot(rec.time, error, color=colour, linewidth=1, label=label)
    axes.set(xlabel="time / s", ylabel="MPa")
    axes.legend(loc="upper right", ncols=2)
    return figure


def _diagnosis(gallery: Path) -> Any:
    return json.loads((gallery / "diagnosis" / "diagnosis.json").read_text(encoding="utf-8"))
