"""A curve learned from data: what is missing where no known effect explains it.

A piecewise linear curve f(u) of one variable u, through `values` at evenly spaced knots from `low`
to `high`, constant outside; with a `period` the knots go once round it instead. It acts in one
balance (`equation`), as `form` says:

* `additive`: f is added: N*m to the shaft's torque, m^3/s to a flow, N to the rod's force, A (or V)
  to the drive, or its own unit to what a sensor reads.
* `gain`: multiplied by 1 + f: the motor's torque or the drive's current (actuation), the pump's or
  rod's dry friction (torque, force), the pump's flow (flow), what a sensor reads (measurement).
* `friction`: f is added to the dry friction of pump (torque) or rod (force), which stays >= 0.

`place` says where in the balance: into chamber_a, chamber_b or from a to b (`a_to_b`); in the
`drive`, where the current sensor (or the logged voltage) sees it, or in the `motor`, where nothing
does; or which sensor, or `pressures` for both of those alike (they share supply and amplifier).

Source: de Boor, A Practical Guide to Splines, Springer 2001 (broken lines).
"""

from __future__ import annotations

import math

from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.effects import _learned_drive
from eha_bench.plants.effects._curve import KNOTS, knee_value
from eha_bench.plants.effects._types import Vector
from eha_bench.plants.parameter import Parameter, choice

EQUATIONS = ("torque", "flow", "force", "actuation", "measurement")
FORMS = ("additive", "gain", "friction")
VARIABLES = (
    "time", "motor_speed", "pressure_difference", "pressure_a", "pressure_b", "pressure_sum",
    "piston_position", "piston_velocity", "current", "current_command", "shaft_angle", "force",
    "oil_temperature", "voltage",
)  # fmt: skip
PLACES = (
    "motor", "drive", "a_to_b", "chamber_a", "chamber_b", "current", "motor_speed", "pressure_a",
    "pressure_b", "piston_position", "piston_velocity", "pressures",
)  # fmt: skip

_TORQUE, _FLOW, _FORCE, _ACTUATION, _MEASUREMENT = range(5)
_ADDITIVE, _GAIN, _FRICTION = range(3)
_MOTOR, _DRIVE, _A_TO_B, _CHAMBER_A, _CHAMBER_B = range(5)
_FIRST_SENSOR = 5
_BOTH_PRESSURES = 11


def drive(
    demand: float, current: float, omega: float, theta: float, p_a: float, p_b: float,
    x: float, v: float, t: float, measured_force: float, oil_temperature: float,
    demanded_current: float, equation: float, form: float, variable: float, place: float,
    period: float, low: float, high: float, scale: float, values: Vector,
) -> float:  # fmt: skip
    """Return the drive's current with the curve added or as a gain, A."""
    if equation != _ACTUATION or place != _DRIVE:
        return demand
    f = knee_value(
        variable, current, omega, theta, p_a, p_b, x, v, t, measured_force, oil_temperature,
        demanded_current, period, low, high, scale, values,
    )  # fmt: skip
    return demand * (1.0 + f) if form == _GAIN else demand + f


def motor(
    torque: float, torque_constant: float, current: float, omega: float, theta: float,
    p_a: float, p_b: float, x: float, v: float, t: float, measured_force: float,
    oil_temperature: float, demanded_current: float, equation: float, form: float,
    variable: float, place: float, period: float, low: float, high: float, scale: float,
    values: Vector,
) -> float:  # fmt: skip
    """Return the motor's torque with the curve as a current or as a gain, N*m."""
    if equation != _ACTUATION or place == _DRIVE:
        return torque
    f = knee_value(
        variable, current, omega, theta, p_a, p_b, x, v, t, measured_force, oil_temperature,
        demanded_current, period, low, high, scale, values,
    )  # fmt: skip
    return torque * (1.0 + f) if form == _GAIN else torque + torque_constant * f


