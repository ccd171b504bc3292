"""Compiled equations of the knee EHA and their integrator.

State: shaft speed and angle, both chamber pressures, rod position and velocity (Eq. (2), (4)-(6)
with the corrections of the paper notes: friction opposes motion and sticks, J_pm in every torque
balance)::

    J dw/dt   = K_T i - T_f(w) - D (p_a - p_b)
    T_f       = sign(w) [T_c + (T_s - T_c) exp(-(w/w_s)^2)] + B w ;  at rest any value up to T_s
    dp_a/dt   = beta / (V_10 + A_a x) [ D w - A_a v - L (p_a - p_b) - G (p_a - p_b) ]
    dp_b/dt   = beta / (V_20 - A_b x) [-D w + A_b v + L (p_a - p_b) + G (p_a - p_b) ]
    M dv/dt   = A_a p_a - A_b p_b - B_a v - f_a sign(v) - F_e

with G the bypass conductance while the bypass is open. Places where effects act are the functions
of `hooks`.

Integrator: ROS2 (Verwer, Spee, Blom, Hundsdorfer, SIAM J. Sci. Comput. 20 (1999) 1456,
doi:10.1137/S1064827597326651), a two-stage Rosenbrock W-method: second order with any matrix in
place of the Jacobian, L-stable where that matrix holds what is stiff. Only the 2x2 pressure block
is stiff (an open bypass or check valve reaches 10-20 us), so only that block is treated
implicitly; all else becomes Heun's method. Within a step, the instants at which shaft or rod stop
are located and the step is split there, so friction reverses and sticks at the right time.

Step: 25 us. The fastest non-stiff mode is the load on the oil spring, about 500 rad/s; the local
error there is (500 * 25e-6)^3 / 6 = 3e-7, and the global error stays below 1e-4 of the range, which
a test holds against SciPy's implicit solver.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

# assembly: the next import is replaced by the composed hooks
from eha_bench.plants.eha_knee.hooks import (
    advance_states,
    area_b,
    bulk_modulus,
    chamber_flow_a,
    chamber_flow_b,
    command,
    conductance_a,
    conductance_ab,
    conductance_b,
    drive_current,
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
    pump_viscous,
    rod_dry,
    rod_force,
    rod_sticks,
    rod_viscous,
    shaft_torque,
    start_states,
)

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

# places in the parameter vector, in the order of parameters.PARAMETERS
(K_T, J, B_PM, T_CF, T_SF, W_S, L_IN, D_P, BETA, V_A, V_B, A_A, A_B, M, B_ROD, F_ROD, F_EXT, I_MAX,
 G_BYPASS, LINK_A, LINK_B, LINK_C0, P_INITIAL) = range(23)  # fmt: skip

# places in the state vector; CURRENT is what flows, held between ticks
OMEGA, THETA, PRESSURE_A, PRESSURE_B, POSITION, VELOCITY, CURRENT = range(7)

# channels that may be imposed instead of computed
IMPOSE_SPEED, IMPOSE_A, IMPOSE_B, IMPOSE_POSITION, IMPOSE_VELOCITY = range(5)

_GAMMA = 1.0 - 1.0 / math.sqrt(2.0)
_MAX_SPLITS = 8
# the volume that is left at the end of the stroke, as a share of the volume at mid-stroke
_DEAD_VOLUME = 0.02


@njit
def _shaft_net(i, omega, theta, p_a, p_b, t, P, S):  # type: ignore[no-untyped-def]
    """All torque on the shaft except dry friction, N*m."""
    torque = motor_torque(P[K_T] * i, i, t, P, S)
    torque -= P[D_P] * (p_a - p_b) + pump_viscous(P[B_PM], omega, t, P, S) * omega
    return shaft_torque(torque, omega, theta, p_a, p_b, t, P, S)


@njit
def _pump_level(direction, omega, p_a, p_b, t, P, S):  # type: ignore[no-untyped-def]
    """Dry friction of the pump in a direction (Stribeck, Eq. (3)), N*m."""
    ratio = omega / P[W_S]
    level = P[T_CF] + (P[T_SF] - P[T_CF]) * math.exp(-ratio * ratio)
    return pump_dry(level, direction, omega, p_a, p_b, t, P, S)


@njit
def _rod_net(level, x, v, p_a, p_b, force, t, area, P, S):  # type: ignore[no-untyped-def]
    """All force on the rod except dry friction, N."""
    total = P[A_A] * p_a - area * p_b - P[F_EXT] - force
    total -= rod_viscous(P[B_ROD], v, t, P, S) * v
    return rod_force(total, level, x, v, p_a, p_b, t, P, S)


@njit
def _volumes(x, area, P):  # type: ignore[no-untyped-def]
    """Volumes of both chambers, m^3, never below the dead volume."""
    v_a = max(P[V_A] + P[A_A] * x, _DEAD_VOLUME * P[V_A])
    v_b = max(P[V_B] - area * x, _DEAD_VOLUME * P[V_B])
    return v_a, v_b


@njit
def _rates(omega, theta, p_a, p_b, x, v, i, force, t, dir_m, dir_r, bypass, area, P, S):  # type: ignore[no-untyped-def]
    """Time derivatives; a direction of 0 means at rest and held."""
    if dir_m == 0.0:
        d_omega = 0.0
    else:
        net = _shaft_net(i, omega, theta, p_a, p_b, t, P, S)
        d_omega = (net - dir_m * _pump_level(dir_m, omega, p_a, p_b, t, P, S)) / P[J]
    difference = p_a - p_b
    q_ab = (P[L_IN] + bypass) * difference
    q_pump = pump_flow(P[D_P] * omega, omega, theta, t, P, S)
    v_a, v_b = _volumes(x, area, P)
    c_a = bulk_modulus(P[BETA], p_a, P, S) / v_a
    c_b = bulk_modulus(P[BETA], p_b, P, S) / v_b
    d_a = c_a * chamber_flow_a(q_pump - P[A_A] * v - q_ab, p_a, p_b, omega, t, P, S)
    d_b = c_b * chamber_flow_b(area * v - q_pump + q_ab, p_a, p_b, omega, t, P, S)
    if dir_r == 0.0:
        d_v = 0.0
    else:
        level = rod_dry(P[F_ROD], dir_r, x, v, p_a, p_b, t, P, S)
        net = _rod_net(level, x, v, p_a, p_b, force, t, area, P, S)
        d_v = (net - dir_r * rod_sticks(level, P, S)) / moving_mass(P[M], x, v, P, S)
    return d_omega, d_a, d_b, d_v, c_a, c_b


@njit
def _direction(speed, net, level_up, level_down):  # type: ignore[no-untyped-def]
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


@njit
def _step(h, omega, theta, p_a, p_b, x, v, i, force, t, dir_m, dir_r, bypass, area, P, S):  # type: ignore[no-untyped-def]
    """One ROS2 step with fixed directions of friction."""
    k_w, f_a, f_b, k_v, c_a, c_b = _rates(
        omega, theta, p_a, p_b, x, v, i, force, t, dir_m, dir_r, bypass, area, P, S
    )
    g_ab = conductance_ab(P[L_IN] + bypass, p_a, p_b, P, S)
    g_a = conductance_a(0.0, p_a, p_b, P, S)
    g_b = conductance_b(0.0, p_a, p_b, P, S)
    s = _GAMMA * h
    m_aa = 1.0 + s * c_a * (g_ab + g_a)
    m_ab = -s * c_a * g_ab
    m_ba = -s * c_b * g_ab
    m_bb = 1.0 + s * c_b * (g_ab + g_b)
    det = m_aa * m_bb - m_ab * m_ba
    k_a = (m_bb * f_a - m_ab * f_b) / det
    k_b = (m_aa * f_b - m_ba * f_a) / det
    w1, f_a1, f_b1, v1, _, _ = _rates(
        omega + h * k_w, theta + h * omega, p_a + h * k_a, p_b + h * k_b, x + h * v, v + h * k_v,
        i, force, t + h, dir_m, dir_r, bypass, area, P, S,
    )  # fmt: skip
    r_a = f_a1 - 2.0 * k_a
    r_b = f_b1 - 2.0 * k_b
    l_a = (m_bb * r_a - m_ab * r_b) / det
    l_b = (m_aa * r_b - m_ba * r_a) / det
    return (
        omega + 0.5 * h * (k_w + w1),
        theta + h * (omega + 0.5 * h * k_w),
        p_a + h * (1.5 * k_a + 0.5 * l_a),
        p_b + h * (1.5 * k_b + 0.5 * l_b),
        x + h * (v + 0.5 * h * k_v),
        v + 0.5 * h * (k_v + v1),
    )


@njit
def _substep(h, i, force, t, locked, bypass, impose_speed, impose_rod, area, P, S, Y):  # type: ignore[no-untyped-def]
    """Advance Y by h, split where the shaft or the rod comes to rest."""
    left = h
    x_max = min(P[V_A] / P[A_A], P[V_B] / area) * (1.0 - _DEAD_VOLUME)
    for split in range(_MAX_SPLITS):
        omega, theta, p_a, p_b, x, v = Y[0], Y[1], Y[2], Y[3], Y[4], Y[5]
        dir_m = 0.0
        if not impose_speed:
            if omega != 0.0:
                dir_m = 1.0 if omega > 0.0 else -1.0
            else:
                net = _shaft_net(i, 0.0, theta, p_a, p_b, t, P, S)
                up = _pump_level(1.0, 0.0, p_a, p_b, t, P, S)
                down = _pump_level(-1.0, 0.0, p_a, p_b, t, P, S)
                dir_m = _direction(0.0, net, up, down)
        dir_r = 0.0
        if not (locked or impose_rod):
            if v != 0.0:
                dir_r = 1.0 if v > 0.0 else -1.0
            else:
                up = rod_dry(P[F_ROD], 1.0, x, 0.0, p_a, p_b, t, P, S)
                down = rod_dry(P[F_ROD], -1.0, x, 0.0, p_a, p_b, t, P, S)
                net = _rod_net(up, x, 0.0, p_a, p_b, force, t, area, P, S)
                dir_r = _direction(0.0, net, rod_sticks(up, P, S), rod_sticks(down, P, S))
                if (x >= x_max and dir_r > 0.0) or (x <= -x_max and dir_r < 0.0):
                    dir_r = 0.0
        omega1, theta1, a1, b1, x1, v1 = _step(
            left, omega, theta, p_a, p_b, x, v, i, force, t, dir_m, dir_r, bypass, area, P, S
        )
        part = 1.0
        stop_m = dir_m != 0.0 and dir_m * omega1 <= 0.0
        stop_r = dir_r != 0.0 and dir_r * v1 <= 0.0
        if stop_m:
            part = min(part, omega / (omega - omega1) if omega != 0.0 else 0.0)
        if stop_r:
            part = min(part, v / (v - v1) if v != 0.0 else 0.0)
        if split == _MAX_SPLITS - 1:
            part = 1.0
        if part <= 0.0:
            # breaks away and is driven back within the step: it stays at rest
            dir_m = 0.0 if stop_m and omega == 0.0 else dir_m
            dir_r = 0.0 if stop_r and v == 0.0 else dir_r
            omega1, theta1, a1, b1, x1, v1 = _step(
                left, omega, theta, p_a, p_b, x, v, i, force, t, dir_m, dir_r, bypass, area, P, S
            )
            part = 1.0
            stop_m = dir_m != 0.0 and dir_m * omega1 <= 0.0
            stop_r = dir_r != 0.0 and dir_r * v1 <= 0.0
        elif part < 1.0:
            first_m = stop_m and omega / (omega - omega1) <= part
            first_r = stop_r and v / (v - v1) <= part
            omega1, theta1, a1, b1, x1, v1 = _step(
                part * left, omega, theta, p_a, p_b, x, v, i, force, t, dir_m, dir_r, bypass, area,
                P, S,
            )  # fmt: skip
            stop_m, stop_r = first_m, first_r
        if stop_m:
            omega1 = 0.0
        if stop_r:
            v1 = 0.0
        if x1 > x_max:
            x1 = x_max
            v1 = min(v1, 0.0)
        elif x1 < -x_max:
            x1 = -x_max
            v1 = max(v1, 0.0)
        Y[0], Y[1], Y[2], Y[3], Y[4], Y[5] = omega1, theta1, a1, b1, x1, v1
        t += part * left
        left *= 1.0 - part
        if left <= 1e-9 * h:
            break


@njit
def _measure(t, P, S, Y, out):  # type: ignore[no-untyped-def]
    """Write what the sensors read (without noise) into a row: i, w, p_a, p_b, x, v."""
    out[0] = measured_current(Y[CURRENT], t, P, S)
    out[1] = measured_speed(Y[OMEGA], t, P, S)
    out[2] = measured_pressure_a(Y[PRESSURE_A], t, P, S)
    out[3] = measured_pressure_b(Y[PRESSURE_B], t, P, S)
    out[4] = measured_position(Y[POSITION], t, P, S)
    out[5] = measured_velocity(Y[VELOCITY], t, P, S)


@njit
def start(P, S, Y):  # type: ignore[no-untyped-def]
    """Set the effects' own states from the state Y."""
    S[:] = 0.0
    start_states(
        Y[CURRENT], Y[OMEGA], Y[PRESSURE_A], Y[PRESSURE_B], Y[POSITION], Y[VELOCITY], P, S
    )


