"""The learned effect's functions in the linear drive, see `learned`."""

from __future__ import annotations

from eha_bench.plants.compiled import njit
from eha_bench.plants.effects._curve import curve
from eha_bench.plants.effects._types import Vector

# places of the words in learned.EQUATIONS, FORMS, VARIABLES and PLACES
_FORCE, _ACTUATION, _MEASUREMENT = 2, 3, 4
_ADDITIVE, _GAIN = 0, 1
_POSITION, _VELOCITY, _VOLTAGE = 6, 7, 13
_DRIVE, _READ_POSITION, _READ_VELOCITY = 1, 9, 10


@njit()
def _value(
    variable: float, current: float, x: float, v: float, t: float, period: float, low: float,
    high: float, scale: float, values: Vector,
) -> float:  # fmt: skip
    """Return the scaled curve at the variable that it depends on."""
    u = t
    if variable == _POSITION:
        u = x
    elif variable == _VELOCITY:
        u = v
    elif variable == _VOLTAGE:
        u = current
    return scale * curve(u, period, low, high, values)


def asked(
    value: float, current: float, x: float, v: float, t: float, equation: float, form: float,
    variable: float, place: float, period: float, low: float, high: float, scale: float,
    values: Vector,
) -> float:  # fmt: skip
    """Return the voltage that is asked for (and logged) with the curve added or as a gain, V."""
    if equation != _ACTUATION or place != _DRIVE:
        return value
    f = _value(variable, current, x, v, t, period, low, high, scale, values)
    return value * (1.0 + f) if form == _GAIN else value + f


def motor(
    force: float, force_constant: float, current: float, x: float, v: float, t: float,
    equation: float, form: float, variable: float, place: float, period: float, low: float,
    high: float, scale: float, values: Vector,
) -> float:  # fmt: skip
    """Return the motor's force with the curve as a voltage or as a gain, N."""
    if equation != _ACTUATION or place == _DRIVE:
        return force
    f = _value(variable, current, x, v, t, period, low, high, scale, values)
    return force * (1.0 + f) if form == _GAIN else force + force_constant * f


def carriage(
    force: float, current: float, x: float, v: float, t: float, equation: float, form: float,
    variable: float, place: float, period: float, low: float, high: float, scale: float,
    values: Vector,
) -> float:  # fmt: skip
    """Return the force on the carriage with the curve added, N."""
    if equation != _FORCE or form != _ADDITIVE:
        return force
    f = _value(variable, current, x, v, t, period, low, high, scale, values)
    return force + f


def level(
    level: float, current: float, x: float, v: float, t: float, equation: float, form: float,
    variable: float, place: float, period: float, low: float, high: float, scale: float,
    values: Vector,
) -> float:  # fmt: skip
    """Return the carriage's dry friction with the curve, N."""
    if equation != _FORCE or form == _ADDITIVE:
        return level
    f = _value(variable, current, x, v, t, period, low, high, scale, values)
    return max(0.0, level * (1.0 + f) if form == _GAIN else level + f)


def read_position(
    value: float, current: float, x: float, v: float, t: float, equation: float, form: float,
    variable: float, place: float, period: float, low: float, high: float, scale: float,
    values: Vector,
) -> float:  # fmt: skip
    """Return what the position sensor reads, with the curve, m."""
    if equation != _MEASUREMENT or place != _READ_POSITION:
        return value
    f = _value(variable, current, x, v, t, period, low, high, scale, values)
    return value * (1.0 + f) if form == _GAIN else value + f


def read_velocity(
    value: float, current: float, x: float, v: float, t: float, equation: float, form: float,
    variable: float, place: float, period: float, low: float, high: float, scale: float,
    values: Vector,
) -> float:  # fmt: skip
    """Return what the velocity sensor reads, with the curve, m/s."""
    if equation != _MEASUREMENT or place != _READ_VELOCITY:
        return value
    f = _value(variable, current, x, v, t, period, low, high, scale, values)
    return value * (1.0 + f) if form == _GAIN else value + f
