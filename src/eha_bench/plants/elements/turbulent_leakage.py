"""An orifice between two volumes: the flow goes with the root of the pressure.

    q = k dp / (dp^2 + p_t^2)^(1/4)

which is k sign(dp) sqrt(|dp|) but near dp = 0, where every flow is laminar.

Source: Merritt, Hydraulic Control Systems, Wiley 1967; Borutzky, Barnard, Thoma, Simulation
Modelling Practice and Theory 10 (2002) 141, doi:10.1016/S1569-190X(02)00092-8 (transition).
"""

from __future__ import annotations

import math

from eha_bench.plants.network.element import HYDRAULIC, Anatomy, ElementKind, Flow, Port
from eha_bench.plants.parameter import Parameter
from eha_bench.plants.smooth_root import smooth_root

_COEFFICIENT = Parameter("coefficient", "m^3/(s*Pa^0.5)", 1e-9, 0.0, math.inf, "k")
_TRANSITION = Parameter(
    "transition_pressure", "Pa", 1e4, 1.0, math.inf, "p_t", "small compared with what matters"
)


def flow(p_first: float, p_second: float, coefficient: float, transition_pressure: float) -> float:
    """Return the flow from the first to the second, m^3/s."""
    d = p_first - p_second
    return coefficient * d / smooth_root(d, transition_pressure)


def slope(p_first: float, p_second: float, coefficient: float, transition_pressure: float) -> float:
    """Return its conductance, never less than the true slope, m^3/(s*Pa)."""
    d = p_first - p_second
    return coefficient / smooth_root(d, transition_pressure)


def _anatomy(declared: frozenset[str]) -> Anatomy:
    return Anatomy((_COEFFICIENT, _TRANSITION), (Flow("first", "second", flow, slope),))


KIND = ElementKind(
    id="turbulent_leakage",
    summary="An orifice given by its coefficient.",
    ports=(Port("first", HYDRAULIC), Port("second", HYDRAULIC)),
    parameters=(_COEFFICIENT, _TRANSITION),
    anatomy=_anatomy,
    required=("coefficient",),
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
)
