"""The learned effect's functions in the knee, see `learned`."""

from __future__ import annotations

from typing import NamedTuple

from eha_bench.plants.compiled import njit
from eha_bench.plants.effects._curve import (
    ACTUATION,
    ADDITIVE,
    CHAMBER_A,
    CHAMBER_B,
    CURRENT,
    DRIVE,
    FLOW,
    FORCE,
    GAIN,
    MEASUREMENT,
    POSITION,
    PRESSURE_A,
    PRESSURE_B,
    PRESSURES,
    SPEED,
    TORQUE,
    VELOCITY,
    Curve,
    changed,
    scaled,
)
from eha_bench.plants.effects._types import Vector


class Seen(NamedTuple):
    """What a curve may follow."""

    current: float
    omega: float
    theta: float
    p_a: float
    p_b: float
    x: float
    v: float
    t: float
    measured_force: float
    oil_temperature: float
    demanded_current: float


@njit()
def _value(seen: Seen, own: Curve, values: Vector) -> float:
    """Return the scaled curve at the variable that it depends on, by learned.VARIABLES."""
    u = seen.t
    if own.variable == 1.0:
        u = seen.omega
    elif own.variable == 2.0:
        u = seen.p_a - seen.p_b
    elif own.variable == 3.0:
        u = seen.p_a
    elif own.variable == 4.0:
        u = seen.p_b
    elif own.variable == 5.0:
        u = seen.p_a + seen.p_b
    elif own.variable == 6.0:
        u = seen.x
    elif own.variable == 7.0:
        u = seen.v
    elif own.variable == 8.0:
        u = seen.current
    elif own.variable == 9.0:
        u = seen.demanded_current
    elif own.variable == 10.0:
        u = seen.theta
    elif own.variable == 11.0:
        u = seen.measured_force
    elif own.variable == 12.0:
        u = seen.oil_temperature
    return scaled(u, own, values)


@njit()
def _read(value: float, sensor: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return what a sensor reads, with the curve where it is this one's."""
    both = own.place == PRESSURES and sensor in (PRESSURE_A, PRESSURE_B)
    if own.equation != MEASUREMENT or (own.place != sensor and not both):
        return value
    return changed(value, _value(seen, own, values), own.form)


def drive(demand: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return the drive's current with the curve added or as a gain, A."""
    if own.equation != ACTUATION or own.place != DRIVE:
        return demand
    return changed(demand, _value(seen, own, values), own.form)


def motor(torque: float, torque_constant: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return the motor's torque with the curve as a current or as a gain, N*m."""
    if own.equation != ACTUATION or own.place == DRIVE:
        return torque
    f = _value(seen, own, values)
    return torque * (1.0 + f) if own.form == GAIN else torque + torque_constant * f


def shaft(torque: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return the shaft's torque with the curve added, N*m."""
    if own.equation != TORQUE or own.form != ADDITIVE:
        return torque
    return torque + _value(seen, own, values)


def pump_level(level: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return the pump's dry friction with the curve, N*m."""
    if own.equation != TORQUE or own.form == ADDITIVE:
        return level
    return max(0.0, changed(level, _value(seen, own, values), own.form))


def delivery(flow: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return the pump's flow with the curve as a gain, m^3/s."""
    if own.equation != FLOW or own.form != GAIN:
        return flow
    return flow * (1.0 + _value(seen, own, values))


def into_a(flow: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return the flow into chamber A with the curve, m^3/s."""
    if own.equation != FLOW or own.form == GAIN or own.place == CHAMBER_B:
        return flow
    f = _value(seen, own, values)
    return flow + f if own.place == CHAMBER_A else flow - f


def into_b(flow: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return the flow into chamber B with the curve, m^3/s."""
    if own.equation != FLOW or own.form == GAIN or own.place == CHAMBER_A:
        return flow
    return flow + _value(seen, own, values)


def rod(force: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return the force on the rod with the curve added, N."""
    if own.equation != FORCE or own.form != ADDITIVE:
        return force
    return force + _value(seen, own, values)


def rod_level(level: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return the rod's dry friction with the curve, N."""
    if own.equation != FORCE or own.form == ADDITIVE:
        return level
    return max(0.0, changed(level, _value(seen, own, values), own.form))


def read_current(value: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return what the sensor of current reads, with the curve, A."""
    return _read(value, CURRENT, seen, own, values)


def read_motor_speed(value: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return what the sensor of motor_speed reads, with the curve, rad/s."""
    return _read(value, SPEED, seen, own, values)


def read_pressure_a(value: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return what the sensor of pressure_a reads, with the curve, Pa."""
    return _read(value, PRESSURE_A, seen, own, values)


def read_pressure_b(value: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return what the sensor of pressure_b reads, with the curve, Pa."""
    return _read(value, PRESSURE_B, seen, own, values)


def read_piston_position(value: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return what the sensor of piston_position reads, with the curve, m."""
    return _read(value, POSITION, seen, own, values)


def read_piston_velocity(value: float, seen: Seen, own: Curve, values: Vector) -> float:
    """Return what the sensor of piston_velocity reads, with the curve, m/s."""
    return _read(value, VELOCITY, seen, own, values)
