"""The integrator of the knee EHA, compiled.

ROS2 (Verwer, Spee, Blom, Hundsdorfer, SIAM J. Sci. Comput. 20 (1999) 1456,
doi:10.1137/S1064827597326651), a two-stage Rosenbrock W-method: second order with any matrix in
place of the Jacobian, L-stable where that matrix holds what is stiff. Only the 2x2 pressure block
(an open bypass or check valve reaches 10-20 us) and creeping friction are stiff, so only they are
treated implicitly; all else becomes Heun's method. Within a step, the instants at which shaft or
rod stop are located and the step is split there, so friction reverses and sticks at the right
time.

A valve that opens fills its chamber in 10 to 25 us, and at longer steps the second stage would meet
it far behind its setting: a step on which one switches is done again in steps of 25 us.

Step: 25 us. The fastest non-stiff mode is the load on the oil spring, about 500 rad/s; the local
error there is (500 * 25e-6)^3 / 6 = 3e-7, and the global error stays below 1e-4 of the range, which
a test holds against SciPy's implicit solver.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

# assembly: these imports are replaced by the code they import
from eha_bench.plants.compiled import njit
from eha_bench.plants.eha_knee.equations import (
    A_A,
    A_B,
    CREEP_PUMP,
    CREEP_ROD,
    CURRENT,
    DEAD_VOLUME,
    DEMAND,
    FORCE,
    G_BYPASS,
    I_MAX,
    L_IN,
    OMEGA,
    POSITION,
    PRESSURE_A,
    PRESSURE_B,
    TEMPERATURE,
    THETA,
    V_A,
    V_B,
    VELOCITY,
    measure,
    rates,
    rod_direction,
    shaft_direction,
    valves_switch,
)
from eha_bench.plants.eha_knee.hooks import (
    activate,
    advance_states,
    area_b,
    command,
    conductance_a,
    conductance_ab,
    conductance_b,
    drive_command,
    drive_current,
    initial_position,
    initial_pressure_a,
    initial_pressure_b,
    longest_step,
    pointer,
    start_states,
    volume_b,
)

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Flags = NDArray[np.bool_]

# channels that may be imposed instead of computed
(IMPOSE_SPEED, IMPOSE_A, IMPOSE_B, IMPOSE_POSITION, IMPOSE_VELOCITY, IMPOSE_CURRENT,
 IMPOSE_ANGLE) = range(7)  # fmt: skip

_GAMMA = 1.0 - 1.0 / math.sqrt(2.0)
_MAX_SPLITS = 8

_FINE = 25e-6
"""Step across a valve that opens or closes, s: an open one fills its chamber in 10 to 25 us."""


@njit()
def _step(
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
    """One ROS2 step with fixed directions of friction.

    Returns:
        The state after it, and the pressures at which its second stage looked.
    """
    f_w, f_a, f_b, f_v, c_a, c_b, s_w, s_v = rates(
        h, i, omega, theta, p_a, p_b, x, v, t, dir_m, dir_r, bypass, area, P, S
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
    m_w = 1.0 + s * s_w
    m_v = 1.0 + s * s_v
    k_a = (m_bb * f_a - m_ab * f_b) / det
    k_b = (m_aa * f_b - m_ba * f_a) / det
    k_w = f_w / m_w
    k_v = f_v / m_v
    a1, b1 = p_a + h * k_a, p_b + h * k_b
    f_w1, f_a1, f_b1, f_v1, _, _, _, _ = rates(
        h, i, omega + h * k_w, theta + h * omega, a1, b1, x + h * v,
        v + h * k_v, t + h, dir_m, dir_r, bypass, area, P, S,
    )  # fmt: skip
    r_a = f_a1 - 2.0 * k_a
    r_b = f_b1 - 2.0 * k_b
    l_a = (m_bb * r_a - m_ab * r_b) / det
    l_b = (m_aa * r_b - m_ba * r_a) / det
    l_w = (f_w1 - 2.0 * k_w) / m_w
    l_v = (f_v1 - 2.0 * k_v) / m_v
    return (
        omega + h * (1.5 * k_w + 0.5 * l_w),
        theta + h * (omega + 0.5 * h * k_w),
        p_a + h * (1.5 * k_a + 0.5 * l_a),
        p_b + h * (1.5 * k_b + 0.5 * l_b),
        x + h * (v + 0.5 * h * k_v),
        v + h * (1.5 * k_v + 0.5 * l_v),
        a1,
        b1,
    )


@njit()
def _substep(
    h: float,
    i: float,
    t: float,
    locked: bool,
    bypass: float,
    is_imposed: Flags,
    area: float,
    P: Vector,
    S: Vector,
    Y: Vector,
) -> None:
    """Advance Y by h, in fine steps where a valve opens or closes on the way.

    A long step meets a valve only where it looks, far behind its setting, and fills the chamber by
    what would flow there all the time.
    """
    omega, theta, p_a, p_b, x, v = Y[0], Y[1], Y[2], Y[3], Y[4], Y[5]
    piece = h
    part = count = 1
    while part <= count:
        now = t + (part - 1) * piece
        part += 1
        switched = _split_step(piece, i, now, locked, bypass, is_imposed, area, P, S, Y)
        if switched and count == 1:
            Y[0], Y[1], Y[2], Y[3], Y[4], Y[5] = omega, theta, p_a, p_b, x, v
            part, count = 1, max(2, math.ceil(h / _FINE - 1e-6))
            piece = h / count


# inlined, as a call takes a tenth of the time of what it does
@njit(forceinline=True)
def _split_step(
    h: float,
    i: float,
    t: float,
    locked: bool,
    bypass: float,
    is_imposed: Flags,
    area: float,
    P: Vector,
    S: Vector,
    Y: Vector,
) -> bool:
    """Advance Y by h, split where the shaft or the rod comes to rest.

    Returns:
        Whether a valve opened or closed on the way.
    """
    switched = False
    left = h
    x_max = min(P[V_A] / P[A_A], volume_b(P[V_B], P, S) / area) * (1.0 - DEAD_VOLUME)
    hold_shaft = is_imposed[IMPOSE_SPEED]
    hold_rod = locked or is_imposed[IMPOSE_POSITION] or is_imposed[IMPOSE_VELOCITY]
    # friction that creeps has no instant of stopping
    stops_m = P[CREEP_PUMP] <= 0.0
    stops_r = P[CREEP_ROD] <= 0.0
    for split in range(_MAX_SPLITS):
        omega, theta, p_a, p_b, x, v = Y[0], Y[1], Y[2], Y[3], Y[4], Y[5]
        dir_m = 0.0
        if not hold_shaft:
            dir_m = shaft_direction(i, omega, theta, p_a, p_b, x, v, t, P, S)
        dir_r = 0.0
        if not hold_rod:
            dir_r = rod_direction(i, omega, theta, p_a, p_b, x, v, t, area, P, S)
            if v == 0.0 and ((x >= x_max and dir_r > 0.0) or (x <= -x_max and dir_r < 0.0)):
                dir_r = 0.0
        omega1, theta1, a1, b1, x1, v1, a_mid, b_mid = _step(
            left, i, omega, theta, p_a, p_b, x, v, t, dir_m, dir_r, bypass, area, P, S
        )
        part = 1.0
        stop_m = stops_m and dir_m != 0.0 and dir_m * omega1 <= 0.0
        stop_r = stops_r and dir_r != 0.0 and dir_r * v1 <= 0.0
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
            omega1, theta1, a1, b1, x1, v1, a_mid, b_mid = _step(
                left, i, omega, theta, p_a, p_b, x, v, t, dir_m, dir_r, bypass, area, P, S
            )
            part = 1.0
            stop_m = stops_m and dir_m != 0.0 and dir_m * omega1 <= 0.0
            stop_r = stops_r and dir_r != 0.0 and dir_r * v1 <= 0.0
        elif part < 1.0:
            first_m = stop_m and omega / (omega - omega1) <= part
            first_r = stop_r and v / (v - v1) <= part
            omega1, theta1, a1, b1, x1, v1, a_mid, b_mid = _step(
                part * left, i, omega, theta, p_a, p_b, x, v, t, dir_m, dir_r, bypass, area, P, S
            )
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
        if h > _FINE and not switched:
            switched = valves_switch(p_a, p_b, a_mid, b_mid, bypass, P, S) or valves_switch(
                p_a, p_b, a1, b1, bypass, P, S
            )
        t += part * left
        left *= 1.0 - part
        if left <= 1e-9 * h:
            break
    return switched


@njit(cache=True)
def settle(read: Flags, parameters: Vector, memory: Vector, Y: Vector) -> None:
    """Turn what the sensors read at the first sample into the state that they read it from.

    Args:
        read: (7,) whether Y holds a reading of what may be imposed (else: the state).
        parameters, memory, Y: vectors `P` and `S` of the layout; state (7,), changed.
    """
    P = pointer(parameters)
    S = pointer(memory)
    activate(P, S)
    if read[IMPOSE_A]:
        Y[PRESSURE_A] = initial_pressure_a(Y[PRESSURE_A], P, S)
    if read[IMPOSE_B]:
        Y[PRESSURE_B] = initial_pressure_b(Y[PRESSURE_B], P, S)
    if read[IMPOSE_POSITION]:
        Y[POSITION] = initial_position(Y[POSITION], Y[VELOCITY], P, S)


@njit()
def _advance_effects(h: float, t: float, demanded: float, P: Vector, S: Vector, Y: Vector) -> None:
    """Move the effects' own states on by a time h."""
    advance_states(h, demanded, Y[0], Y[1], Y[2], Y[3], Y[4], Y[5], t, P, S)