@njit(cache=True, nogil=True)
def simulate(first, last, times, commands, forces, imposed, is_imposed, locked, bypass_open, h_max, fresh, P, S, Y, out):  # type: ignore[no-untyped-def]
    """Advance from tick `first` to tick `last`, writing what the sensors read at each tick.

    Row k of `out` is what is read at times[k], just before commands[k] takes effect; rows first
    to last (inclusive, as far as `out` reaches) are written, and Y, S are left at times[last].

    Args:
        first, last: ticks, 0 <= first <= last < len(times).
        times: (n,) s; commands: (n,) A, held from times[k] to times[k + 1].
        forces: (n,) measured external force on the rod, N, added to the parameter's.
        imposed: (n, 5) measured speed, p_a, p_b, x, v where `is_imposed` (5,) is True.
        locked, bypass_open: setup. h_max: largest substep, s.
        fresh: whether to set the effects' states from Y first.
        P, S, Y: parameters, effects' states, state (7,). out: (n, 6).
    """
    bypass = P[G_BYPASS] if bypass_open else 0.0
    area = area_b(P[A_B], P, S)
    impose_speed = is_imposed[IMPOSE_SPEED]
    impose_rod = is_imposed[IMPOSE_POSITION] or is_imposed[IMPOSE_VELOCITY]
    if fresh:
        if is_imposed[IMPOSE_SPEED]:
            Y[OMEGA] = imposed[first, IMPOSE_SPEED]
        start(P, S, Y)
    for k in range(first, last + 1):
        if impose_speed:
            Y[OMEGA] = imposed[k, IMPOSE_SPEED]
        if is_imposed[IMPOSE_A]:
            Y[PRESSURE_A] = imposed[k, IMPOSE_A]
        if is_imposed[IMPOSE_B]:
            Y[PRESSURE_B] = imposed[k, IMPOSE_B]
        if is_imposed[IMPOSE_POSITION]:
            Y[POSITION] = imposed[k, IMPOSE_POSITION]
        if is_imposed[IMPOSE_VELOCITY]:
            Y[VELOCITY] = imposed[k, IMPOSE_VELOCITY]
        _measure(times[k], P, S, Y, out[k])
        if k == last:
            break
        t = times[k]
        span = times[k + 1] - t
        count = max(1, int(math.ceil(span / h_max - 1e-6)))
        h = span / count
        if is_imposed[IMPOSE_POSITION] and not is_imposed[IMPOSE_VELOCITY]:
            Y[VELOCITY] = (imposed[k + 1, IMPOSE_POSITION] - imposed[k, IMPOSE_POSITION]) / span
        for n in range(count):
            start_of_step = t + n * h
            middle = (n + 0.5) / count
            value = command(commands[k], k, start_of_step, h, times, commands, P, S)
            limited = min(max(value, -P[I_MAX]), P[I_MAX])
            force = forces[k] + middle * (forces[k + 1] - forces[k])
            if impose_speed:
                Y[OMEGA] = imposed[k, 0] + middle * (imposed[k + 1, 0] - imposed[k, 0])
            if is_imposed[IMPOSE_VELOCITY]:
                Y[VELOCITY] = imposed[k, 4] + middle * (imposed[k + 1, 4] - imposed[k, 4])
            advance_states(0.5 * h, start_of_step, limited, Y[OMEGA], Y[THETA], Y[PRESSURE_A], Y[PRESSURE_B], Y[POSITION], Y[VELOCITY], P, S)  # fmt: skip
            current = drive_current(limited, start_of_step, P, S)
            _substep(h, current, force, start_of_step, locked, bypass, impose_speed, impose_rod, area, P, S, Y)
            if is_imposed[IMPOSE_A]:
                share = (n + 1.0) / count
                Y[PRESSURE_A] = imposed[k, 1] + share * (imposed[k + 1, 1] - imposed[k, 1])
            if is_imposed[IMPOSE_B]:
                share = (n + 1.0) / count
                Y[PRESSURE_B] = imposed[k, 2] + share * (imposed[k + 1, 2] - imposed[k, 2])
            advance_states(0.5 * h, start_of_step + 0.5 * h, limited, Y[OMEGA], Y[THETA], Y[PRESSURE_A], Y[PRESSURE_B], Y[POSITION], Y[VELOCITY], P, S)  # fmt: skip
            Y[CURRENT] = drive_current(limited, start_of_step + h, P, S)
