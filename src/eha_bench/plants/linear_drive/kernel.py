"""The integrator of the linear drive, compiled: as the knee's, but for two states.

Heun's method with creeping friction treated implicitly (ROS2, see the knee's kernel), split at the
instants at which the carriage stops.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

# assembly: these imports are replaced by the code they import
from eha_bench.plants.compiled import njit
from eha_bench.plants.linear_drive.equations import (
    CREEP,
    DEMAND,
    K_P,
    K_V,
    PERIOD,
    POSITION,
    U_MAX,
    VELOCITY,
    VOLTAGE,
    acceleration,
    direction_of,
)
from eha_bench.plants.linear_drive.hooks import (
    activate,
    advance_states,
    asked_voltage,
    command,
    drive_command,
    drive_current,
    initial_position,
    measured_position,
    measured_velocity,
    pointer,
    start_states,
)

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Flags = NDArray[np.bool_]

_GAMMA = 1.0 - 1.0 / math.sqrt(2.0)
_MAX_SPLITS = 8


@njit()
def _step(
    h: float, u: float, x: float, v: float, t: float, direction: float, P: Vector, S: Vector
) -> tuple[float, float]:
    """One ROS2 step with a fixed direction of friction: position and velocity after h."""
    f, slope = acceleration(h, u, x, v, t, direction, P, S)
    m = 1.0 + _GAMMA * h * slope
    k = f / m
    f1, _ = acceleration(h, u, x + h * v, v + h * k, t + h, direction, P, S)
    later = (f1 - 2.0 * k) / m
    return x + h * (v + 0.5 * h * k), v + h * (1.5 * k + 0.5 * later)


@njit()
def _substep(h: float, u: float, t: float, P: Vector, S: Vector, Y: Vector) -> None:
    """Advance Y by h, split where the carriage comes to rest."""
    left = h
    for split in range(_MAX_SPLITS):
        x, v = Y[POSITION], Y[VELOCITY]
        direction = direction_of(u, x, v, t, P, S)
        x1, v1 = _step(left, u, x, v, t, direction, P, S)
        part = 1.0
        stops = P[CREEP] <= 0.0 and direction != 0.0 and direction * v1 <= 0.0
        if stops and v == 0.0:
            # breaks away and is driven back within the step: it stays at rest
            x1, v1 = x, 0.0
        elif stops:
            part = v / (v - v1) if split < _MAX_SPLITS - 1 else 1.0
            x1, v1 = _step(part * left, u, x, v, t, direction, P, S)
            v1 = 0.0
        Y[POSITION], Y[VELOCITY] = x1, v1
        t += part * left
        left *= 1.0 - part
        if left <= 1e-9 * h:
            break


@njit(cache=True)
def settle(read: Flags, parameters: Vector, memory: Vector, Y: Vector) -> None:
    """Turn what the sensors read at the first sample into the state that they read it from.

    Args:
        read: (3,) whether Y holds a reading of position, velocity, voltage (else: the state).
        parameters, memory, Y: vectors `P` and `S` of the layout; state (3,), changed.
    """
    P = pointer(parameters)
    S = pointer(memory)
    activate(P, S)
    if read[POSITION]:
        Y[POSITION] = initial_position(Y[POSITION], Y[VELOCITY], P, S)


@njit(cache=True, nogil=True)
def simulate(
    first: int,
    last: int,
    times: Vector,
    commands: Vector,
    references: Vector,
    pulses: Vector,
    closed: bool,
    h_max: float,
    parameters: Vector,
    memory: Vector,
    Y: Vector,
    out: Matrix,
) -> None:
    """Advance from tick `first` to tick `last`, writing what the sensors read at each tick.

    Row k of `out` is voltage, position, velocity at times[k]: the voltage that is asked for then,
    and what the sensors read just before it takes effect.

    Args:
        first, last: ticks, 0 <= first <= last < len(times).
        times: (n,) s; commands: (n,) V, held from times[k] to times[k + 1]; written over with
            what the closed loop, or an effect, asks for.
        references: (n,) m; pulses: (n,) V, added to what the controller asks for.
        closed: whether the controller closes the loop. h_max: largest substep, s.
        parameters, memory, Y: vectors `P` and `S` of the layout; state (3,). out: (n, 3).
    """
    memory[:] = 0.0
    P = pointer(parameters)
    S = pointer(memory)
    activate(P, S)
    start_states(Y[VOLTAGE], Y[POSITION], Y[VELOCITY], P, S)
    before = older = math.nan
    for k in range(first, last + 1):
        t = times[k]
        x, v, u = Y[POSITION], Y[VELOCITY], Y[VOLTAGE]
        read = measured_position(x, u, x, v, t, P, S)
        if closed:
            if math.isnan(before):
                before = read - P[PERIOD] * v
                older = before - P[PERIOD] * v
            speed = (read - older) / (2.0 * P[PERIOD])
            before, older = read, before
            commands[k] = P[K_V] * (P[K_P] * (references[k] - read) - speed) + pulses[k]
        commands[k] = asked_voltage(commands[k], u, x, v, t, P, S)
        out[k, 0] = commands[k]
        out[k, 1] = read
        out[k, 2] = measured_velocity(v, u, x, v, t, P, S)
        if k == last:
            break
        span = times[k + 1] - t
        count = max(1, math.ceil(span / h_max - 1e-6))
        h = span / count
        for n in range(count):
            now = t + n * h
            value = command(commands[k], k, now, h, times, commands, P, S)
            limited = min(max(value, -P[U_MAX]), P[U_MAX])
            S[DEMAND] = limited
            demanded = drive_command(limited, limited, Y[0], Y[1], now, P, S)
            advance_states(0.5 * h, demanded, Y[0], Y[1], now, P, S)
            _substep(h, drive_current(demanded, now + 0.5 * h, P, S), now, P, S, Y)
            advance_states(0.5 * h, demanded, Y[0], Y[1], now + 0.5 * h, P, S)
            Y[VOLTAGE] = drive_current(demanded, now + h, P, S)
