"""A curve learned from data: what is missing where no known effect explains it.

A piecewise linear curve f(u) of one variable u, through `values` at evenly spaced knots from `low`
to `high`, constant outside; with a `period` the knots go once round it instead. `at` says where it
acts: on what moves (a node), in a motor or its drive, in a volume, from one chamber of a cylinder
to the other, in a pump, or in a sensor; `form` says how:

* `additive`: f is added: N*m to a shaft, N to a rod, m^3/s to a flow, A to a motor, or its own unit
  to a drive's command and to what a sensor reads.
* `gain`: multiplied by 1 + f: a motor's torque, a drive's command, dry friction, a pump's flow,
  what a sensor reads.
* `friction`: f is added to the dry friction of what moves, which stays >= 0.

Source: de Boor, A Practical Guide to Splines, Springer 2001 (broken lines).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.compiled import njit
from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter, choice

KNOTS = 24
"""Knots of a learned curve."""

FORMS = ("additive", "gain", "friction")
_ADDITIVE, _GAIN, _FRICTION = range(3)


class Curve(NamedTuple):
    """What the curve follows, and its own parameters."""

    u: float
    form: float
    period: float
    low: float
    high: float
    scale: float


@njit()
def curve(u: float, period: float, low: float, high: float, values: FloatArray) -> float:
    """Return the curve at u: evenly spaced knots, once round a period where there is one."""
    n = values.size
    if math.isnan(u):
        return 0.0
    if period > 0.0:
        at = (u / period - math.floor(u / period)) * n
        left = int(at) % n
        right = (left + 1) % n
        share = at - math.floor(at)
    else:
        at = min(1.0, max(0.0, (u - low) / (high - low))) * (n - 1) if high > low else 0.0
        left = min(int(at), n - 2)
        right = left + 1
        share = at - left
    return float(values[left] + share * (values[right] - values[left]))


@njit()
def _curve_value(own: Curve, values: FloatArray) -> float:
    return own.scale * curve(own.u, own.period, own.low, own.high, values)


def balance_with_curve(value: float, own: Curve, values: FloatArray) -> float:
    """Return a balance with the curve added."""
    return value + _curve_value(own, values) if own.form == _ADDITIVE else value


def balance_less_curve(value: float, own: Curve, values: FloatArray) -> float:
    """Return a balance with the curve taken away."""
    return value - _curve_value(own, values) if own.form == _ADDITIVE else value


def signal_with_curve(value: float, own: Curve, values: FloatArray) -> float:
    """Return a command or a reading with the curve added, or as a gain."""
    f = _curve_value(own, values)
    return value * (1.0 + f) if own.form == _GAIN else value + f


def torque(value: float, torque_constant: float, own: Curve, values: FloatArray) -> float:
    """Return a motor's torque with the curve as a current, or as a gain, N*m."""
    f = _curve_value(own, values)
    return value * (1.0 + f) if own.form == _GAIN else value + torque_constant * f


def level(value: float, own: Curve, values: FloatArray) -> float:
    """Return dry friction with the curve, N (or N*m)."""
    if own.form == _ADDITIVE:
        return value
    f = _curve_value(own, values)
    return max(0.0, value * (1.0 + f) if own.form == _GAIN else value + f)


def flow_with_curve(value: float, own: Curve, values: FloatArray) -> float:
    """Return a pump's flow with the curve as a gain, m^3/s."""
    return value * (1.0 + _curve_value(own, values)) if own.form == _GAIN else value


EFFECT = Effect(
    id="learned",
    summary="A curve learned from data, in the balance and of the variable that data point to.",
    parameters=(
        Parameter("scale", "", 1.0, -10.0, 10.0, source="1: the curve as it was learned"),
        choice("form", FORMS),
        choice("variable", ("time",), "what it follows"),
        Parameter(
            "period", "", 0.0, 0.0, 1e6, source="0: none; in the variable's unit", searched=False
        ),
        Parameter(
            "low", "", 0.0, -math.inf, math.inf, source="first knot, as the variable",
            searched=False,
        ),
        Parameter(
            "high", "", 1.0, -math.inf, math.inf, source="last knot, as the variable",
            searched=False,
        ),
        Parameter("values", "", 0.0, -math.inf, math.inf, size=KNOTS, source="SI"),
    ),
    actions={
        "anything": Action(
            {
                "added": balance_with_curve,
                "taken": balance_less_curve,
                "changed": signal_with_curve,
                "torque": torque,
                "level": level,
                "delivered": flow_with_curve,
            }
        )
    },
    source="de Boor, A Practical Guide to Splines, Springer 2001",
    separate="run the same command at other speeds, pressures and times: what does it follow?",
    order=3,
)  # fmt: skip
