"""Play in the joint between a rod or shaft and what it moves.

Read in two ways, by where the sensors sit (`side`):

Where the sensor is beyond the play, its reading lags by the play operator, half the gap each way:

    y = min(max(y, x - g/2), x + g/2)

With `position_sensor` only the position is read there; with `joint` the velocity too, which is then
0 while the gap is crossed.

With `load` the sensors are on the rod (or shaft), and the load is beyond the play: of a rod all the
mass that is declared, of a shaft the elements that it carries (a pendulum). The two are masses
that touch only at the ends of the gap, through a stiff and damped contact (a dead zone):

    d = x - x_load
    f = k (|d| - g/2) sign(d) + 2 zeta sqrt(k m) (v - v_load)  where |d| > g/2, only pushing
    m dv/dt = ... - f;   M dv_load/dt = f - F_e

The weight that `gravity_load` adds stays on the rod.

Where in the gap the joint is at the first sample is not known. Beyond a sensor it is taken in the
middle at rest, and at the driving end where the rod moves. A load is taken to touch the end that
pushes it: rod and load move as one under what the chambers and friction leave, and the force that
the load takes of it, f = F_e + M dv/dt, says which end that is and how far the contact gives.
Where a run begins at rest, the load may as well lie anywhere in between (`rest`).

Source: Nordin, Gutman, Automatica 38 (2002) 1633, doi:10.1016/S0005-1098(02)00047-X; the play
operator: Krasnosel'skii, Pokrovskii, Systems with Hysteresis, Springer 1989.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from eha_bench.plants.compiled import njit
from eha_bench.plants.effect import Action, Effect, Equation
from eha_bench.plants.parameter import Parameter, choice

_POSITION, _JOINT, _LOAD = 0.0, 1.0, 2.0
# step of the integration, in radians of the rod's vibration on the contact, and at most so many
# instead of one
_RESOLVED, _MOST_STEPS = 0.2, 100


class Joint(NamedTuple):
    """The joint through which rod and load touch."""

    gap: float
    joint_stiffness: float
    joint_damping: float
    rod_mass: float


class Load(NamedTuple):
    """The load beyond the play, and what pulls at it where it is."""

    load_x: float
    load_v: float
    load_mass: float
    pulled_there: float


@njit()
def _share(speed: float, resting: float) -> float:
    """Return the end of the gap that drives: -1 ... 1; slower than `resting` it is at rest."""
    return min(1.0, max(-1.0, speed / resting))


@njit()
def _squeeze(d: float, joint: Joint) -> float:
    """Return how far the contact is pressed, m: 0 within the gap; `d` = x - x_load."""
    return d - min(max(d, -0.5 * joint.gap), 0.5 * joint.gap)


@njit()
def _damping(joint: Joint) -> float:
    """Return the damping of the contact, N*s/m."""
    return 2.0 * joint.joint_damping * math.sqrt(joint.joint_stiffness * joint.rod_mass)


@njit()
def _contact(d: float, closing: float, joint: Joint) -> float:
    """Return the force from the rod on the load, N; `d` = x - x_load, `closing` = its rate."""
    squeeze = _squeeze(d, joint)
    if squeeze == 0.0:
        return 0.0
    force = joint.joint_stiffness * squeeze + _damping(joint) * closing
    return force if force * squeeze > 0.0 else 0.0


def reading(value: float, read: float, side: float) -> float:
    """Return what the position sensor reads, m."""
    return value if side == _LOAD else read


def reading_velocity(value: float, position: float, read: float, gap: float, side: float) -> float:
    """Return what the velocity sensor reads, m/s: 0 where it is beyond a gap being crossed."""
    if side != _JOINT or (position - read) * math.copysign(1.0, value) >= 0.5 * gap * (1.0 - 1e-9):
        return value
    return 0.0


def behind(position: float, speed: float, resting: float, gap: float, side: float) -> float:
    """Return the rod's position behind a first reading, m."""
    return position if side == _LOAD else position + 0.5 * gap * _share(speed, resting)


