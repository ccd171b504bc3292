"""A valve that limits a pressure: it opens where one side lies above the other by its setting.

    q = G max(0, p_from - p_to - p_r)

Source: Merritt, Hydraulic Control Systems, Wiley 1967.
"""

from __future__ import annotations

import math

from eha_bench.plants.network.element import HYDRAULIC, Anatomy, ElementKind, Flow, Port
from eha_bench.plants.parameter import Parameter

_CONDUCTANCE = Parameter("conductance", "m^3/(s*Pa)", 1e-10, 0.0, math.inf, "G")
_SETTING = Parameter("setting", "Pa", 20e6, 0.0, math.inf, "p_r", tolerance=0.15)


def flow(p_from: float, p_to: float, conductance: float, setting: float) -> float:
    """Return the flow that it lets out, m^3/s."""
    return conductance * max(0.0, p_from - p_to - setting)


def slope(p_from: float, p_to: float, conductance: float, setting: float) -> float:
    """Return its conductance while it is open, m^3/(s*Pa)."""
    return conductance if p_from - p_to > setting else 0.0


def _anatomy(declared: frozenset[str]) -> Anatomy:
    return Anatomy((_CONDUCTANCE, _SETTING), (Flow("from", "to", flow, slope, switches=True),))


KIND = ElementKind(
    id="relief_valve",
    summary="A valve that lets oil out where `from` lies above `to` by more than its setting.",
    ports=(Port("from", HYDRAULIC), Port("to", HYDRAULIC)),
    parameters=(_CONDUCTANCE, _SETTING),
    anatomy=_anatomy,
    required=("conductance", "setting"),
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
)
