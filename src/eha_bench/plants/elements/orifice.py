"""A sharp-edged orifice given by its area.

    q = C_d A sqrt(2 / rho) dp / (dp^2 + p_t^2)^(1/4)

Source: Merritt, Hydraulic Control Systems, Wiley 1967 (C_d = 0.61); Borutzky, Barnard, Thoma,
Simulation Modelling Practice and Theory 10 (2002) 141, doi:10.1016/S1569-190X(02)00092-8.
"""

from __future__ import annotations

import math

from eha_bench.plants.compiled import njit
from eha_bench.plants.network.element import HYDRAULIC, Anatomy, ElementKind, Flow, Port
from eha_bench.plants.parameter import Parameter
from eha_bench.plants.smooth_root import smooth_root

_AREA = Parameter("area", "m^2", 1e-6, 0.0, math.inf, "A")
_DISCHARGE = Parameter("discharge_coefficient", "", 0.61, 0.01, 1.0, "C_d", "sharp edges")
_DENSITY = Parameter("density", "kg/m^3", 860.0, 100.0, 3000.0, "rho", "mineral oil")
_TRANSITION = Parameter(
    "transition_pressure", "Pa", 1e4, 1.0, math.inf, "p_t", "small compared with what matters"
)


@njit()
def _coefficient(area: float, discharge_coefficient: float, density: float) -> float:
    return discharge_coefficient * area * math.sqrt(2.0 / density)


def flow(
    p_first: float,
    p_second: float,
    area: float,
    discharge_coefficient: float,
    density: float,
    transition_pressure: float,
) -> float:
    """Return the flow from the first to the second, m^3/s."""
    d = p_first - p_second
    k = _coefficient(area, discharge_coefficient, density)
    return k * d / smooth_root(d, transition_pressure)


def slope(
    p_first: float,
    p_second: float,
    area: float,
    discharge_coefficient: float,
    density: float,
    transition_pressure: float,
) -> float:
    """Return its conductance, never less than the true slope, m^3/(s*Pa)."""
    k = _coefficient(area, discharge_coefficient, density)
    return k / smooth_root(p_first - p_second, transition_pressure)


def _anatomy(declared: frozenset[str]) -> Anatomy:
    parameters = (_AREA, _DISCHARGE, _DENSITY, _TRANSITION)
    return Anatomy(parameters, (Flow("first", "second", flow, slope),))


KIND = ElementKind(
    id="orifice",
    summary="A sharp-edged orifice given by its area.",
    ports=(Port("first", HYDRAULIC), Port("second", HYDRAULIC)),
    parameters=(_AREA, _DISCHARGE, _DENSITY, _TRANSITION),
    anatomy=_anatomy,
    required=("area",),
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
)