def drag(read: float, position: float, gap: float) -> float:
    """Return the position beyond the play after the rod has moved to x, m (play operator)."""
    return min(max(read, position - 0.5 * gap), position + 0.5 * gap)


def read_at_first(position: float, speed: float, resting: float, gap: float) -> float:
    """Return the position beyond the play at the first sample, m."""
    return position - 0.5 * gap * _share(speed, resting)


def engaged_load(
    load: float,
    t: float,
    position: float,
    speed: float,
    moment: float,
    load_x: float,
    load_v: float,
    side: float,
    joint: Joint,
) -> float:
    """Return the load's force on the rod, N: where it is beyond the play, that of the contact.

    The load waits in the middle of the rod's step; beside a rod that moves by more in half a step
    than the contact gives, it would let go at one end of the step and be hit at the other.
    """
    if side != _LOAD:
        return load
    there = load_x + (t - moment) * load_v
    return -_contact(position - there, speed - load_v, joint)


def lone_mass(mass: float, side: float, rod_mass: float) -> float:
    """Return the mass that moves with the rod while the load is beyond the play, kg."""
    return rod_mass if side == _LOAD else mass


@njit()
def _load_acceleration(d: float, closing: float, beyond: Load, joint: Joint) -> float:
    """Return the load's acceleration with the rod `d` from it, closing at a rate, m/s^2."""
    return (_contact(d, closing, joint) + beyond.pulled_there) / beyond.load_mass


def move_by(
    beyond: Load, joint: Joint, seen: float, position: float, speed: float, h: float
) -> float:
    """Return the load's way in a time h, m.

    A step of the rod lies between two halves of one of the load. In the first the contact pushes
    and then the load moves, in the second it moves and then it is pushed (velocity Verlet): pushed
    with the rod half a step behind, or ahead, the contact would be a damper of a kN*s/m.
    """
    if position != seen:
        return h * beyond.load_v
    pulled = _load_acceleration(position - beyond.load_x, speed - beyond.load_v, beyond, joint)
    return h * (beyond.load_v + h * pulled)


def move_load(load_x: float, way: float) -> float:
    """Return the load's position after its way, m."""
    return load_x + way


def push_load(
    beyond: Load,
    joint: Joint,
    way: float,
    seen: float,
    position: float,
    speed: float,
    h: float,
) -> float:
    """Return the load's velocity after a time h, m/s, pushed where the rod was looked at.

    In the first half of a step the contact damps the velocity before it, in the second the one
    after it (implicit Euler, the first's adjoint): rod and load are pushed by the same impulse to
    the second order. Both halves alike would make the load heavier by c h / 2.
    """
    if position == seen:
        there = beyond.load_x - way
        return beyond.load_v + h * _load_acceleration(
            position - there, speed - beyond.load_v, beyond, joint
        )
    free = beyond.load_v + h * beyond.pulled_there / beyond.load_mass
    squeeze = _squeeze(position - beyond.load_x, joint)
    if squeeze == 0.0:
        return free
    damped = h * _damping(joint) / beyond.load_mass
    spring = h * joint.joint_stiffness * squeeze / beyond.load_mass
    pushed = (free + spring + damped * speed) / (1.0 + damped)
    return pushed if (pushed - free) * squeeze > 0.0 else free


def look(position: float) -> float:
    """Return where the rod was when the load last moved, m."""
    return position


def arrive(t: float, h: float) -> float:
    """Return the time at which the load is where it has moved, s."""
    return t + h


def wait(t: float) -> float:
    """Return the time at which the load has not moved yet, s."""
    return t


def stay() -> float:
    """Return the load's way before it has moved, m."""
    return 0.0


