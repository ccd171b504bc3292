"""The places of the kernel where effects act, here with nothing in them.

`assembly` replaces these functions with chains of the registered effects' own. `P` points
at the parameters, `S` at measured signals, flags of the hooks and effects' states; the first
argument is what an effect changes, the rest is what it may look at: voltage, position and
velocity of the carriage, time. Names are those of the knee's hooks where an effect may serve both:
`current` is what the drive is told, here in V. Units SI.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eha_bench.plants.compiled import njit

Vector = NDArray[np.float64]

# one signature is much like another: compact, they can be compared
# fmt: off


@njit()
def command(value: float, k: int, t: float, h: float, times: Vector, commands: Vector, P: Vector,
        S: Vector) -> float:
    """Mean of the voltage that reaches the drive over [t, t + h], V."""
    return value


@njit()
def asked_voltage(value: float, current: float, x: float, v: float, t: float, P: Vector,
        S: Vector) -> float:
    """Voltage that the drive is asked for, and that is logged as `voltage`, V."""
    return value


@njit()
def drive_command(demand: float, current: float, x: float, v: float, t: float, P: Vector,
        S: Vector) -> float:
    """Voltage that the drive makes of the limited command, before its dynamics, V."""
    return demand


@njit()
def drive_current(current: float, t: float, P: Vector, S: Vector) -> float:
    """Voltage that acts, V."""
    return current


@njit()
def motor_force(force: float, current: float, x: float, v: float, t: float, P: Vector,
        S: Vector) -> float:
    """Force of the motor on the carriage, N."""
    return force


@njit()
def rod_dry(level: float, direction: float, current: float, x: float, v: float, t: float,
        P: Vector, S: Vector) -> float:
    """Dry friction of the carriage for motion in `direction` (+1 or -1), N, never negative."""
    return level


@njit()
def rod_sticks(level: float, P: Vector, S: Vector) -> float:
    """The part of the dry friction that sticks at rest, N."""
    return level


@njit()
def rod_viscous(coefficient: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """Viscous friction coefficient of the carriage, N*s/m."""
    return coefficient


@njit()
def rod_force(force: float, level: float, current: float, x: float, v: float, t: float, P: Vector,
        S: Vector) -> float:
    """Sum of all forces on the carriage but what sticks, N; `level`: dry friction."""
    return force


@njit()
def measured_position(value: float, current: float, x: float, v: float, t: float, P: Vector,
        S: Vector) -> float:
    """What the position sensor reads, m."""
    return value


@njit()
def measured_velocity(value: float, current: float, x: float, v: float, t: float, P: Vector,
        S: Vector) -> float:
    """What the velocity sensor reads, m/s."""
    return value


@njit()
def initial_position(position: float, v: float, P: Vector, S: Vector) -> float:
    """Position of the carriage where its sensor reads `position` at velocity `v`, m."""
    return position


@njit()
def start_states(current: float, x: float, v: float, P: Vector, S: Vector) -> None:
    """Set the effects' own states at the first sample."""


@njit()
def advance_states(h: float, current: float, x: float, v: float, t: float, P: Vector,
        S: Vector) -> None:
    """Move the effects' own states on by a time h; `current` is what the drive is asked for."""


@njit()
def activate(P: Vector, S: Vector) -> None:
    """Note in S which hooks have an effect that is on; called before all others."""


@njit()
def pointer(vector: Vector) -> Vector:
    """The vector as a bare pointer: `P` of the parameters, `S` of the memory."""
    return vector
