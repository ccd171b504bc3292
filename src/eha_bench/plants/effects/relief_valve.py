"""A pressure-limiting valve lets oil out above its setting.

    q = G max(0, p - p_r)

either from each chamber to the reservoir (p of the chamber), or from one chamber to the other.
There the difference of the pressures opens it (p = |p_a - p_b|), or, where its spring chamber is
drained, the higher pressure alone; then as much flows as if that were the drop, never uphill:

    q = G max(0, min(p - p_r, p - p_other))

Where a machine has one line under pressure, and the other side of its cylinder is a reservoir, the
valve lets that line's oil out.

The valve's own motion is fast against the chambers' and is left out. A relief
valve opens far above what a machine works at, and then lets a pump's whole flow out within some
bar: a setting of up to a tenth of the highest pressure, or one that the pressure is above half of
the time, is a leak's. Near that one it yields to `external_leakage`, where that explains nearly as
much.

Source: Merritt, Hydraulic Control Systems, Wiley 1967; Yang et al. 2023, Section 2.
"""

from __future__ import annotations

from typing import NamedTuple

from eha_bench.plants.compiled import njit
from eha_bench.plants.effect import Action, Effect, Opening
from eha_bench.plants.parameter import Parameter, choice

_TANK, _PORTS = 0.0, 1.0
_DIFFERENCE = 0.0
_SETTINGS = tuple(float(f"{4e6 * 1.155**k:.3g}") for k in range(-18, 20))
"""Settings that a search begins from, 0.3 to 62 MPa, of which measured pressures leave some.

A seventh apart: from a setting that is never reached, or nearly always, no fit finds its way, and a
valve that holds the pressure leaves little between the two.
"""


class Valve(NamedTuple):
    """The effect's own parameters."""

    valve_conductance: float
    setting: float
    route: float
    opened_by: float


@njit()
def _across(p: float, other: float, setting: float, opened_by: float) -> float:
    """Return the pressure by which a valve from one chamber to the other is open, Pa."""
    if opened_by == _DIFFERENCE:
        return max(0.0, p - other - setting)
    return max(0.0, min(p - setting, p - other))


@njit()
def _over(p: float, other: float, own: Valve) -> float:
    """Return the pressure by which the valves lead out of a chamber, less into it, Pa."""
    if own.route == _TANK:
        return max(0.0, p - own.setting)
    out = _across(p, other, own.setting, own.opened_by)
    return out - _across(other, p, own.setting, own.opened_by)


def into_a(flow: float, p_a: float, p_b: float, own: Valve) -> float:
    """Return the flow into chamber A less what the valves let out, plus what they let in."""
    return flow - own.valve_conductance * _over(p_a, p_b, own)


def into_b(flow: float, p_a: float, p_b: float, own: Valve) -> float:
    """Return the flow into chamber B less what the valves let out, plus what they let in."""
    return flow - own.valve_conductance * _over(p_b, p_a, own)


def slope_a(value: float, p_a: float, own: Valve) -> float:
    """Return the conductance from chamber A to the reservoir, m^3/(s*Pa)."""
    return value + own.valve_conductance if own.route == _TANK and p_a > own.setting else value


def slope_b(value: float, p_b: float, own: Valve) -> float:
    """Return the conductance from chamber B to the reservoir, m^3/(s*Pa)."""
    return value + own.valve_conductance if own.route == _TANK and p_b > own.setting else value


def slope_ab(value: float, p_a: float, p_b: float, own: Valve) -> float:
    """Return the conductance between the chambers, m^3/(s*Pa)."""
    is_open = own.route == _PORTS and _over(p_a, p_b, own) != 0.0
    return value + own.valve_conductance if is_open else value


def out_of_line(
    flow: float, pressure: float, low_pressure: float, valve_conductance: float, setting: float
) -> float:
    """Return the flow into the only line under pressure less what the valve lets out, m^3/s."""
    return flow - valve_conductance * max(0.0, min(pressure - setting, pressure - low_pressure))


def slope_of_line(
    value: float, pressure: float, low_pressure: float, valve_conductance: float, setting: float
) -> float:
    """Return the conductance from that line to the reservoir, m^3/(s*Pa)."""
    return value + valve_conductance if pressure > max(setting, low_pressure) else value


def limited_pressure(p_a: float, p_b: float, route: float, opened_by: float) -> float:
    """Return the pressure that the setting is held against, Pa."""
    if route == _TANK or opened_by != _DIFFERENCE:
        return max(p_a, p_b)
    return abs(p_a - p_b)


EFFECT = Effect(
    id="relief_valve",
    summary="A pressure-limiting valve lets oil out above its setting.",
    parameters=(
        Parameter("valve_conductance", "m^3/(s*Pa)", 1e-12, 0.0, 1e-7, "G"),
        Parameter("setting", "Pa", 20e6, 2e5, 1e8, "p_r"),
        choice("route", ("tank", "ports"), "where the oil goes", of_role="chambers"),
        choice(
            "opened_by", ("difference", "pressure"), "what opens it between the ports",
            of_role="chambers", refines=True,
        ),
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
        ),
        "chamber": Action({"inflow": out_of_line, "ground": slope_of_line}),
    },
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
    separate="raise the pressure slowly with the piston locked until it stops rising",
    starts=tuple(
        {"setting": setting, "route": route}
        for route in (_TANK, _PORTS)
        for setting in _SETTINGS
    ),
    yields_to="external_leakage",
)  # fmt: skip
