"""The position loop inside a drive or a smart servo, which sets the command of its motor.

    u = k_v (k_p (r - y) - v) + added      cascaded: `position_gain` k_p, `velocity_gain` k_v
    u = P (r - y) - D v + added            `proportional` P, `derivative` D

once a `period` T; y is what the position's sensor reads, v the mean slope of its last three
readings, (y - y_2) / (2 T). A smart servo holds its last reference.

Source: Janot, Gautier, Brunot, Data Set and Reference Models of EMPS, Workshop on Nonlinear System
Identification Benchmarks, 2019 (cascaded; its velocity is not published: this one reproduces the
logged voltage from the logged positions to 4 mV RMS, the difference of the last two readings, or of
the first and the last of four, to 50 mV).
"""

from __future__ import annotations

import math

from eha_bench.plants.network.element import (
    MECHANICAL,
    Anatomy,
    ElementKind,
    HeldSignal,
    Input,
    Loop,
    Port,
)
from eha_bench.plants.parameter import Parameter

_INF = math.inf
_KP = Parameter("position_gain", "1/s", 100.0, 0.0, _INF, "k_p")
_KV = Parameter("velocity_gain", "{command}/{speed}", 100.0, 0.0, _INF, "k_v")
_P = Parameter("proportional", "{command}/{position}", 1.0, 0.0, _INF, "P")
_D = Parameter("derivative", "{command}/{speed}", 0.0, 0.0, _INF, "D")
_PERIOD = Parameter("period", "s", 1e-3, 1e-6, 1.0, "T")


def cascade_command(
    reference: float, reading: float, speed: float, position_gain: float, velocity_gain: float
) -> float:
    """Return the command of a position loop around a velocity loop, in the motor's unit."""
    return velocity_gain * (position_gain * (reference - reading) - speed)


def parallel_command(
    reference: float, reading: float, speed: float, proportional: float, derivative: float
) -> float:
    """Return the command of a proportional and derivative controller, in the motor's unit."""
    return proportional * (reference - reading) - derivative * speed


def _anatomy(declared: frozenset[str]) -> Anatomy:
    cascade = bool({"position_gain", "velocity_gain"} & declared)
    gains = (_KP, _KV) if cascade else (_P, _D)
    return Anatomy(
        (*gains, _PERIOD),
        signals=(HeldSignal("reference"), HeldSignal("added")),
        inputs=(
            Input("reference", "{position}", False, "reference"),
            Input("added", "{command}", True, "added"),
        ),
        loop=Loop(
            "motor",
            "on",
            "reference",
            "added",
            "period",
            cascade_command if cascade else parallel_command,
        ),
    )


KIND = ElementKind(
    id="position_servo",
    summary="The position loop inside a drive, which sets its motor's command.",
    ports=(Port("on", MECHANICAL),),
    parameters=(_KP, _KV, _P, _D, _PERIOD),
    anatomy=_anatomy,
    refers=("motor",),
    source="Janot, Gautier, Brunot, EMPS, 2019",
)
