"""The learned effect's functions in the linear drive, see `learned`."""

from __future__ import annotations

from typing import NamedTuple

from eha_bench.plants.compiled import njit
from eha_bench.plants.effects._curve import (
    ACTUATION,
    ADDITIVE,
    DRIVE,
    FORCE,
    MEASUREMENT,
    POSITION,
    VELOCITY,
    Curve,
    changed,
    scaled,
)
from eha_bench.plants.effects._types import Vector

# places of the variables among learned.VARIABLES
_OF_POSITION, _OF_VELOCITY, _OF_VOLTAGE = 6, 7, 13


class Seen(NamedTuple):
    """What a curve may follow; `current` is the voltage."""

    current: float
    x: float
    v: float
    t: float


@njit()
def _value(seen: Seen, own: Curve, values: Vector) -> float:
    """Return the scaled curve at the variable that it depends on."""
    u = seen.t
    if own.variable == _OF_POSITION:
        u = seen.x
    elif own.variable == _OF_VELOCITY:
        u = seen.v
    elif own.variable == _OF_VOLTAGE:
        u = seen.current
    return scaled(u, own, values)


@njit()
def _read(value: float, sensor: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return what a sensor reads, with the curve where it is this one's."""
    if own.equation != MEASUREMENT or own.place != sensor:
        return value
    return changed(value, _value(seen, own, values), own.form)


def asked(value: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return the voltage that is asked for (and logged) with the curve added or as a gain, V."""
    if own.equation != ACTUATION or own.place != DRIVE:
        return value
    return changed(value, _value(seen, own, values), own.form)


def motor(force: float, force_constant: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return the motor's force with the curve as a voltage or as a gain, N."""
    if own.equation != ACTUATION or own.place == DRIVE:
        return force
    f = _value(seen, own, values)
    return force + force_constant * f if own.form == ADDITIVE else force * (1.0 + f)


def carriage(force: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return the force on the carriage with the curve added, N."""
    if own.equation != FORCE or own.form != ADDITIVE:
        return force
    return force + _value(seen, own, values)


def level(level: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return the carriage's dry friction with the curve, N."""
    if own.equation != FORCE or own.form == ADDITIVE:
        return level
    return max(0.0, changed(level, _value(seen, own, values), own.form))


def read_position(value: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return what the position sensor reads, with the curve, m."""
    return _read(value, POSITION, seen, own, values)


def read_velocity(value: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return what the velocity sensor reads, with the curve, m/s."""
    return _read(value, VELOCITY, seen, own, values)
