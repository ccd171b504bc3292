"""A learned curve that is a straight line: what is missing grows in proportion.

A spring, a damper or a leak that nobody declared is no effect of a list, but an element of a plant
file. A curve of it is a line, and its slope is the number that the element asks for.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.channels import unit_of
from eha_bench.diagnosis.fit.candidates import LEARNED
from eha_bench.diagnosis.unknown.curves import LocatedCurve
from eha_bench.plants.effects.learned import FORMS
from eha_bench.plants.plant import Plant

_UNITS: Final[Mapping[str, str]] = {"torque": "N*m", "force": "N", "flow": "m^3/s"}
"""Of what a curve adds to a balance."""
_STATES: Final = ("m", "rad", "m/s", "rad/s", "Pa")
"""Units of what springs, dampers and leaks follow; no element follows the time."""
_STRAIGHT: Final = 0.01
"""Largest part of its variance by which a curve is off a line: noise bends its knots as much."""


def straight_line(best: LocatedCurve, plant: Plant, vector: FloatArray) -> str:
    """Return the slope of a curve of a balance that is a straight line, as a clause; else "".

    Args:
        best: where the curve acts. plant: it. vector: with the curve as it was learned.
    """
    unit = _UNITS.get(best.template.equation, "")
    if not unit or best.template.form != FORMS[0] or best.period:
        return ""
    layout = plant.layout
    at = layout.index[f"{LEARNED}.values"]
    size = layout.by_key[f"{LEARNED}.values"].size
    low, high, scale = (
        float(vector[layout.index[f"{LEARNED}.{name}"]]) for name in ("low", "high", "scale")
    )
    values, knots = scale * vector[at : at + size], np.linspace(low, high, size)
    slope, offset = np.polyfit(knots, values, 1)
    off = values - (offset + slope * knots)
    if not off.var() < _STRAIGHT * values.var():
        return ""
    name = best.template.variable
    per = plant.units.get(name) or unit_of(name)
    if per not in _STATES:
        return ""
    return f"a straight line: {slope:.4g} {unit} for each {per} of {best.follows}"


def straight_line_notes(shape: str) -> list[str]:
    """Say what a learned curve asks for that is a straight line, given it as a clause."""
    if not shape:
        return []
    return [
        f"the learned curve is {shape}: an element that grows in proportion is missing (a spring, "
        "a damper, a leak), or one that is declared is off by that much; declare it in the plant "
        "file"
    ]
