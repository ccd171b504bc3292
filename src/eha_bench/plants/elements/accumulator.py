"""Gas behind a membrane that takes and gives oil.

    V_gas = V_0 (p_0 / p)^(1/n),    dV/dp = V_gas / (n p)      pressures absolute

Declared by its gas volume and precharge (gauge) at one state; `atmosphere` makes them absolute.
Where `mid_stroke_of` names a cylinder, that state is the rod at position 0: a closed circuit then
holds a known amount of oil, and the pressure at which a run begins follows from the position.

Source: Merritt, Hydraulic Control Systems, Wiley 1967; polytropic index between 1 (slow) and 1.4
(fast): Findeisen, Helduser, Ölhydraulik, 6th ed., Springer 2015.
"""

from __future__ import annotations

import math

from eha_bench.plants.network.element import Anatomy, Compliance, ElementKind, NodeKind, Port
from eha_bench.plants.parameter import Parameter

_PRECHARGE = Parameter("precharge", "Pa", 6e5, 0.0, math.inf, "p_0", "gauge", tolerance=0.2)
_GAS = Parameter("gas_volume", "m^3", 1e-3, 1e-9, math.inf, "V_0", "at the precharge")
_INDEX = Parameter("polytropic_index", "", 1.0, 1.0, 1.67, "n", "isothermal")
_ATMOSPHERE = Parameter("atmosphere", "Pa", 1e5, 0.0, 2e5, "", "pressures are gauge")


def give(
    p_on: float, precharge: float, gas_volume: float, polytropic_index: float, atmosphere: float
) -> float:
    """Return dV/dp of the gas, m^3/Pa."""
    p = max(p_on + atmosphere, 0.01 * (precharge + atmosphere))
    ratio = (precharge + atmosphere) / p
    if polytropic_index != 1.0:
        ratio = math.pow(ratio, 1.0 / polytropic_index)
    return gas_volume * ratio / (polytropic_index * p)


def _anatomy(declared: frozenset[str]) -> Anatomy:
    return Anatomy((_PRECHARGE, _GAS, _INDEX, _ATMOSPHERE), (Compliance("on", give),))


KIND = ElementKind(
    id="accumulator",
    summary="Gas that takes and gives oil.",
    ports=(Port("on", (NodeKind.VOLUME,)),),
    parameters=(_PRECHARGE, _GAS, _INDEX, _ATMOSPHERE),
    anatomy=_anatomy,
    required=("precharge", "gas_volume"),
    refers=("mid_stroke_of",),
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
)