@njit(cache=True, nogil=True)
def simulate(
    first: int,
    last: int,
    times: Vector,
    commands: Vector,
    signals: Matrix,
    imposed: Matrix,
    is_imposed: Flags,
    locked: bool,
    bypass_open: bool,
    h_max: float,
    fresh: bool,
    parameters: Vector,
    memory: Vector,
    Y: Vector,
    out: Matrix,
) -> None:
    """Advance from tick `first` to tick `last`, writing what the sensors read at each tick.

    Row k of `out` is what is read at times[k], just before commands[k] takes effect; rows first
    to last (inclusive, as far as `out` reaches) are written, and Y, memory are left at times[last].

    Args:
        first, last: ticks, 0 <= first <= last < len(times).
        times: (n,) s; commands: (n,) A, held from times[k] to times[k + 1].
        signals: (n, 2) measured external force on the rod, N, added to the parameter's, and
            oil temperature, K (NaN where it is not logged); linear between ticks.
        imposed: (n, 7) measured speed, p_a, p_b, x, v, current, shaft angle where `is_imposed` (7,)
            is True; between ticks the shaft turns on from its angle by the speed.
        locked, bypass_open: setup. h_max: largest substep, s.
        fresh: whether to set the effects' states from Y first.
        parameters, memory, Y: vectors `P` and `S` of the layout; state (7,). out: (n, 6).
    """
    if fresh:
        memory[:] = 0.0
    P = pointer(parameters)
    S = pointer(memory)
    activate(P, S)
    bypass = P[G_BYPASS] if bypass_open else 0.0
    area = area_b(P[A_B], P, S)
    if fresh:
        if is_imposed[IMPOSE_SPEED]:
            Y[OMEGA] = imposed[first, IMPOSE_SPEED]
        S[FORCE] = signals[first, FORCE]
        S[TEMPERATURE] = signals[first, TEMPERATURE]
        start_states(Y[CURRENT], Y[0], Y[1], Y[2], Y[3], Y[4], Y[5], P, S)
    for k in range(first, last + 1):
        if is_imposed[IMPOSE_SPEED]:
            Y[OMEGA] = imposed[k, IMPOSE_SPEED]
        if is_imposed[IMPOSE_A]:
            Y[PRESSURE_A] = imposed[k, IMPOSE_A]
        if is_imposed[IMPOSE_B]:
            Y[PRESSURE_B] = imposed[k, IMPOSE_B]
        if is_imposed[IMPOSE_POSITION]:
            Y[POSITION] = imposed[k, IMPOSE_POSITION]
        if is_imposed[IMPOSE_VELOCITY]:
            Y[VELOCITY] = imposed[k, IMPOSE_VELOCITY]
        if is_imposed[IMPOSE_CURRENT]:
            Y[CURRENT] = imposed[k, IMPOSE_CURRENT]
        if is_imposed[IMPOSE_ANGLE]:
            Y[THETA] = imposed[k, IMPOSE_ANGLE]
        measure(times[k], P, S, Y, out[k])
        if k == last:
            break
        t = times[k]
        span = times[k + 1] - t
        count = max(1, math.ceil(span / longest_step(h_max, locked, P, S) - 1e-6))
        h = span / count
        if is_imposed[IMPOSE_POSITION] and not is_imposed[IMPOSE_VELOCITY]:
            Y[VELOCITY] = (imposed[k + 1, IMPOSE_POSITION] - imposed[k, IMPOSE_POSITION]) / span
        for n in range(count):
            now = t + n * h
            middle = (n + 0.5) / count
            S[FORCE] = signals[k, FORCE] + middle * (signals[k + 1, FORCE] - signals[k, FORCE])
            S[TEMPERATURE] = signals[k, TEMPERATURE] + middle * (
                signals[k + 1, TEMPERATURE] - signals[k, TEMPERATURE]
            )
            if is_imposed[IMPOSE_SPEED]:
                Y[OMEGA] = imposed[k, 0] + middle * (imposed[k + 1, 0] - imposed[k, 0])
            if is_imposed[IMPOSE_VELOCITY]:
                Y[VELOCITY] = imposed[k, 4] + middle * (imposed[k + 1, 4] - imposed[k, 4])
            value = command(commands[k], k, now, h, times, commands, P, S)
            limited = min(max(value, -P[I_MAX]), P[I_MAX])
            S[DEMAND] = limited
            demanded = drive_command(
                limited, limited, Y[0], Y[1], Y[2], Y[3], Y[4], Y[5], now, P, S
            )
            _advance_effects(0.5 * h, now, demanded, P, S, Y)
            if is_imposed[IMPOSE_CURRENT]:
                # a logged current is what flowed until its sample
                current = imposed[k + 1, IMPOSE_CURRENT]
            else:
                current = drive_current(demanded, now + 0.5 * h, P, S)
            _substep(h, current, now, locked, bypass, is_imposed, area, P, S, Y)
            if is_imposed[IMPOSE_A]:
                share = (n + 1.0) / count
                Y[PRESSURE_A] = imposed[k, 1] + share * (imposed[k + 1, 1] - imposed[k, 1])
            if is_imposed[IMPOSE_B]:
                share = (n + 1.0) / count
                Y[PRESSURE_B] = imposed[k, 2] + share * (imposed[k + 1, 2] - imposed[k, 2])
            _advance_effects(0.5 * h, now + 0.5 * h, demanded, P, S, Y)
            Y[CURRENT] = drive_current(demanded, now + h, P, S)
