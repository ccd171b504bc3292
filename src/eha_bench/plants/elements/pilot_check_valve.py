"""A check valve that another pressure opens against its direction.

    s = clip((r (p_pilot - p_to) - (p_from - p_to) - p_c) / range, 0, 1)
    q = (3 s^2 - 2 s^3) G (p_from - p_to)

It lets oil return from `from` to `to` while the pilot's pressure times the ratio r of the areas
overcomes what holds it shut. The way it opens smoothly over `opening_range` is the usual one.

Source: Findeisen, Helduser, Ölhydraulik, 6th ed., Springer 2015 (pilot-operated checks).
"""

from __future__ import annotations

import math

from eha_bench.plants.compiled import njit
from eha_bench.plants.network.element import HYDRAULIC, Anatomy, ElementKind, Flow, Port
from eha_bench.plants.parameter import Parameter

_RATIO = Parameter("ratio", "", 3.0, 0.1, 100.0, "r")
_CONDUCTANCE = Parameter("conductance", "m^3/(s*Pa)", 6e-10, 0.0, math.inf, "G")
_CRACKING = Parameter("cracking_pressure", "Pa", 0.0, 0.0, math.inf, "p_c", tolerance=0.5)
_RANGE = Parameter("opening_range", "Pa", 1e5, 1.0, math.inf, "", "opens over one bar")


@njit()
def _share(opening: float) -> float:
    s = min(1.0, max(0.0, opening))
    return s * s * (3.0 - 2.0 * s)


def flow(
    p_from: float,
    p_to: float,
    p_pilot: float,
    ratio: float,
    conductance: float,
    cracking_pressure: float,
    opening_range: float,
) -> float:
    """Return the flow through it, m^3/s."""
    through = p_from - p_to
    over = ratio * (p_pilot - p_to) - through - cracking_pressure
    return _share(over / opening_range) * conductance * through


def slope(
    p_from: float,
    p_to: float,
    p_pilot: float,
    ratio: float,
    conductance: float,
    cracking_pressure: float,
    opening_range: float,
) -> float:
    """Return its conductance, m^3/(s*Pa)."""
    over = ratio * (p_pilot - p_to) - (p_from - p_to) - cracking_pressure
    return _share(over / opening_range) * conductance


def _anatomy(declared: frozenset[str]) -> Anatomy:
    through = Flow("from", "to", flow, slope, switches=True)
    return Anatomy((_RATIO, _CONDUCTANCE, _CRACKING, _RANGE), (through,))


KIND = ElementKind(
    id="pilot_check_valve",
    summary="A check valve that another pressure opens.",
    ports=(Port("from", HYDRAULIC), Port("to", HYDRAULIC), Port("pilot", HYDRAULIC)),
    parameters=(_RATIO, _CONDUCTANCE, _CRACKING, _RANGE),
    anatomy=_anatomy,
    required=("ratio", "conductance"),
    source="Findeisen, Helduser, Ölhydraulik, Springer 2015",
)
