"""A narrow gap between two volumes, through which oil flows in proportion to the pressure.

    q = L (p_first - p_second)

Source: Merritt, Hydraulic Control Systems, Wiley 1967.
"""

from __future__ import annotations

import math

from eha_bench.plants.network.element import HYDRAULIC, Anatomy, ElementKind, Flow, Port
from eha_bench.plants.parameter import Parameter

_CONDUCTANCE = Parameter("conductance", "m^3/(s*Pa)", 1e-13, 0.0, math.inf, "L")


def flow(p_first: float, p_second: float, conductance: float) -> float:
    """Return the flow from the first to the second, m^3/s."""
    return conductance * (p_first - p_second)


def slope(conductance: float) -> float:
    """Return its conductance, m^3/(s*Pa)."""
    return conductance


def _anatomy(declared: frozenset[str]) -> Anatomy:
    return Anatomy((_CONDUCTANCE,), (Flow("first", "second", flow, slope, hook="laminar"),))


KIND = ElementKind(
    id="laminar_leakage",
    summary="A gap (or a thin line) through which oil flows in proportion to the pressure.",
    ports=(Port("first", HYDRAULIC), Port("second", HYDRAULIC)),
    parameters=(_CONDUCTANCE,),
    anatomy=_anatomy,
    required=("conductance",),
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
    changed_by_warmth=("conductance",),
)
