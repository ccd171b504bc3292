"""The places of the kernel where effects act, here with nothing in them.

`assembly` replaces these functions with chains of the registered effects' own. `P` points
at the parameters, `S` at measured signals, flags of the hooks and effects' states; the first
argument is what an effect changes, the rest is what it may look at: current, shaft speed and
angle, chamber pressures, rod position and velocity, time. Units SI.
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
    """Mean of the command that reaches the drive over [t, t + h], A."""
    return value


@njit()
def drive_command(demand: float, current: float, omega: float, theta: float, p_a: float,
        p_b: float, x: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """Current that the drive makes of the limited command, before its dynamics, A."""
    return demand


@njit()
def drive_current(current: float, t: float, P: Vector, S: Vector) -> float:
    """Current that flows, A."""
    return current


@njit()
def motor_torque(torque: float, current: float, omega: float, theta: float, p_a: float, p_b: float,
        x: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """Torque of the motor on the shaft, N*m."""
    return torque


@njit()
def shaft_torque(torque: float, level: float, current: float, omega: float, theta: float,
        p_a: float, p_b: float, x: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """Sum of all torques on the shaft but what sticks, N*m; `level`: dry friction."""
    return torque


@njit()
def pump_dry(level: float, direction: float, current: float, omega: float, theta: float,
        p_a: float, p_b: float, x: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """Dry friction of the pump for motion in `direction` (+1 or -1), N*m, never negative."""
    return level


@njit()
def pump_sticks(level: float, P: Vector, S: Vector) -> float:
    """The part of the pump's dry friction that sticks at rest, N*m."""
    return level


@njit()
def pump_viscous(coefficient: float, omega: float, t: float, P: Vector, S: Vector) -> float:
    """Viscous friction coefficient of the pump, N*m*s/rad."""
    return coefficient


@njit()
def pump_flow(flow: float, current: float, omega: float, theta: float, p_a: float, p_b: float,
        x: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """Flow that the pump moves from B to A, m^3/s."""
    return flow


@njit()
def leakage(coefficient: float, t: float, P: Vector, S: Vector) -> float:
    """Internal leakage coefficient, m^3/(s*Pa)."""
    return coefficient


@njit()
def bulk_modulus(modulus: float, pressure: float, P: Vector, S: Vector) -> float:
    """Effective bulk modulus of one chamber, Pa."""
    return modulus


@njit()
def chamber_flow_a(flow: float, current: float, omega: float, theta: float, p_a: float, p_b: float,
        x: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """Sum of all flows into chamber A, m^3/s."""
    return flow


@njit()
def chamber_flow_b(flow: float, current: float, omega: float, theta: float, p_a: float, p_b: float,
        x: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """Sum of all flows into chamber B, m^3/s."""
    return flow


@njit()
def conductance_a(value: float, p_a: float, p_b: float, P: Vector, S: Vector) -> float:
    """-d(chamber_flow_a)/d(p_a), m^3/(s*Pa): tells the integrator what is stiff."""
    return value


@njit()
def conductance_b(value: float, p_a: float, p_b: float, P: Vector, S: Vector) -> float:
    """-d(chamber_flow_b)/d(p_b), m^3/(s*Pa)."""
    return value


@njit()
def conductance_ab(value: float, p_a: float, p_b: float, P: Vector, S: Vector) -> float:
    """Slope of the flow from A to B against P1 - P2, m^3/(s*Pa)."""
    return value


@njit()
def rod_dry(level: float, direction: float, current: float, omega: float, theta: float, p_a: float,
        p_b: float, x: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """Dry friction of rod and load for motion in `direction`, N, never negative."""
    return level


@njit()
def rod_sticks(level: float, P: Vector, S: Vector) -> float:
    """The part of the rod's dry friction that sticks at rest, N."""
    return level


@njit()
def rod_viscous(coefficient: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """Viscous friction coefficient of the rod, N*s/m."""
    return coefficient


@njit()
def external_load(load: float, x: float, v: float, P: Vector, S: Vector) -> float:
    """Force of the load on the rod (positive against extension), N."""
    return load


@njit()
def rod_force(force: float, level: float, current: float, omega: float, theta: float, p_a: float,
        p_b: float, x: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """Sum of all forces on the rod but what sticks (positive extends), N; `level`: dry friction."""
    return force


@njit()
def moving_mass(mass: float, P: Vector, S: Vector) -> float:
    """Mass that moves with the rod, kg."""
    return mass


@njit()
def volume_b(volume: float, P: Vector, S: Vector) -> float:
    """Volume of chamber B at mid-stroke, m^3."""
    return volume


@njit()
def area_b(area: float, P: Vector, S: Vector) -> float:
    """Piston area on the side of chamber B, m^2."""
    return area


@njit()
def measured_current(value: float, current: float, omega: float, theta: float, p_a: float,
        p_b: float, x: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """What the current sensor reads, A."""
    return value


@njit()
def measured_speed(value: float, current: float, omega: float, theta: float, p_a: float,
        p_b: float, x: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """What the speed sensor reads, rad/s."""
    return value


@njit()
def measured_pressure_a(value: float, current: float, omega: float, theta: float, p_a: float,
        p_b: float, x: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """What the sensor of chamber A reads, Pa."""
    return value


@njit()
def measured_pressure_b(value: float, current: float, omega: float, theta: float, p_a: float,
        p_b: float, x: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """What the sensor of chamber B reads, Pa."""
    return value


@njit()
def measured_position(value: float, current: float, omega: float, theta: float, p_a: float,
        p_b: float, x: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """What the position sensor reads, m."""
    return value


@njit()
def measured_velocity(value: float, current: float, omega: float, theta: float, p_a: float,
        p_b: float, x: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """What the velocity sensor reads, m/s."""
    return value


@njit()
def initial_pressure_a(pressure: float, P: Vector, S: Vector) -> float:
    """Pressure in chamber A where its sensor reads `pressure`, Pa."""
    return pressure


@njit()
def initial_pressure_b(pressure: float, P: Vector, S: Vector) -> float:
    """Pressure in chamber B where its sensor reads `pressure`, Pa."""
    return pressure


@njit()
def initial_position(position: float, v: float, P: Vector, S: Vector) -> float:
    """Rod position where its sensor reads `position` at velocity `v`, m."""
    return position


@njit()
def longest_step(h: float, locked: bool, P: Vector, S: Vector) -> float:
    """Longest step of the integration, s, while the rod is locked or not."""
    return h


@njit()
def start_states(current: float, omega: float, theta: float, p_a: float, p_b: float, x: float,
        v: float, P: Vector, S: Vector) -> None:
    """Set the effects' own states at the first sample."""


@njit()
def advance_states(h: float, current: float, omega: float, theta: float, p_a: float, p_b: float,
        x: float, v: float, t: float, P: Vector, S: Vector) -> None:
    """Move the effects' own states on by a time h; `current` is what the drive is asked for."""


@njit()
def activate(P: Vector, S: Vector) -> None:
    """Note in S which hooks have an effect that is on; called before all others."""


@njit()
def pointer(vector: Vector) -> Vector:
    """The vector as a bare pointer: `P` of the parameters, `S` of the memory."""
    return vector
