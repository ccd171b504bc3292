"""Many parameter sets of the knee EHA over the same input, in step, on the lanes of SIMD registers.

The equations and the integrator are those of `equations` and `kernel`, without effects and without
friction that creeps, written once more so that one loop over the lanes holds a whole step and no
branch: LLVM turns it into vector instructions. All rows of a block lie in one array at distances
that are known when it is compiled, or LLVM could not tell that they do not overlap. Where a shaft
or a rod comes to rest within a step, the rod reaches its end, or anything else is not as usual, the
lane is marked and that step is done by the scalar integrator, from the state before it.

Results differ from the scalar kernel's by rounding: a division becomes a product with the
reciprocal, and exp(-u^2) is a polynomial (below 3e-16 relative).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

# assembly: these imports are replaced by the code they import
from eha_bench.plants.compiled import njit
from eha_bench.plants.eha_knee.equations import (
    A_A,
    A_B,
    B_PM,
    B_ROD,
    BETA,
    D_P,
    DEAD_VOLUME,
    F_EXT,
    F_ROD,
    FORCE,
    G_BYPASS,
    I_MAX,
    K_T,
    L_IN,
    T_CF,
    T_SF,
    V_A,
    V_B,
    W_S,
    J,
    M,
)
from eha_bench.plants.eha_knee.hooks import pointer
from eha_bench.plants.eha_knee.kernel import _GAMMA, _substep

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

LANES = 8
"""Sets in a block: two registers of four keep a core busier than one."""

# where each row of a block starts; the state first, in the order of the scalar state vector (the
# shaft's angle, which only effects look at, stays as it was)
(W, TH, PA, PB, X, V, CUR, KT, JJ, IWS, IM, DT, TC, TS, BPM, DP, BET, VA, VB, AA, AB, BROD, FROD,
 FEXT, IMAX, G, XMAX, MINA, MINB, MARK) = range(0, 30 * LANES, LANES)  # fmt: skip
ROWS = 30


@intrinsic
def _power_of_two(context: Any, shifted: Any) -> Any:
    """2^k of k + 1.5 * 2^52: k stands in the last bits of that number."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        word = ir.IntType(64)
        bits = builder.bitcast(arguments[0], word)
        bits = builder.add(bits, ir.Constant(word, 1023))
        bits = builder.shl(bits, ir.Constant(word, 52))
        return builder.bitcast(bits, ir.DoubleType())

    return types.float64(types.float64), generate


@njit(inline="always")
def _exp(x: float) -> float:
    """e^x for x <= 0: reduced to |r| < ln(2) / 2 (Cody and Waite), Taylor's polynomial."""
    x = max(x, -700.0)
    shifted = x * 1.4426950408889634 + 6755399441055744.0
    k = shifted - 6755399441055744.0
    r = (x - k * 6.93147180369123816490e-01) - k * 1.90821492927058770002e-10
    p = 1.6059043836821613e-10
    p = p * r + 2.0876756987868100e-09
    p = p * r + 2.5052108385441720e-08
    p = p * r + 2.7557319223985893e-07
    p = p * r + 2.7557319223985888e-06
    p = p * r + 2.4801587301587302e-05
    p = p * r + 1.9841269841269841e-04
    p = p * r + 1.3888888888888889e-03
    p = p * r + 8.3333333333333332e-03
    p = p * r + 4.1666666666666664e-02
    p = p * r + 1.6666666666666666e-01
    p = p * r + 0.5
    p = p * r + 1.0
    p = p * r + 1.0
    return p * _power_of_two(shifted)  # type: ignore[call-arg]  # the typing context is passed by numba


@njit(inline="always")
def _when(condition: bool) -> float:
    return 1.0 if condition else 0.0


