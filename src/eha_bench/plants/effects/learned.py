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
from eha_bench.plants.effects import _learned_drive, _learned_knee
from eha_bench.plants.effects._curve import KNOTS
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
                "drive_command": _learned_knee.drive,
                "motor_torque": _learned_knee.motor,
                "shaft_torque": _learned_knee.shaft,
                "pump_dry": _learned_knee.pump_level,
                "pump_flow": _learned_knee.delivery,
                "chamber_flow_a": _learned_knee.into_a,
                "chamber_flow_b": _learned_knee.into_b,
                "rod_force": _learned_knee.rod,
                "rod_dry": _learned_knee.rod_level,
                "measured_current": _learned_knee.read_current,
                "measured_speed": _learned_knee.read_motor_speed,
                "measured_pressure_a": _learned_knee.read_pressure_a,
                "measured_pressure_b": _learned_knee.read_pressure_b,
                "measured_position": _learned_knee.read_piston_position,
                "measured_velocity": _learned_knee.read_piston_velocity,
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
