"""The channels that eha_bench knows: name, SI unit, meaning, positive direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Channel:
    """A physical quantity that a recording may hold; `unit` is SI ("" = as commanded)."""

    name: str
    unit: str
    description: str


_ALL: Final = (
    Channel("reference", "", "what the trial asks for, in the unit of its control mode"),
    Channel("current_command", "A", "what the controller asks of the motor drive"),
    Channel("current", "A", "measured motor current, just before the tick's command takes effect"),
    Channel("motor_speed", "rad/s", "pump shaft speed, positive pumps into chamber A"),
    Channel("pressure_a", "Pa", "pressure in chamber A (P1)"),
    Channel("pressure_b", "Pa", "pressure in chamber B (P2)"),
    Channel("pressure_difference", "Pa", "P1 - P2, derived where both are there"),
    Channel("piston_position", "m", "from mid-stroke, positive extends (chamber A grows)"),
    Channel("piston_velocity", "m/s", "positive extends"),
    Channel("joint_angle", "rad", "absolute knee angle between the links of length a and b"),
    Channel("force", "N", "external force on the rod, positive against extension"),
    Channel("oil_temperature", "K", "temperature of the oil"),
    Channel("voltage", "V", "what a linear drive is asked for (its input in open loop)"),
    Channel("pulses", "V", "voltage that is added to what a linear drive's controller asks for"),
)

CHANNELS: Final[dict[str, Channel]] = {channel.name: channel for channel in _ALL}
"""Known channels by name. Recordings may hold others; their unit then comes from the mapping."""


def unit_of(name: str) -> str:
    """Return the SI unit of a known channel, or "" for a channel that is not in the list."""
    channel = CHANNELS.get(name)
    return channel.unit if channel else ""