def shaft(
    torque: float, current: float, omega: float, theta: float, p_a: float, p_b: float,
    x: float, v: float, t: float, measured_force: float, oil_temperature: float,
    demanded_current: float, equation: float, form: float, variable: float, place: float,
    period: float, low: float, high: float, scale: float, values: Vector,
) -> float:  # fmt: skip
    """Return the shaft's torque with the curve added, N*m."""
    if equation != _TORQUE or form != _ADDITIVE:
        return torque
    f = knee_value(
        variable, current, omega, theta, p_a, p_b, x, v, t, measured_force, oil_temperature,
        demanded_current, period, low, high, scale, values,
    )  # fmt: skip
    return torque + f


def pump_level(
    level: float, direction: float, current: float, omega: float, theta: float, p_a: float,
    p_b: float, x: float, v: float, t: float, measured_force: float, oil_temperature: float,
    demanded_current: float, equation: float, form: float, variable: float, place: float,
    period: float, low: float, high: float, scale: float, values: Vector,
) -> float:  # fmt: skip
    """Return the pump's dry friction with the curve, N*m."""
    if equation != _TORQUE or form == _ADDITIVE:
        return level
    f = knee_value(
        variable, current, omega, theta, p_a, p_b, x, v, t, measured_force, oil_temperature,
        demanded_current, period, low, high, scale, values,
    )  # fmt: skip
    return max(0.0, level * (1.0 + f) if form == _GAIN else level + f)


def delivery(
    flow: float, current: float, omega: float, theta: float, p_a: float, p_b: float, x: float,
    v: float, t: float, measured_force: float, oil_temperature: float, demanded_current: float,
    equation: float, form: float, variable: float, place: float, period: float, low: float,
    high: float, scale: float, values: Vector,
) -> float:  # fmt: skip
    """Return the pump's flow with the curve as a gain, m^3/s."""
    if equation != _FLOW or form != _GAIN:
        return flow
    f = knee_value(
        variable, current, omega, theta, p_a, p_b, x, v, t, measured_force, oil_temperature,
        demanded_current, period, low, high, scale, values,
    )  # fmt: skip
    return flow * (1.0 + f)


def into_a(
    flow: float, current: float, omega: float, theta: float, p_a: float, p_b: float, x: float,
    v: float, t: float, measured_force: float, oil_temperature: float, demanded_current: float,
    equation: float, form: float, variable: float, place: float, period: float, low: float,
    high: float, scale: float, values: Vector,
) -> float:  # fmt: skip
    """Return the flow into chamber A with the curve, m^3/s."""
    if equation != _FLOW or form == _GAIN or place == _CHAMBER_B:
        return flow
    f = knee_value(
        variable, current, omega, theta, p_a, p_b, x, v, t, measured_force, oil_temperature,
        demanded_current, period, low, high, scale, values,
    )  # fmt: skip
    return flow + f if place == _CHAMBER_A else flow - f


def into_b(
    flow: float, current: float, omega: float, theta: float, p_a: float, p_b: float, x: float,
    v: float, t: float, measured_force: float, oil_temperature: float, demanded_current: float,
    equation: float, form: float, variable: float, place: float, period: float, low: float,
    high: float, scale: float, values: Vector,
) -> float:  # fmt: skip
    """Return the flow into chamber B with the curve, m^3/s."""
    if equation != _FLOW or form == _GAIN or place == _CHAMBER_A:
        return flow
    f = knee_value(
        variable, current, omega, theta, p_a, p_b, x, v, t, measured_force, oil_temperature,
        demanded_current, period, low, high, scale, values,
    )  # fmt: skip
    return flow + f


def rod(
    force: float, current: float, omega: float, theta: float, p_a: float, p_b: float, x: float,
    v: float, t: float, measured_force: float, oil_temperature: float, demanded_current: float,
    equation: float, form: float, variable: float, place: float, period: float, low: float,
    high: float, scale: float, values: Vector,
) -> float:  # fmt: skip
    """Return the force on the rod with the curve added, N."""
    if equation != _FORCE or form != _ADDITIVE:
        return force
    f = knee_value(
        variable, current, omega, theta, p_a, p_b, x, v, t, measured_force, oil_temperature,
        demanded_current, period, low, high, scale, values,
    )  # fmt: skip
    return force + f