def load_at_first(
    position: float,
    speed: float,
    resting: float,
    pushed: float,
    viscous_force: float,
    coulomb: float,
    load_mass: float,
    pulled: float,
    gap: float,
    joint_stiffness: float,
    rod_mass: float,
    rest: float,
) -> float:
    """Return the load's position at the first sample, m: at the end of the gap that pushes it."""
    load = -pulled
    force = load
    if abs(speed) >= resting:
        push = pushed - viscous_force
        push -= math.copysign(coulomb, speed)
        force += load_mass * (push - load) / (rod_mass + load_mass)
    side = _share(speed, resting) if force == 0.0 else math.copysign(1.0, force)
    # a speed that was measured is never nothing: so only a run begins
    share = rest if speed == 0.0 else 1.0
    squeezed = force / joint_stiffness if share == 1.0 else 0.0
    return position - share * 0.5 * gap * side - squeezed


def speed_at_first(speed: float) -> float:
    """Return the load's velocity at the first sample, m/s."""
    return speed


def resolve(h: float, locked: bool, side: float, joint_stiffness: float, rod_mass: float) -> float:
    """Return the longest step, s, over which the rod on the contact is followed."""
    if side != _LOAD or locked:
        return h
    return max(min(h, _RESOLVED * math.sqrt(rod_mass / joint_stiffness)), h / _MOST_STEPS)


def _before_a_load(balance: Equation) -> Action:
    """Return what a play does before a load, which it sets apart in a balance."""
    return Action(
        {
            "read_position": reading,
            "read_speed": reading_velocity,
            "initial_position": behind,
            "load": engaged_load,
            "inertia": lone_mass,
            "longest": resolve,
        },
        Equation.MEASUREMENT,
        chosen_by="side",
        equations={"load": balance},
        plays="gap",
        advance={
            "read": drag, "way": move_by, "load_x": move_load, "load_v": push_load,
            "seen": look, "moment": arrive,
        },
        start={
            "read": read_at_first, "way": stay, "load_x": load_at_first,
            "load_v": speed_at_first, "seen": look, "moment": wait,
        },
    )  # fmt: skip


EFFECT = Effect(
    id="joint_backlash",
    summary="Play in the joint between a rod or shaft and what it moves.",
    parameters=(
        Parameter("gap", "{play}", 3e-4, 0.0, 0.5, "g"),
        choice("side", ("position_sensor", "joint", "load"), "what is beyond the play"),
        Parameter(
            "joint_stiffness", "{stiffness}", 1.0, 1.0, 1e9, "k",
            "hardened pin, or teeth", searched=False, when=("side", ("load",)),
        ),
        Parameter(
            "joint_damping", "", 0.5, 0.01, 2.0, "zeta",
            "share of critical damping of the rod on the contact", when=("side", ("load",)),
        ),
        Parameter(
            "rod_mass", "kg", 2.0, 0.5, 1e3, "", "rod and piston alone",
            when=("side", ("load",)), role="sliding_joint",
        ),
        Parameter(
            "rest", "", 1.0, -1.0, 1.0, "",
            "where a load begins from rest: 0 the middle of the gap, 1 the end that pushes it",
            searched=False, when=("side", ("load",)),
        ),
    ),
    actions={
        "sliding_joint": _before_a_load(Equation.FORCE),
        "loaded_shaft": _before_a_load(Equation.TORQUE),
        "turning_joint": Action(
            {
                "read_position": reading,
                "read_speed": reading_velocity,
                "initial_position": behind,
            },
            Equation.MEASUREMENT,
            choices={"side": ("position_sensor", "joint")},
            plays="gap",
            advance={"read": drag},
            start={"read": read_at_first},
        ),
    },
    states=("read", "way", "load_x", "load_v", "seen", "moment"),
    source="Nordin, Gutman, Automatica 38 (2002) 1633, doi:10.1016/S0005-1098(02)00047-X",
    separate=(
        "reverse slowly and compare rod and joint: with play the joint waits, "
        "with friction both stop"
    ),
    starts=(
        {"gap": 1e-3}, {"side": _JOINT},
        *({"side": _LOAD, "gap": gap} for gap in (3e-4, 1e-3)),
        # where the rod meets a load that lies apart, a gap 1.4 times as wide is another answer
        *({"side": _LOAD, "gap": 1e-4 * 2.0 ** (0.5 * k), "rest": 0.0} for k in range(9)),
    ),
    reversing=True,
)  # fmt: skip
