"""A motor on a shaft, driven by a current, by a voltage, or by the duty of a bridge on a supply.

    T = K_T i,    i = (u - K_E w) / R   where a voltage drives it,    u = duty * supply

Its inductance is left out: the electrical time constant of servo motors lies below a millisecond.

Source: Leonhard, Control of Electrical Drives, 3rd ed., Springer 2001.
"""

from __future__ import annotations

import math

from eha_bench.plants.network.element import (
    Anatomy,
    BalanceSide,
    Command,
    Effort,
    ElementKind,
    HeldSignal,
    Input,
    NodeKind,
    Port,
    Quantity,
)
from eha_bench.plants.parameter import UNLIMITED, Parameter

_INF = math.inf
_CONSTANT = Parameter("torque_constant", "N*m/A", 0.1, 1e-9, _INF, "K_T", drawn=True)
_EMF = Parameter("voltage_constant", "V*s/rad", 0.1, 0.0, _INF, "K_E", "K_T where it is not given")
_RESISTANCE = Parameter("resistance", "ohm", 1.0, 1e-6, _INF, "R")
_CURRENT_LIMIT = Parameter("current_limit", "A", UNLIMITED, 1e-6, _INF, "", "none that matters")
_VOLTAGE_LIMIT = Parameter("voltage_limit", "V", UNLIMITED, 1e-6, _INF, "", "none that matters")
_DUTY_LIMIT = Parameter("duty_limit", "", 1.0, 1e-6, 1.0, "", "of a bridge")
_SUPPLY = Parameter("supply_voltage", "V", 12.0, 0.0, _INF, "", "where it is not measured")


def torque_of_current(current: float, torque_constant: float) -> float:
    """Return the torque of a current, N*m."""
    return torque_constant * current


def same(current: float) -> float:
    """Return the current that flows, A."""
    return current


def current_of_voltage(
    voltage: float, speed: float, torque_constant: float, resistance: float
) -> float:
    """Return the current that a voltage drives against the back-EMF, A; K_E = K_T."""
    return (voltage - torque_constant * speed) / resistance


def torque_of_voltage(
    voltage: float, speed: float, torque_constant: float, resistance: float
) -> float:
    """Return the torque at a voltage, N*m; K_E = K_T."""
    return torque_constant * ((voltage - torque_constant * speed) / resistance)


def current_with_emf(
    voltage: float, speed: float, voltage_constant: float, resistance: float
) -> float:
    """Return the current that a voltage drives against the back-EMF, A."""
    return (voltage - voltage_constant * speed) / resistance


def torque_with_emf(
    voltage: float,
    speed: float,
    torque_constant: float,
    voltage_constant: float,
    resistance: float,
) -> float:
    """Return the torque at a voltage, N*m."""
    return torque_constant * ((voltage - voltage_constant * speed) / resistance)


def bridge(duty: float, supply: float) -> float:
    """Return the voltage of a bridge at a duty, V."""
    return duty * supply


def _anatomy(declared: frozenset[str]) -> Anatomy:
    bridged = bool({"input:duty", "duty_limit", "supply_voltage"} & declared)
    if "resistance" not in declared and "input:voltage" not in declared and not bridged:
        return Anatomy(
            (_CONSTANT, _CURRENT_LIMIT),
            (Effort("on", torque_of_current, BalanceSide.DRIVE, "torque"),),
            signals=(HeldSignal("current"),),
            inputs=(Input("current", "A", True, "current"),),
            commands=(Command("current", "current", "A", "current_limit"),),
            quantities=(Quantity("current", "A", same, "current"),),
        )
    own_emf = "voltage_constant" in declared
    current = Quantity("current", "A", current_with_emf if own_emf else current_of_voltage)
    torque = torque_with_emf if own_emf else torque_of_voltage
    parameters = (_CONSTANT, *((_EMF,) if own_emf else ()), _RESISTANCE)
    efforts = (Effort("on", torque, BalanceSide.DRIVE, "torque"),)
    if bridged:
        return Anatomy(
            (*parameters, _DUTY_LIMIT, _SUPPLY),
            efforts,
            signals=(HeldSignal("duty"), HeldSignal("supply"), HeldSignal("voltage", value=bridge)),
            inputs=(
                Input("duty", "", True, "duty"),
                Input("supply_voltage", "V", True, "supply", "supply_voltage"),
            ),
            commands=(Command("duty", "duty", "", "duty_limit"),),
            quantities=(current,),
        )
    return Anatomy(
        (*parameters, _VOLTAGE_LIMIT),
        efforts,
        signals=(HeldSignal("voltage"),),
        inputs=(Input("voltage", "V", True, "voltage"),),
        commands=(Command("voltage", "voltage", "V", "voltage_limit"),),
        quantities=(current, Quantity("voltage", "V", _voltage, "voltage")),
    )


def _voltage(voltage: float) -> float:
    return voltage


KIND = ElementKind(
    id="motor",
    summary="A motor on a shaft: current, voltage against back-EMF, or duty of a supply.",
    ports=(Port("on", (NodeKind.ROTATION,)),),
    parameters=(
        _CONSTANT, _EMF, _RESISTANCE, _CURRENT_LIMIT, _VOLTAGE_LIMIT, _DUTY_LIMIT, _SUPPLY,
    ),
    anatomy=_anatomy,
    required=("torque_constant",),
    source="Leonhard, Control of Electrical Drives, Springer 2001",
)  # fmt: skip