def rod_level(
    level: float, direction: float, current: float, omega: float, theta: float, p_a: float,
    p_b: float, x: float, v: float, t: float, measured_force: float, oil_temperature: float,
    demanded_current: float, equation: float, form: float, variable: float, place: float,
    period: float, low: float, high: float, scale: float, values: Vector,
) -> float:  # fmt: skip
    """Return the rod's dry friction with the curve, N."""
    if equation != _FORCE or form == _ADDITIVE:
        return level
    f = knee_value(
        variable, current, omega, theta, p_a, p_b, x, v, t, measured_force, oil_temperature,
        demanded_current, period, low, high, scale, values,
    )  # fmt: skip
    return max(0.0, level * (1.0 + f) if form == _GAIN else level + f)


def read_current(
    value: float, current: float, omega: float, theta: float, p_a: float, p_b: float, x: float,
    v: float, t: float, measured_force: float, oil_temperature: float, demanded_current: float,
    equation: float, form: float, variable: float, place: float, period: float, low: float,
    high: float, scale: float, values: Vector,
) -> float:  # fmt: skip
    """Return what the sensor of current reads, with the curve."""
    if equation != _MEASUREMENT or place != _FIRST_SENSOR + 0:
        return value
    f = knee_value(
        variable, current, omega, theta, p_a, p_b, x, v, t, measured_force, oil_temperature,
        demanded_current, period, low, high, scale, values,
    )  # fmt: skip
    return value * (1.0 + f) if form == _GAIN else value + f


def read_motor_speed(
    value: float, current: float, omega: float, theta: float, p_a: float, p_b: float, x: float,
    v: float, t: float, measured_force: float, oil_temperature: float, demanded_current: float,
    equation: float, form: float, variable: float, place: float, period: float, low: float,
    high: float, scale: float, values: Vector,
) -> float:  # fmt: skip
    """Return what the sensor of motor_speed reads, with the curve."""
    if equation != _MEASUREMENT or place != _FIRST_SENSOR + 1:
        return value
    f = knee_value(
        variable, current, omega, theta, p_a, p_b, x, v, t, measured_force, oil_temperature,
        demanded_current, period, low, high, scale, values,
    )  # fmt: skip
    return value * (1.0 + f) if form == _GAIN else value + f


def read_pressure_a(
    value: float, current: float, omega: float, theta: float, p_a: float, p_b: float, x: float,
    v: float, t: float, measured_force: float, oil_temperature: float, demanded_current: float,
    equation: float, form: float, variable: float, place: float, period: float, low: float,
    high: float, scale: float, values: Vector,
) -> float:  # fmt: skip
    """Return what the sensor of pressure_a reads, with the curve."""
    if equation != _MEASUREMENT or place not in (_FIRST_SENSOR + 2, _BOTH_PRESSURES):
        return value
    f = knee_value(
        variable, current, omega, theta, p_a, p_b, x, v, t, measured_force, oil_temperature,
        demanded_current, period, low, high, scale, values,
    )  # fmt: skip
    return value * (1.0 + f) if form == _GAIN else value + f


def read_pressure_b(
    value: float, current: float, omega: float, theta: float, p_a: float, p_b: float, x: float,
    v: float, t: float, measured_force: float, oil_temperature: float, demanded_current: float,
    equation: float, form: float, variable: float, place: float, period: float, low: float,
    high: float, scale: float, values: Vector,
) -> float:  # fmt: skip
    """Return what the sensor of pressure_b reads, with the curve."""
    if equation != _MEASUREMENT or place not in (_FIRST_SENSOR + 3, _BOTH_PRESSURES):
        return value
    f = knee_value(
        variable, current, omega, theta, p_a, p_b, x, v, t, measured_force, oil_temperature,
        demanded_current, period, low, high, scale, values,
    )  # fmt: skip
    return value * (1.0 + f) if form == _GAIN else value + f


