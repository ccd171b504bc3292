"""Play in the joint between the rod and what it moves.

Read in two ways, by where the sensors sit (`side`):

* The sensor is beyond the play: its reading lags by the play operator, half the gap each way::

      y = min(max(y, x - g/2), x + g/2)

  `position_sensor`: only the position is read there; `joint`: the velocity too, which is then 0
  while the gap is crossed.
* `load`: the sensors are on the rod, and the load is beyond the play. Rod and load are two masses
  that touch only at the ends of the gap, through a stiff and damped contact (a dead zone)::

      d = x - x_load;  f = k (|d| - g/2) sign(d) + c (v - v_load)  where |d| > g/2, only pushing
      rod_mass dv/dt = ... - f;   M dv_load/dt = f - F_e

  The weight that `gravity_load` adds stays on the rod.

Where in the gap the joint is at the first sample is not known. Beyond a sensor it is taken in the
middle at rest, and at the driving end where the rod moves. A load is taken to touch the end that
pushes it: rod and load move as one under what the chambers and friction leave, and the force that
the load takes of it, f = F_e + M dv/dt, says which end that is and how far the contact gives.

Source: Nordin, Gutman, Automatica 38 (2002) 1633, doi:10.1016/S0005-1098(02)00047-X; the play
operator: Krasnosel'skii, Pokrovskii, Systems with Hysteresis, Springer 1989.
"""

from __future__ import annotations

import math

from eha_bench.plants.compiled import njit
from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice

_POSITION, _JOINT, _LOAD = 0.0, 1.0, 2.0
# slower than this the rod counts as at rest at the first sample, m/s
_AT_REST = 5e-3


@njit()
def _share(speed: float) -> float:
    """Return the end of the gap that drives: -1 ... 1."""
    return min(1.0, max(-1.0, speed / _AT_REST))


@njit()
def _contact(
    d: float, closing: float, gap: float, joint_stiffness: float, rod_mass: float
) -> float:
    """Return the force from the rod on the load, N; `d` = x - x_load, `closing` = its rate."""
    damping = math.sqrt(joint_stiffness * rod_mass)
    if d > 0.5 * gap:
        return max(0.0, joint_stiffness * (d - 0.5 * gap) + damping * closing)
    if d < -0.5 * gap:
        return min(0.0, joint_stiffness * (d + 0.5 * gap) + damping * closing)
    return 0.0


def reading(value: float, read: float, side: float) -> float:
    """Return what the position sensor reads, m."""
    return value if side == _LOAD else read


def reading_velocity(value: float, x: float, read: float, gap: float, side: float) -> float:
    """Return what the velocity sensor reads, m/s: 0 where it is beyond a gap being crossed."""
    if side != _JOINT or (x - read) * math.copysign(1.0, value) >= 0.5 * gap * (1.0 - 1e-9):
        return value
    return 0.0


def behind(position: float, v: float, gap: float, side: float) -> float:
    """Return the rod's position behind a first reading, m."""
    return position if side == _LOAD else position + 0.5 * gap * _share(v)


def drag(read: float, x: float, gap: float) -> float:
    """Return the position beyond the play after the rod has moved to x, m (play operator)."""
    return min(max(read, x - 0.5 * gap), x + 0.5 * gap)


def read_at_first(x: float, v: float, gap: float) -> float:
    """Return the position beyond the play at the first sample, m."""
    return x - 0.5 * gap * _share(v)


def engaged_load(
    load: float,
    x: float,
    v: float,
    load_x: float,
    load_v: float,
    gap: float,
    side: float,
    joint_stiffness: float,
    rod_mass: float,
) -> float:
    """Return the load's force on the rod (positive against extension), N."""
    if side != _LOAD:
        return load
    return _contact(x - load_x, v - load_v, gap, joint_stiffness, rod_mass)


def lone_mass(mass: float, side: float, rod_mass: float) -> float:
    """Return the mass that moves with the rod while the load is beyond the play, kg."""
    return rod_mass if side == _LOAD else mass


def move_load(load_x: float, load_v: float, h: float) -> float:
    """Return the load's position after a time h, m."""
    return load_x + h * load_v


def push_load(
    load_x: float,
    load_v: float,
    x: float,
    v: float,
    h: float,
    load_mass: float,
    external_force: float,
    measured_force: float,
    gap: float,
    joint_stiffness: float,
    rod_mass: float,
) -> float:
    """Return the load's velocity after a time h, m/s."""
    force = _contact(x - load_x, v - load_v, gap, joint_stiffness, rod_mass)
    return load_v + h * (force - external_force - measured_force) / load_mass


def load_at_first(
    x: float,
    v: float,
    p_a: float,
    p_b: float,
    piston_area_a: float,
    piston_area_b: float,
    rod_viscous: float,
    rod_coulomb: float,
    load_mass: float,
    external_force: float,
    measured_force: float,
    gap: float,
    joint_stiffness: float,
    rod_mass: float,
) -> float:
    """Return the load's position at the first sample, m: at the end of the gap that pushes it."""
    load = external_force + measured_force
    force = load
    if abs(v) >= _AT_REST:
        push = piston_area_a * p_a - piston_area_b * p_b - rod_viscous * v
        push -= math.copysign(rod_coulomb, v)
        force += load_mass * (push - load) / (rod_mass + load_mass)
    side = _share(v) if force == 0.0 else math.copysign(1.0, force)
    return x - 0.5 * gap * side - force / joint_stiffness


def speed_at_first(v: float) -> float:
    """Return the load's velocity at the first sample, m/s."""
    return v


EFFECT = Effect(
    id="joint_backlash",
    summary="Play in the joint between the rod and what it moves.",
    parameters=(
        Parameter("gap", "m", 3e-4, 0.0, 0.02, "g"),
        choice("side", ("position_sensor", "joint", "load"), "what is beyond the play"),
        Parameter(
            "joint_stiffness", "N/m", 2e7, 1e5, 1e8, "k",
            "hardened pin of the rod", searched=False, when=("side", ("load",)),
        ),
        Parameter(
            "rod_mass", "kg", 2.0, 0.5, 1e3, "", "rod and piston alone",
            when=("side", ("load",)),
        ),
    ),
    actions={
        "eha_knee": Action(
            Equation.MEASUREMENT,
            {
                "measured_position": reading,
                "measured_velocity": reading_velocity,
                "initial_position": behind,
                "external_load": engaged_load,
                "moving_mass": lone_mass,
            },
            chosen_by="side",
            equations={"load": Equation.FORCE},
        )
    },
    states=("read", "load_x", "load_v"),
    advance={"read": drag, "load_x": move_load, "load_v": push_load},
    start={"read": read_at_first, "load_x": load_at_first, "load_v": speed_at_first},
    source="Nordin, Gutman, Automatica 38 (2002) 1633, doi:10.1016/S0005-1098(02)00047-X",
    separate=(
        "reverse slowly and compare rod and joint: with play the joint waits, "
        "with friction both stop"
    ),
    starts=({"gap": 1e-3}, {"side": _JOINT}, {"side": _LOAD}, {"gap": 1e-3, "side": _LOAD}),
)  # fmt: skip