@njit(fastmath={"contract"})
def _fill(block: Vector, parameters: Matrix, states: Matrix, bypass_open: bool) -> None:
    """Lay the parameters and states of LANES sets out in rows."""
    for n in range(LANES):
        P = parameters[n]
        area_a, area_b = P[A_A], P[A_B]
        for row in range(7):
            block[row * LANES + n] = states[n, row]
        block[KT + n], block[JJ + n] = P[K_T], 1.0 / P[J]
        block[IWS + n], block[IM + n] = 1.0 / P[W_S], 1.0 / P[M]
        block[DT + n], block[TC + n], block[TS + n] = P[T_SF] - P[T_CF], P[T_CF], P[T_SF]
        block[BPM + n], block[DP + n], block[BET + n] = P[B_PM], P[D_P], P[BETA]
        block[VA + n], block[VB + n] = P[V_A], P[V_B]
        block[AA + n], block[AB + n] = area_a, area_b
        block[BROD + n], block[FROD + n], block[FEXT + n] = P[B_ROD], P[F_ROD], P[F_EXT]
        block[IMAX + n] = P[I_MAX]
        block[G + n] = P[L_IN] + (P[G_BYPASS] if bypass_open else 0.0)
        block[XMAX + n] = min(P[V_A] / area_a, P[V_B] / area_b) * (1.0 - DEAD_VOLUME)
        block[MINA + n], block[MINB + n] = DEAD_VOLUME * P[V_A], DEAD_VOLUME * P[V_B]


@njit(fastmath={"contract"})
def _step_all(B: Vector, h: float, force: float, free: float) -> None:
    """One ROS2 step of all lanes; a lane where something stops is marked and left as it was."""
    s = _GAMMA * h
    for n in range(LANES):
        w, p_a, p_b, x, v = B[W + n], B[PA + n], B[PB + n], B[X + n], B[V + n]
        d_p, b_pm, i_j, i_m = B[DP + n], B[BPM + n], B[JJ + n], B[IM + n]
        a_a, a_b, g, f_rod, b_rod = B[AA + n], B[AB + n], B[G + n], B[FROD + n], B[BROD + n]
        t_c, t_s, d_t, i_ws, x_max = B[TC + n], B[TS + n], B[DT + n], B[IWS + n], B[XMAX + n]
        torque, load = B[KT + n] * B[CUR + n], B[FEXT + n] + force

        # directions of motion, or of what breaks away
        net = torque - (d_p * (p_a - p_b) + b_pm * w)
        away = _when(net > t_s) - _when(net < -t_s)
        dir_m = 1.0 if w > 0.0 else (-1.0 if w < 0.0 else away)
        net_r = a_a * p_a - a_b * p_b - load - b_rod * v
        away = _when(net_r > f_rod) - _when(net_r < -f_rod)
        dir_r = 1.0 if v > 0.0 else (-1.0 if v < 0.0 else away)
        ends = _when(x >= x_max) * _when(dir_r > 0.0) + _when(x <= -x_max) * _when(dir_r < 0.0)
        dir_r *= free * (1.0 - _when(v == 0.0) * ends)
        on_m, on_r = abs(dir_m), abs(dir_r)

        # first stage
        u = w * i_ws
        f_w = (net * on_m - dir_m * (t_c + d_t * _exp(-u * u))) * i_j
        q_ab, q_pump = g * (p_a - p_b), d_p * w
        v_a = max(B[VA + n] + a_a * x, B[MINA + n])
        v_b = max(B[VB + n] - a_b * x, B[MINB + n])
        stiff = B[BET + n] / (v_a * v_b)
        c_a, c_b = stiff * v_b, stiff * v_a
        f_a = c_a * (q_pump - a_a * v - q_ab)
        f_b = c_b * (a_b * v - q_pump + q_ab)
        f_v = (net_r * on_r - dir_r * f_rod) * i_m
        m_ab, m_ba = s * c_a * g, s * c_b * g
        m_aa, m_bb = 1.0 + m_ab, 1.0 + m_ba
        i_det = 1.0 / (m_aa * m_bb - m_ab * m_ba)
        k_a = (m_bb * f_a + m_ab * f_b) * i_det
        k_b = (m_aa * f_b + m_ba * f_a) * i_det

        # second stage
        w1, a1, b1 = w + h * f_w, p_a + h * k_a, p_b + h * k_b
        x1, v1 = x + h * v, v + h * f_v
        net = torque - (d_p * (a1 - b1) + b_pm * w1)
        u = w1 * i_ws
        e_w = (net * on_m - dir_m * (t_c + d_t * _exp(-u * u))) * i_j
        q_ab, q_pump = g * (a1 - b1), d_p * w1
        v_a = max(B[VA + n] + a_a * x1, B[MINA + n])
        v_b = max(B[VB + n] - a_b * x1, B[MINB + n])
        stiff = B[BET + n] / (v_a * v_b)
        r_a = stiff * v_b * (q_pump - a_a * v1 - q_ab) - 2.0 * k_a
        r_b = stiff * v_a * (a_b * v1 - q_pump + q_ab) - 2.0 * k_b
        net_r = a_a * a1 - a_b * b1 - load - b_rod * v1
        e_v = (net_r * on_r - dir_r * f_rod) * i_m
        l_a = (m_bb * r_a + m_ab * r_b) * i_det
        l_b = (m_aa * r_b + m_ba * r_a) * i_det
        w2, v2 = w + 0.5 * h * (f_w + e_w), v + 0.5 * h * (f_v + e_v)
        x2 = x + h * (v + 0.5 * h * f_v)

        mark = on_m * _when(dir_m * w2 <= 0.0) + on_r * _when(dir_r * v2 <= 0.0)
        mark += _when(abs(x2) > x_max)
        done = mark == 0.0
        B[MARK + n] = mark
        B[W + n] = w2 if done else w
        B[PA + n] = p_a + h * (1.5 * k_a + 0.5 * l_a) if done else p_a
        B[PB + n] = p_b + h * (1.5 * k_b + 0.5 * l_b) if done else p_b
        B[X + n] = x2 if done else x
        B[V + n] = v2 if done else v


