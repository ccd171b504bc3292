"""Compiled equations of the linear drive.

State: position and velocity of the carriage::

    M dv/dt = g_tau u - F_v v - F_c sign(v) - off;  at rest friction takes any value up to F_c

and, where a reference is given instead of the voltage u, the drive's own controller, once a
control period T with the velocity as the mean difference of its last three readings y::

    u = k_v (k_p (r - y) - (y - y_2) / (2 T)) + pulses,   y_2 two periods before

Source: Janot, Gautier, Brunot, Data Set and Reference Models of EMPS, Workshop on Nonlinear System
Identification Benchmarks, 2019. The controller's velocity is not published; this one reproduces the
logged voltage from the logged positions to 4 mV RMS, the difference of the last two readings, or of
the first and the last of four, to 50 mV.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

# assembly: these two imports are replaced, the hooks by the composed ones
from eha_bench.plants.compiled import njit
from eha_bench.plants.linear_drive.hooks import (
    motor_force,
    rod_dry,
    rod_force,
    rod_sticks,
    rod_viscous,
)

Vector = NDArray[np.float64]

# places in the parameter vector, in the order of parameters.PARAMETERS
G_TAU, M, F_V, F_C, OFFSET, K_P, K_V, PERIOD, U_MAX, CREEP = range(10)

# places in the state vector; VOLTAGE is what acts, held between ticks
POSITION, VELOCITY, VOLTAGE = range(3)

# the signal at the start of the record S
DEMAND = 0


@njit()
def net_force(level: float, u: float, x: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """All force on the carriage except what sticks of its dry friction, N."""
    total = motor_force(P[G_TAU] * u, u, x, v, t, P, S)
    total -= P[OFFSET] + rod_viscous(P[F_V], v, t, P, S) * v
    return rod_force(total, level, u, x, v, t, P, S)


@njit()
def acceleration(
    h: float, u: float, x: float, v: float, t: float, direction: float, P: Vector, S: Vector
) -> tuple[float, float]:
    """dv/dt in m/s^2, 0 where `direction` is 0 (held), and the slope of creeping friction, 1/s."""
    if direction == 0.0:
        return 0.0, 0.0
    level = rod_dry(P[F_C], direction, u, x, v, t, P, S)
    net = net_force(level, u, x, v, t, P, S)
    level = rod_sticks(level, P, S)
    if P[CREEP] <= 0.0:
        return (net - direction * level) / P[M], 0.0
    rate = (net - level * math.tanh(v / P[CREEP])) / P[M]
    later = v + h * rate
    slowest = 0.0 if v * later <= 0.0 else min(abs(v), abs(later))
    shape = math.tanh(slowest / P[CREEP])
    return rate, level / (P[CREEP] * P[M]) * (1.0 - shape * shape)


@njit()
def direction_of(u: float, x: float, v: float, t: float, P: Vector, S: Vector) -> float:
    """Direction in which the carriage moves or breaks away; 0 where it sticks."""
    if v != 0.0:
        return 1.0 if v > 0.0 else -1.0
    up = rod_dry(P[F_C], 1.0, u, x, 0.0, t, P, S)
    down = rod_dry(P[F_C], -1.0, u, x, 0.0, t, P, S)
    net = net_force(up, u, x, 0.0, t, P, S)
    if P[CREEP] > 0.0:
        return 1.0 if net >= 0.0 else -1.0
    if net > rod_sticks(up, P, S):
        return 1.0
    if net < -rod_sticks(down, P, S):
        return -1.0
    return 0.0
