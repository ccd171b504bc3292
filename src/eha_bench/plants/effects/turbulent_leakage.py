"""Oil leaks between the chambers through an orifice: turbulent, with the root of the pressure.

    q = k sign(dp) sqrt(|dp|),   dp = p_a - p_b

regularised near dp = 0, where every flow is laminar:  q = k dp / (dp^2 + p_t^2)^(1/4).

Source: Merritt, Hydraulic Control Systems, Wiley 1967 (orifices); Borutzky, Barnard,
Thoma, Simulation Modelling Practice and Theory 10 (2002) 141, doi:10.1016/S1569-190X(02)00092-8
(transition).
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter
from eha_bench.plants.smooth_root import smooth_root


def into_a(
    flow: float, p_a: float, p_b: float, orifice_coefficient: float, transition_pressure: float
) -> float:
    """Return the flow into chamber A less what leaks to B, m^3/s."""
    d = p_a - p_b
    return flow - orifice_coefficient * d / smooth_root(d, transition_pressure)


def into_b(
    flow: float, p_a: float, p_b: float, orifice_coefficient: float, transition_pressure: float
) -> float:
    """Return the flow into chamber B with what leaks from A, m^3/s."""
    d = p_a - p_b
    return flow + orifice_coefficient * d / smooth_root(d, transition_pressure)


def slope(
    value: float, p_a: float, p_b: float, orifice_coefficient: float, transition_pressure: float
) -> float:
    """Return the conductance between the chambers, never less than the true slope."""
    return value + orifice_coefficient / smooth_root(p_a - p_b, transition_pressure)


EFFECT = Effect(
    id="turbulent_leakage",
    summary="Oil leaks between the chambers with the root of the pressure difference.",
    parameters=(
        Parameter("orifice_coefficient", "m^3/(s*Pa^0.5)", 2e-10, 0.0, 1e-5, "k"),
        Parameter(
            "transition_pressure", "Pa", 1e4, 1.0, 1e7, "p_t",
            "small compared with every pressure that matters", searched=False,
        ),
    ),
    actions={"chambers": Action({"into_a": into_a, "into_b": into_b, "link": slope})},
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
    separate="decay of several pressures with the piston locked: laminar decays by the same factor",
)  # fmt: skip
