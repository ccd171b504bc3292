"""A servo valve with four lands: supply and tank on one side, ports a and b on the other.

    s'' = w^2 (u - s) - 2 z w s',    u = command / full_scale, within +-1
    o = s + s_0
    q_Pa = K max(0, o) r(p_P - p_a),     q_aT = K max(0, -o) r(p_a - p_T)
    q_Pb = K max(0, -o) r(p_P - p_b),    q_bT = K max(0, o) r(p_b - p_T)
    r(d) = d / (d^2 + p_l^2)^(1/4)

s is the spool's position as a share of its travel, s_0 what its null is off. A positive command
opens supply to a, and b to tank. The lands are matched and symmetric, without overlap. Without a
`natural_frequency` the spool follows at once, with a `time_constant` alone as a first-order lag.
Between steps the spool's path is exact. The command may be anything that opens the valve in
proportion: for one in mA or per cent, declare its full scale as a number of V and map the column
with `unit: V`.

Source: Merritt, Hydraulic Control Systems, Wiley 1967; Jelali, Kroll, Hydraulic Servo-systems,
Springer 2003, section 4.3.
"""

from __future__ import annotations

import math

from eha_bench.plants.compiled import njit
from eha_bench.plants.network.element import (
    HYDRAULIC,
    Anatomy,
    Command,
    ElementKind,
    Flow,
    HeldSignal,
    Input,
    Port,
    Quantity,
)
from eha_bench.plants.parameter import Parameter
from eha_bench.plants.smooth_root import smooth_root

_INF = math.inf
_GAIN = Parameter("flow_gain", "m^3/(s*Pa^0.5)", 1e-7, 0.0, _INF, "K", "flow of the full travel")
_SCALE = Parameter("full_scale", "V", 10.0, 1e-9, _INF, "", "command of the full travel")
_NULL = Parameter("null_bias", "", 0.0, -1.0, 1.0, "s_0", "share of the travel")
_LAMINAR = Parameter("laminar_pressure", "Pa", 2e4, 1.0, _INF, "p_l", "below it flow is laminar")
_FREQUENCY = Parameter("natural_frequency", "rad/s", 400.0, 1.0, 1e5, "w")
_DAMPING = Parameter("damping_ratio", "", 0.7, 0.05, 20.0, "z")
_TIME = Parameter("time_constant", "s", 2e-3, 1e-6, 10.0, "tau")


def cosine_after(h: float, natural_frequency: float, damping_ratio: float) -> float:
    """Return e^(-zwh) cos(w_d h), or its hyperbolic kin."""
    part = 1.0 - damping_ratio * damping_ratio
    if part > 1e-9:
        own = natural_frequency * math.sqrt(part)
        return math.exp(-damping_ratio * natural_frequency * h) * math.cos(own * h)
    if part < -1e-9:
        own = natural_frequency * math.sqrt(-part)
        slow = math.exp((own - damping_ratio * natural_frequency) * h)
        fast = math.exp(-(own + damping_ratio * natural_frequency) * h)
        return 0.5 * (slow + fast)
    return math.exp(-natural_frequency * h)


def sine_after(h: float, natural_frequency: float, damping_ratio: float) -> float:
    """Return e^(-zwh) sin(w_d h) / w_d, or its hyperbolic kin, s."""
    part = 1.0 - damping_ratio * damping_ratio
    if part > 1e-9:
        own = natural_frequency * math.sqrt(part)
        return math.exp(-damping_ratio * natural_frequency * h) * math.sin(own * h) / own
    if part < -1e-9:
        own = natural_frequency * math.sqrt(-part)
        slow = math.exp((own - damping_ratio * natural_frequency) * h)
        fast = math.exp(-(own + damping_ratio * natural_frequency) * h)
        return 0.5 * (slow - fast) / own
    return math.exp(-natural_frequency * h) * h


def spool_after(
    spool: float,
    spool_rate: float,
    demand: float,
    cosine: float,
    sine: float,
    full_scale: float,
    natural_frequency: float,
    damping_ratio: float,
) -> float:
    """Return the spool's position after a time h under a constant command (exact)."""
    off = spool - demand / full_scale
    bent = cosine + damping_ratio * natural_frequency * sine
    return demand / full_scale + off * bent + spool_rate * sine


def rate_after(
    spool: float,
    spool_rate: float,
    demand: float,
    cosine: float,
    sine: float,
    full_scale: float,
    natural_frequency: float,
    damping_ratio: float,
) -> float:
    """Return the spool's speed after a time h under a constant command, 1/s (exact)."""
    off = spool - demand / full_scale
    bent = cosine - damping_ratio * natural_frequency * sine
    return spool_rate * bent - off * natural_frequency * natural_frequency * sine


