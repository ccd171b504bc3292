"""Oil leaks through the clearance of a valve's lands, most at null.

    q = g (p_first - p_second) f(o)   across each of the four lands
    f = 1 (`form: constant`), or 1 / (1 + |o| / o_0) (`form: null`), o_0 = 0.02 of the travel

Where lands overlap they leak the less, the further they overlap (Ellman); at null all four leak,
and the chambers stand halfway between supply and tank.

Source: Merritt, Hydraulic Control Systems, Wiley 1967 (null leakage); Eryilmaz, Wilson, J. Dyn.
Sys. Meas. Control 128 (2006) 771, doi:10.1115/1.2361319 (leakage within the overlap).
"""

from __future__ import annotations

from eha_bench.plants.compiled import njit
from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

_CONSTANT = 0.0
_NULL = 0.02


@njit()
def _share(opening: float, form: float) -> float:
    return 1.0 if form == _CONSTANT else 1.0 / (1.0 + abs(opening) / _NULL)


@njit()
def _into(flow: float, p: float, p_supply: float, p_tank: float, conductance: float) -> float:
    return flow + conductance * (p_supply - p) - conductance * (p - p_tank)


def into_a(
    flow: float,
    p_a: float,
    p_supply: float,
    p_tank: float,
    opening: float,
    leakage_coefficient: float,
    form: float,
) -> float:
    """Return the flow into a with what leaks from supply, less what leaks to tank, m^3/s."""
    return _into(flow, p_a, p_supply, p_tank, leakage_coefficient * _share(opening, form))


def into_b(
    flow: float,
    p_b: float,
    p_supply: float,
    p_tank: float,
    opening: float,
    leakage_coefficient: float,
    form: float,
) -> float:
    """Return the flow into b with what leaks from supply, less what leaks to tank, m^3/s."""
    return _into(flow, p_b, p_supply, p_tank, leakage_coefficient * _share(opening, form))


def from_supply(
    flow: float,
    p_a: float,
    p_b: float,
    p_supply: float,
    opening: float,
    leakage_coefficient: float,
    form: float,
) -> float:
    """Return the flow into the supply's volume less what leaks to both ports, m^3/s."""
    own = leakage_coefficient * _share(opening, form)
    return flow - own * (2.0 * p_supply - p_a - p_b)


def slope(value: float, opening: float, leakage_coefficient: float, form: float) -> float:
    """Return the conductance with that of two lands, m^3/(s*Pa)."""
    return value + 2.0 * leakage_coefficient * _share(opening, form)


EFFECT = Effect(
    id="valve_leakage",
    summary="Oil leaks across the valve's lands.",
    parameters=(
        Parameter("leakage_coefficient", "m^3/(s*Pa)", 1e-12, 0.0, 1e-8, "g"),
        choice("form", ("null", "constant"), "whether it leaks most at null"),
    ),
    actions={
        "valve": Action(
            {
                "inflow_a": into_a,
                "inflow_b": into_b,
                "inflow_supply": from_supply,
                "ground_a": slope,
                "ground_b": slope,
                "ground_supply": slope,
            }
        )
    },
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
    separate="block both ports at null and watch the chambers: they go halfway to the supply",
    starts=({"leakage_coefficient": 1e-11},),
)  # fmt: skip
