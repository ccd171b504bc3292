"""A check valve: oil flows one way only, above a cracking pressure.

    q = G max(0, p_from - p_to - p_c)

The valve's own motion is fast compared with the volumes' and is left out.

Source: Merritt, Hydraulic Control Systems, Wiley 1967.
"""

from __future__ import annotations

import math

from eha_bench.plants.network.element import HYDRAULIC, Anatomy, ElementKind, Flow, Port
from eha_bench.plants.parameter import Parameter

_CONDUCTANCE = Parameter("conductance", "m^3/(s*Pa)", 6e-10, 0.0, math.inf, "G")
_CRACKING = Parameter("cracking_pressure", "Pa", 0.0, 0.0, math.inf, "p_c", tolerance=0.5)


def flow(p_from: float, p_to: float, conductance: float, cracking_pressure: float) -> float:
    """Return the flow that it lets through, m^3/s."""
    return conductance * max(0.0, p_from - p_to - cracking_pressure)


def slope(p_from: float, p_to: float, conductance: float, cracking_pressure: float) -> float:
    """Return its conductance while it is open, m^3/(s*Pa)."""
    return conductance if p_from - p_to > cracking_pressure else 0.0


def _anatomy(declared: frozenset[str]) -> Anatomy:
    through = Flow("from", "to", flow, slope, switches=True)
    return Anatomy((_CONDUCTANCE, _CRACKING), (through,))


KIND = ElementKind(
    id="check_valve",
    summary="A valve that lets oil through one way only.",
    ports=(Port("from", HYDRAULIC), Port("to", HYDRAULIC)),
    parameters=(_CONDUCTANCE, _CRACKING),
    anatomy=_anatomy,
    required=("conductance",),
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
)
