"""A pressure-limiting valve lets oil out above its setting.

    q = G max(0, p - p_r)

either from each chamber to the reservoir (p of the chamber), or from one chamber to the other
(p = |p_a - p_b|). The valve's own motion is fast against the chambers' and is left out. A relief
valve opens far above what a machine works at, and then lets a pump's whole flow out within some
bar: a setting of a few bar, or one that the pressure is above half of the time, is a leak's.

Source: Merritt, Hydraulic Control Systems, Wiley 1967; Yang et al. 2023, Section 2.
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect, Opening
from eha_bench.plants.parameter import Parameter, choice

_TANK, _PORTS = 0.0, 1.0


def into_a(
    flow: float, p_a: float, p_b: float, valve_conductance: float, setting: float, route: float
) -> float:
    """Return the flow into chamber A less what the valves let out, plus what they let in."""
    if route == _TANK:
        return flow - valve_conductance * max(0.0, p_a - setting)
    over = max(0.0, p_a - p_b - setting) - max(0.0, p_b - p_a - setting)
    return flow - valve_conductance * over


def into_b(
    flow: float, p_a: float, p_b: float, valve_conductance: float, setting: float, route: float
) -> float:
    """Return the flow into chamber B less what the valves let out, plus what they let in."""
    if route == _TANK:
        return flow - valve_conductance * max(0.0, p_b - setting)
    over = max(0.0, p_a - p_b - setting) - max(0.0, p_b - p_a - setting)
    return flow + valve_conductance * over


def slope_a(
    value: float, p_a: float, valve_conductance: float, setting: float, route: float
) -> float:
    """Return the conductance from chamber A to the reservoir, m^3/(s*Pa)."""
    return value + valve_conductance if route == _TANK and p_a > setting else value


def slope_b(
    value: float, p_b: float, valve_conductance: float, setting: float, route: float
) -> float:
    """Return the conductance from chamber B to the reservoir, m^3/(s*Pa)."""
    return value + valve_conductance if route == _TANK and p_b > setting else value


def slope_ab(
    value: float, p_a: float, p_b: float, valve_conductance: float, setting: float, route: float
) -> float:
    """Return the conductance between the chambers, m^3/(s*Pa)."""
    return value + valve_conductance if route == _PORTS and abs(p_a - p_b) > setting else value


def limited_pressure(p_a: float, p_b: float, route: float) -> float:
    """Return the pressure that the setting is held against, Pa."""
    return max(p_a, p_b) if route == _TANK else abs(p_a - p_b)


EFFECT = Effect(
    id="relief_valve",
    summary="A pressure-limiting valve lets oil out above its setting.",
    parameters=(
        Parameter("valve_conductance", "m^3/(s*Pa)", 1e-12, 0.0, 1e-7, "G"),
        Parameter("setting", "Pa", 20e6, 2e6, 1e8, "p_r"),
        choice("route", ("tank", "ports"), "where the oil goes"),
    ),
    actions={
        "chambers": Action(
            {
                "into_a": into_a,
                "into_b": into_b,
                "ground_a": slope_a,
                "ground_b": slope_b,
                "link": slope_ab,
            },
            opens=Opening("setting", limited_pressure),
        )
    },
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
    separate="raise the pressure slowly with the piston locked until it stops rising",
    starts=tuple(
        {"setting": setting, "route": route}
        for route in (_TANK, _PORTS)
        # a third apart: from a setting that is much lower or higher, no fit finds its way
        for setting in (4e6, 5.3e6, 7.1e6, 9.5e6, 12.6e6, 16.8e6, 22.4e6, 30e6)
    ),
)