def read_piston_position(
    value: float, current: float, omega: float, theta: float, p_a: float, p_b: float, x: float,
    v: float, t: float, measured_force: float, oil_temperature: float, demanded_current: float,
    equation: float, form: float, variable: float, place: float, period: float, low: float,
    high: float, scale: float, values: Vector,
) -> float:  # fmt: skip
    """Return what the sensor of piston_position reads, with the curve."""
    if equation != _MEASUREMENT or place != _FIRST_SENSOR + 4:
        return value
    f = knee_value(
        variable, current, omega, theta, p_a, p_b, x, v, t, measured_force, oil_temperature,
        demanded_current, period, low, high, scale, values,
    )  # fmt: skip
    return value * (1.0 + f) if form == _GAIN else value + f


def read_piston_velocity(
    value: float, current: float, omega: float, theta: float, p_a: float, p_b: float, x: float,
    v: float, t: float, measured_force: float, oil_temperature: float, demanded_current: float,
    equation: float, form: float, variable: float, place: float, period: float, low: float,
    high: float, scale: float, values: Vector,
) -> float:  # fmt: skip
    """Return what the sensor of piston_velocity reads, with the curve."""
    if equation != _MEASUREMENT or place != _FIRST_SENSOR + 5:
        return value
    f = knee_value(
        variable, current, omega, theta, p_a, p_b, x, v, t, measured_force, oil_temperature,
        demanded_current, period, low, high, scale, values,
    )  # fmt: skip
    return value * (1.0 + f) if form == _GAIN else value + f


EFFECT = Effect(
    id="learned",
    summary="A curve learned from data, in the balance and of the variable that data point to.",
    parameters=(
        Parameter("scale", "", 1.0, -10.0, 10.0, source="1: the curve as it was learned"),
        choice("equation", EQUATIONS),
        choice("form", FORMS),
        choice("variable", VARIABLES),
        choice("place", PLACES),
        Parameter(
            "period", "", 0.0, 0.0, 1e6, source="0: none; in the variable's unit", searched=False
        ),
        Parameter(
            "low",
            "",
            0.0,
            -math.inf,
            math.inf,
            source="first knot, as the variable",
            searched=False,
        ),
        Parameter(
            "high",
            "",
            1.0,
            -math.inf,
            math.inf,
            source="last knot, as the variable",
            searched=False,
        ),
        Parameter("values", "", 0.0, -math.inf, math.inf, size=KNOTS, source="SI"),
    ),
    actions={
        "eha_knee": Action(
            Equation.TORQUE,
            {
                "drive_command": drive,
                "motor_torque": motor,
                "shaft_torque": shaft,
                "pump_dry": pump_level,
                "pump_flow": delivery,
                "chamber_flow_a": into_a,
                "chamber_flow_b": into_b,
                "rod_force": rod,
                "rod_dry": rod_level,
                "measured_current": read_current,
                "measured_speed": read_motor_speed,
                "measured_pressure_a": read_pressure_a,
                "measured_pressure_b": read_pressure_b,
                "measured_position": read_piston_position,
                "measured_velocity": read_piston_velocity,
            },
            chosen_by="equation",
            equations={word: Equation(word) for word in EQUATIONS},
            choices={"variable": VARIABLES[:-1]},
        ),
        "linear_drive": Action(
            Equation.FORCE,
            {
                "asked_voltage": _learned_drive.asked,
                "motor_force": _learned_drive.motor,
                "rod_force": _learned_drive.carriage,
                "rod_dry": _learned_drive.level,
                "measured_position": _learned_drive.read_position,
                "measured_velocity": _learned_drive.read_velocity,
            },
            chosen_by="equation",
            equations={word: Equation(word) for word in EQUATIONS},
            choices={
                "equation": ("force", "actuation", "measurement"),
                "variable": ("time", "piston_position", "piston_velocity", "voltage"),
                "place": ("motor", "drive", "piston_position", "piston_velocity"),
            },
        ),
    },
    source="de Boor, A Practical Guide to Splines, Springer 2001",
    separate="run the same command at other speeds, pressures and times: what does it follow?",
    order=3,
)