def fade_after(h: float, time_constant: float) -> float:
    """Return what is left of a first-order lag after a time h, as a share."""
    return math.exp(-h / time_constant)


def lagging_after(spool: float, demand: float, fade: float, full_scale: float) -> float:
    """Return the spool's position after a time h, with a first-order lag (exact)."""
    asked = demand / full_scale
    return asked + (spool - asked) * fade


def spool_demand(demand: float, full_scale: float) -> float:
    """Return the spool's position that a command asks for, as a share."""
    return demand / full_scale


def land_opening(spool: float, null_bias: float) -> float:
    """Return how far the lands are open, as a share."""
    return spool + null_bias


def spool_reading(spool: float) -> float:
    """Return the spool's position as its sensor sees it, as a share."""
    return spool


@njit()
def _root(d: float, laminar_pressure: float) -> float:
    return d / smooth_root(d, laminar_pressure)


@njit()
def _steep(d: float, laminar_pressure: float) -> float:
    return 1.0 / smooth_root(d, laminar_pressure)


def forward(
    p_source: float, p_sink: float, opening: float, flow_gain: float, laminar_pressure: float
) -> float:
    """Return the flow over a land that a positive command opens, m^3/s."""
    return flow_gain * max(0.0, opening) * _root(p_source - p_sink, laminar_pressure)


def backward(
    p_source: float, p_sink: float, opening: float, flow_gain: float, laminar_pressure: float
) -> float:
    """Return the flow over a land that a negative command opens, m^3/s."""
    return flow_gain * max(0.0, -opening) * _root(p_source - p_sink, laminar_pressure)


def forward_slope(
    p_source: float, p_sink: float, opening: float, flow_gain: float, laminar_pressure: float
) -> float:
    """Return the conductance of a land that a positive command opens, m^3/(s*Pa)."""
    return flow_gain * max(0.0, opening) * _steep(p_source - p_sink, laminar_pressure)


def backward_slope(
    p_source: float, p_sink: float, opening: float, flow_gain: float, laminar_pressure: float
) -> float:
    """Return the conductance of a land that a negative command opens, m^3/(s*Pa)."""
    return flow_gain * max(0.0, -opening) * _steep(p_source - p_sink, laminar_pressure)


_LANDS = (
    Flow("supply", "a", forward, forward_slope),
    Flow("supply", "b", backward, backward_slope),
    Flow("a", "tank", backward, backward_slope),
    Flow("b", "tank", forward, forward_slope),
)


def _anatomy(declared: frozenset[str]) -> Anatomy:
    common = (_GAIN, _SCALE, _NULL, _LAMINAR)
    if {"natural_frequency", "damping_ratio"} & declared:
        own: tuple[Parameter, ...] = (_FREQUENCY, _DAMPING)
        spool: tuple[HeldSignal, ...] = (
            HeldSignal("spool", spool_after, spool_demand),
            HeldSignal("spool_rate", rate_after),
            HeldSignal("cosine", factor=cosine_after),
            HeldSignal("sine", factor=sine_after),
        )
    elif "time_constant" in declared:
        own = (_TIME,)
        spool = (
            HeldSignal("spool", lagging_after, spool_demand),
            HeldSignal("fade", factor=fade_after),
        )
    else:
        own = ()
        spool = (HeldSignal("spool", value=spool_demand),)
    return Anatomy(
        (*common, *own),
        _LANDS,
        signals=(
            HeldSignal("demand"),
            *spool,
            HeldSignal("opening", value=land_opening, hook="opening"),
        ),
        inputs=(Input("command", "V", True, "demand"),),
        commands=(Command("command", "demand", "V", "full_scale"),),
        quantities=(Quantity("spool", "", spool_reading, "spool"),),
    )


KIND = ElementKind(
    id="spool_valve",
    summary="A servo valve with four lands and its spool's own dynamics.",
    ports=(
        Port("supply", HYDRAULIC), Port("tank", HYDRAULIC), Port("a", HYDRAULIC),
        Port("b", HYDRAULIC),
    ),
    parameters=(_GAIN, _SCALE, _NULL, _LAMINAR, _FREQUENCY, _DAMPING, _TIME),
    anatomy=_anatomy,
    required=("flow_gain",),
    source="Merritt, Hydraulic Control Systems, Wiley 1967",
)  # fmt: skip
