"""Compiled equations of the knee EHA: time derivatives of its state, and what its sensors read.

State: shaft speed and angle, both chamber pressures, rod position and velocity (Eq. (2), (4)-(6)
with the corrections of the paper notes: friction opposes motion and sticks, J_pm in every torque
balance)::

    J dw/dt   = K_T i - T_f(w) - D (p_a - p_b)
    T_f       = sign(w) [T_c + (T_s - T_c) exp(-(w/w_s)^2)] + B w ;  at rest any value up to T_s
    dp_a/dt   = beta / (V_10 + A_a x) [ D w - A_a v - L (p_a - p_b) - G (p_a - p_b) ]
    dp_b/dt   = beta / (V_20 - A_b x) [-D w + A_b v + L (p_a - p_b) + G (p_a - p_b) ]
    M dv/dt   = A_a p_a - A_b p_b - B_a v - f_a sign(v) - F_e

with G the bypass conductance while the bypass is open. Places where effects act are the functions
of `hooks`. Where a creep speed v_0 is given, sign(v) is tanh(v / v_0) and nothing sticks: friction
that creeps at rest, as seals do (and the usual regularisation: Quinn, J. Vib. Acoust. 126 (2004)
391, doi:10.1115/1.1760564).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

# assembly: these two imports are replaced, the hooks by the composed ones
from eha_bench.plants.compiled import njit
from eha_bench.plants.eha_knee.hooks import (
    bulk_modulus,
    chamber_flow_a,
    chamber_flow_b,
    conductance_a,
    conductance_ab,
    conductance_b,
    external_load,
    leakage,
    measured_current,
    measured_position,
    measured_pressure_a,
    measured_pressure_b,
    measured_speed,
    measured_velocity,
    motor_torque,
    moving_mass,
    pump_dry,
    pump_flow,
    pump_sticks,
    pump_viscous,
    rod_dry,
    rod_force,
    rod_sticks,
    rod_viscous,
    shaft_torque,
    volume_b,
)

Vector = NDArray[np.float64]

# places in the parameter vector, in the order of parameters.PARAMETERS
(K_T, J, B_PM, T_CF, T_SF, W_S, L_IN, D_P, BETA, V_A, V_B, A_A, A_B, M, B_ROD, F_ROD, F_EXT, I_MAX,
 G_BYPASS, LINK_A, LINK_B, LINK_C0, P_INITIAL, CREEP_ROD, CREEP_PUMP) = range(25)  # fmt: skip

# places in the state vector; CURRENT is what flows, held between ticks
OMEGA, THETA, PRESSURE_A, PRESSURE_B, POSITION, VELOCITY, CURRENT = range(7)

# measured signals at the start of the vector S, in the order of parameters.SIGNALS
FORCE, TEMPERATURE, DEMAND = range(3)

# the volume that is left at the end of the stroke, as a share of the volume at mid-stroke
DEAD_VOLUME = 0.02

_SWITCHES = 0.5
"""Share of a conductance that comes or goes where a valve opens or closes."""


@njit()
def shaft_net(
    level: float,
    i: float,
    omega: float,
    theta: float,
    p_a: float,
    p_b: float,
    x: float,
    v: float,
    t: float,
    P: Vector,
    S: Vector,
) -> float:
    """All torque on the shaft except what sticks of its dry friction, N*m."""
    torque = motor_torque(P[K_T] * i, i, omega, theta, p_a, p_b, x, v, t, P, S)
    torque -= P[D_P] * (p_a - p_b) + pump_viscous(P[B_PM], omega, t, P, S) * omega
    return shaft_torque(torque, level, i, omega, theta, p_a, p_b, x, v, t, P, S)


@njit()
def pump_level(
    direction: float,
    i: float,
    omega: float,
    theta: float,
    p_a: float,
    p_b: float,
    x: float,
    v: float,
    t: float,
    P: Vector,
    S: Vector,
) -> float:
    """Dry friction of the pump in a direction (Stribeck, Eq. (3)), N*m."""
    ratio = omega / P[W_S]
    level = P[T_CF] + (P[T_SF] - P[T_CF]) * math.exp(-ratio * ratio)
    return pump_dry(level, direction, i, omega, theta, p_a, p_b, x, v, t, P, S)


@njit()
def rod_net(
    level: float,
    i: float,
    omega: float,
    theta: float,
    p_a: float,
    p_b: float,
    x: float,
    v: float,
    t: float,
    area: float,
    P: Vector,
    S: Vector,
) -> float:
    """All force on the rod except what sticks of its dry friction, N."""
    total = P[A_A] * p_a - area * p_b - external_load(P[F_EXT] + S[FORCE], x, v, P, S)
    total -= rod_viscous(P[B_ROD], v, t, P, S) * v
    return rod_force(total, level, i, omega, theta, p_a, p_b, x, v, t, P, S)


@njit()
def _volumes(x: float, area: float, P: Vector, S: Vector) -> tuple[float, float]:
    """Volumes of both chambers, m^3, never below the dead volume."""
    v_a = max(P[V_A] + P[A_A] * x, DEAD_VOLUME * P[V_A])
    middle = volume_b(P[V_B], P, S)
    v_b = max(middle - area * x, DEAD_VOLUME * middle)
    return v_a, v_b


@njit()
def _creep(
    level: float, net: float, inertia: float, speed: float, width: float, h: float
) -> tuple[float, float]:
    """Rate of change against friction that creeps, level * tanh(speed / width), and its slope.

    The slope, per inertia in 1/s, is for the implicit step: the steepest that it may meet, at the
    slower of its ends, or at rest where it reverses.
    """
    rate = (net - level * math.tanh(speed / width)) / inertia
    later = speed + h * rate
    slowest = 0.0 if speed * later <= 0.0 else min(abs(speed), abs(later))
    shape = math.tanh(slowest / width)
    return rate, level / (width * inertia) * (1.0 - shape * shape)


@njit()
def rates(
    h: float,
    i: float,
    omega: float,
    theta: float,
    p_a: float,
    p_b: float,
    x: float,
    v: float,
    t: float,
    dir_m: float,
    dir_r: float,
    bypass: float,
    area: float,
    P: Vector,
    S: Vector,
) -> tuple[float, float, float, float, float, float, float, float]:
    """Time derivatives; a direction of 0 means at rest and held.

    Returns:
        dw/dt, dp_a/dt, dp_b/dt, dv/dt, stiffness of both chambers (Pa/m^3), and the slopes of
        creeping friction of shaft and rod (1/s).
    """
    d_omega, s_omega = 0.0, 0.0
    if dir_m != 0.0:
        level = pump_level(dir_m, i, omega, theta, p_a, p_b, x, v, t, P, S)
        net = shaft_net(level, i, omega, theta, p_a, p_b, x, v, t, P, S)
        level = pump_sticks(level, P, S)
        if P[CREEP_PUMP] > 0.0:
            d_omega, s_omega = _creep(level, net, P[J], omega, P[CREEP_PUMP], h)
        else:
            d_omega = (net - dir_m * level) / P[J]
    difference = p_a - p_b
    q_ab = (leakage(P[L_IN], t, P, S) + bypass) * difference
    q_pump = pump_flow(P[D_P] * omega, i, omega, theta, p_a, p_b, x, v, t, P, S)
    v_a, v_b = _volumes(x, area, P, S)
    c_a = bulk_modulus(P[BETA], p_a, P, S) / v_a
    c_b = bulk_modulus(P[BETA], p_b, P, S) / v_b
    q_a = q_pump - P[A_A] * v - q_ab
    q_b = area * v - q_pump + q_ab
    d_a = c_a * chamber_flow_a(q_a, i, omega, theta, p_a, p_b, x, v, t, P, S)
    d_b = c_b * chamber_flow_b(q_b, i, omega, theta, p_a, p_b, x, v, t, P, S)
    d_v, s_v = 0.0, 0.0
    if dir_r != 0.0:
        mass = moving_mass(P[M], P, S)
        level = rod_dry(P[F_ROD], dir_r, i, omega, theta, p_a, p_b, x, v, t, P, S)
        net = rod_net(level, i, omega, theta, p_a, p_b, x, v, t, area, P, S)
        level = rod_sticks(level, P, S)
        if P[CREEP_ROD] > 0.0:
            d_v, s_v = _creep(level, net, mass, v, P[CREEP_ROD], h)
        else:
            d_v = (net - dir_r * level) / mass
    return d_omega, d_a, d_b, d_v, c_a, c_b, s_omega, s_v


@njit()
def _direction(speed: float, net: float, level_up: float, level_down: float) -> float:
    """Direction of motion: of the speed, or at rest of what breaks away, or 0 where it sticks."""
    if speed > 0.0:
        return 1.0
    if speed < 0.0:
        return -1.0
    if net > level_up:
        return 1.0
    if net < -level_down:
        return -1.0
    return 0.0


@njit()
def shaft_direction(
    i: float,
    omega: float,
    theta: float,
    p_a: float,
    p_b: float,
    x: float,
    v: float,
    t: float,
    P: Vector,
    S: Vector,
) -> float:
    """Direction in which the shaft turns or breaks away; 0 where it sticks."""
    if omega != 0.0:
        return 1.0 if omega > 0.0 else -1.0
    up = pump_level(1.0, i, 0.0, theta, p_a, p_b, x, v, t, P, S)
    down = pump_level(-1.0, i, 0.0, theta, p_a, p_b, x, v, t, P, S)
    net = shaft_net(up, i, 0.0, theta, p_a, p_b, x, v, t, P, S)
    if P[CREEP_PUMP] > 0.0:
        return 1.0 if net >= 0.0 else -1.0
    return _direction(0.0, net, pump_sticks(up, P, S), pump_sticks(down, P, S))


@njit()
def rod_direction(
    i: float,
    omega: float,
    theta: float,
    p_a: float,
    p_b: float,
    x: float,
    v: float,
    t: float,
    area: float,
    P: Vector,
    S: Vector,
) -> float:
    """Direction in which the rod moves or breaks away; 0 where it sticks."""
    if v != 0.0:
        return 1.0 if v > 0.0 else -1.0
    up = rod_dry(P[F_ROD], 1.0, i, omega, theta, p_a, p_b, x, 0.0, t, P, S)
    down = rod_dry(P[F_ROD], -1.0, i, omega, theta, p_a, p_b, x, 0.0, t, P, S)
    net = rod_net(up, i, omega, theta, p_a, p_b, x, 0.0, t, area, P, S)
    if P[CREEP_ROD] > 0.0:
        return 1.0 if net >= 0.0 else -1.0
    return _direction(0.0, net, rod_sticks(up, P, S), rod_sticks(down, P, S))


@njit()
def _switches(before: float, after: float) -> bool:
    """Whether a conductance comes or goes as that of a valve that opens or closes."""
    return abs(after - before) > _SWITCHES * max(before, after)


@njit()
def valves_switch(
    a0: float, b0: float, a1: float, b1: float, bypass: float, P: Vector, S: Vector
) -> bool:
    """Whether any conductance differs as by a valve between two pairs of pressures."""
    g_ab = P[L_IN] + bypass
    return (
        _switches(conductance_a(0.0, a0, b0, P, S), conductance_a(0.0, a1, b1, P, S))
        or _switches(conductance_b(0.0, a0, b0, P, S), conductance_b(0.0, a1, b1, P, S))
        or _switches(conductance_ab(g_ab, a0, b0, P, S), conductance_ab(g_ab, a1, b1, P, S))
    )


@njit()
def measure(t: float, P: Vector, S: Vector, Y: Vector, out: Vector) -> None:
    """Write what the sensors read (without noise) into a row: i, w, p_a, p_b, x, v."""
    omega, theta, p_a, p_b, x, v, i = Y[0], Y[1], Y[2], Y[3], Y[4], Y[5], Y[6]
    out[0] = measured_current(i, i, omega, theta, p_a, p_b, x, v, t, P, S)
    out[1] = measured_speed(omega, i, omega, theta, p_a, p_b, x, v, t, P, S)
    out[2] = measured_pressure_a(p_a, i, omega, theta, p_a, p_b, x, v, t, P, S)
    out[3] = measured_pressure_b(p_b, i, omega, theta, p_a, p_b, x, v, t, P, S)
    out[4] = measured_position(x, i, omega, theta, p_a, p_b, x, v, t, P, S)
    out[5] = measured_velocity(v, i, omega, theta, p_a, p_b, x, v, t, P, S)
