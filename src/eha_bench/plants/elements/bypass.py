"""A valve between two ports that is open while a run's setup says `bypass: open`.

    q = G (p_first - p_second)

Source: the paper, Section 4.2.
"""

from __future__ import annotations

import math

from eha_bench.plants.elements.laminar_leakage import flow, slope
from eha_bench.plants.network.element import HYDRAULIC, Anatomy, ElementKind, Flow, Port
from eha_bench.plants.parameter import Parameter

_CONDUCTANCE = Parameter("conductance", "m^3/(s*Pa)", 6e-10, 0.0, math.inf, "G")


def _anatomy(declared: frozenset[str]) -> Anatomy:
    return Anatomy((_CONDUCTANCE,), (Flow("first", "second", flow, slope),), opens_with_bypass=True)


KIND = ElementKind(
    id="bypass",
    summary="A valve between two ports that the setup of a run opens.",
    ports=(Port("first", HYDRAULIC), Port("second", HYDRAULIC)),
    parameters=(_CONDUCTANCE,),
    anatomy=_anatomy,
    source="Yang et al. 2023, Section 4.2",
)
