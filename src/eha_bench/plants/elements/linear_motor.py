"""A motor that pushes a carriage with a force in proportion to its voltage (or current).

    F = k u

Source: Janot, Gautier, Brunot, Data Set and Reference Models of EMPS, Workshop on Nonlinear System
Identification Benchmarks, 2019.
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

_CONSTANT = Parameter("force_constant", "N/V", 1.0, 1e-9, math.inf, "k", drawn=True)
_LIMIT = Parameter("voltage_limit", "V", UNLIMITED, 1e-6, math.inf, "", "none that matters")


def force(voltage: float, force_constant: float) -> float:
    """Return the force at a voltage, N."""
    return force_constant * voltage


def same(voltage: float) -> float:
    """Return the voltage that acts, V."""
    return voltage


def _anatomy(declared: frozenset[str]) -> Anatomy:
    return Anatomy(
        (_CONSTANT, _LIMIT),
        (Effort("on", force, BalanceSide.DRIVE, "torque"),),
        signals=(HeldSignal("voltage"),),
        inputs=(Input("voltage", "V", True, "voltage"),),
        commands=(Command("voltage", "voltage", "V", "voltage_limit"),),
        quantities=(Quantity("voltage", "V", same, "voltage"),),
    )


KIND = ElementKind(
    id="linear_motor",
    summary="A motor that pushes a carriage in proportion to its voltage.",
    ports=(Port("on", (NodeKind.TRANSLATION,)),),
    parameters=(_CONSTANT, _LIMIT),
    anatomy=_anatomy,
    required=("force_constant",),
    source="Janot, Gautier, Brunot, EMPS, 2019",
)
