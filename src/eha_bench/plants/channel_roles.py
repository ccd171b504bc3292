"""What the channels of a plant are: rates, positions, pressures, commands; no code goes by names.

A log of any plant is read, cut and started by these: a rate is 0 at rest, a position's slope is
its rate, a command is held between samples and exact, a measured state is neither.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class ChannelRoles:
    """Names of channels and states by what they are.

    Attributes:
        rates: speeds and velocities: 0 at rest.
        rate_of: channel of a position -> the state that is its rate.
        geared: channel of a part behind a gear -> the state that it moves with, and how many times
            as fast it moves, as declared.
        turning: rate -> the state that is its angle, where something may repeat with the turn.
        pressures: pressures that are states.
        pair: the two chambers of a cylinder, () where there are none.
        facing: the two pressures whose difference and sum something may follow: the pair, or those
            on both sides of a pump or a hydraulic motor; () where there are none.
        commands: inputs that are asked for: held between samples, and exact.
        remembered: commands of what may have play: where they turned before says where it is.
        followed: inputs that a controller inside the plant makes a position follow.
        on_top: inputs that are added to another: where a log has none, nothing was added.
        acting: channel of what acts in a drive -> the input that asks for it.
        limited: channels that stand still where their drive is at its limit.
        bent: positions beyond an elastic joint that nothing reads: how far it is bent in the midst
            of a motion is not known.
        locked: channels and states that stand still while the piston is locked.
        read_back: inputs that a drive may have read back: exact where they are smooth.
        added_up: inputs whose noise a balance adds up. added_up_by_rod: those of a free rod's.
        volumes: nodes whose pressure is a state. units: SI unit of every channel.
    """

    rates: tuple[str, ...] = ()
    rate_of: Mapping[str, str] = field(default_factory=dict)
    geared: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    turning: Mapping[str, str] = field(default_factory=dict)
    pressures: tuple[str, ...] = ()
    pair: tuple[str, ...] = ()
    facing: tuple[str, ...] = ()
    commands: tuple[str, ...] = ()
    remembered: tuple[str, ...] = ()
    followed: tuple[str, ...] = ()
    on_top: tuple[str, ...] = ()
    acting: Mapping[str, str] = field(default_factory=dict)
    limited: tuple[str, ...] = ()
    bent: tuple[str, ...] = ()
    locked: tuple[str, ...] = ()
    read_back: tuple[str, ...] = ()
    added_up: tuple[str, ...] = ()
    added_up_by_rod: tuple[str, ...] = ()
    volumes: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)


KNOWN = ChannelRoles(
    rates=("motor_speed", "piston_velocity"),
    rate_of={"piston_position": "piston_velocity"},
    turning={"motor_speed": "shaft_angle"},
    pressures=("pressure_a", "pressure_b"),
    pair=("pressure_a", "pressure_b"),
    facing=("pressure_a", "pressure_b"),
    commands=("current_command", "reference", "voltage", "pulses"),
    followed=("reference",),
    on_top=("pulses",),
    acting={"current": "current_command"},
    limited=("current", "voltage"),
    locked=("piston_position", "piston_velocity", "joint_angle"),
    added_up=(
        "current", "motor_speed", "pressure_a", "pressure_b", "pressure_difference",
        "piston_velocity",
    ),
    added_up_by_rod=("force",),
)  # fmt: skip
"""The channels that eha_bench knows by name: for plants that declare nothing themselves."""