@njit(fastmath={"contract", "reassoc", "nsz"})
def _marks(B: Vector) -> float:
    found = 0.0
    for n in range(LANES):
        found += B[MARK + n]
    return found


@njit()
def _step_marked(
    B: Vector, h: float, t: float, force: float, locked: bool, parameters: Matrix, memory: Vector,
    Y: Vector, imposed: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Do the step of the marked lanes by the scalar integrator."""
    S = pointer(memory)
    S[FORCE] = force
    for n in range(LANES):
        if B[MARK + n] != 0.0:
            P = pointer(parameters[n])
            for row in range(7):
                Y[row] = B[row * LANES + n]
            bypass = B[G + n] - P[L_IN]
            _substep(h, B[CUR + n], t, locked, bypass, imposed, P[A_B], P, S, Y)
            for row in range(6):
                B[row * LANES + n] = Y[row]


@njit(cache=True, nogil=True)
def sweep(
    first: int,
    times: Vector,
    commands: Vector,
    forces: Vector,
    locked: bool,
    bypass_open: bool,
    h_max: float,
    parameters: Matrix,
    states: Matrix,
    memory: Vector,
    out: NDArray[np.float64],
) -> None:
    """Simulate LANES parameter sets from tick `first` to the last.

    Args:
        first: first tick.
        times: (n,) s; commands: (n,) A, held between ticks; forces: (n,) N, linear between ticks.
        locked, bypass_open: setup. h_max: largest substep, s.
        parameters: (LANES, P) parameters without effects; states: (LANES, 7), changed.
        memory: vector `S` of the layout without effects.
        out: (n, 6, LANES), rows from `first` on are written as `kernel.simulate` does.
    """
    B = np.zeros(ROWS * LANES)
    Y = np.zeros(7)
    imposed = np.zeros(6, dtype=np.bool_)
    _fill(B, parameters, states, bypass_open)
    free = 0.0 if locked else 1.0
    last = times.size - 1
    for k in range(first, last + 1):
        for n in range(LANES):
            out[k, 0, n], out[k, 1, n], out[k, 2, n] = B[CUR + n], B[W + n], B[PA + n]
            out[k, 3, n], out[k, 4, n], out[k, 5, n] = B[PB + n], B[X + n], B[V + n]
        if k == last:
            break
        span = times[k + 1] - times[k]
        count = max(1, math.ceil(span / h_max - 1e-6))
        h = span / count
        for n in range(LANES):
            B[CUR + n] = min(max(commands[k], -B[IMAX + n]), B[IMAX + n])
        for part in range(count):
            force = forces[k] + (part + 0.5) / count * (forces[k + 1] - forces[k])
            _step_all(B, h, force, free)
            if _marks(B) != 0.0:
                now = times[k] + part * h
                _step_marked(B, h, now, force, locked, parameters, memory, Y, imposed)
    for n in range(LANES):
        for row in range(7):
            states[n, row] = B[row * LANES + n]
