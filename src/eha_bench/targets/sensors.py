"""What sensors add to the truth: noise and quantisation, seeded."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import Annotated

import numpy as np
from pydantic import Field

from eha_bench.core.arrays import FloatArray
from eha_bench.core.channels import unit_of
from eha_bench.core.errors import InputError, Place, UnitError
from eha_bench.core.near_miss import suggest
from eha_bench.core.units import Unit, parse
from eha_bench.core.yaml_file import Real, StrictModel


class SimulatedSensor(StrictModel):
    """Noise (standard deviation, white, Gaussian), resolution and slow error of one channel."""

    noise: Annotated[Real | str, Field(description="standard deviation")] = 0.0
    resolution: Annotated[Real | str, Field(description="size of one count; 0 for none")] = 0.0

    wander: Annotated[
        Real | str, Field(description="standard deviation of an error that changes slowly")
    ] = 0.0
    memory: Annotated[
        float, Unit("s"), Field(gt=0, description="correlation time of that error")
    ] = 0.02

    def in_si(self, channel: str, unit: str | None = None) -> tuple[float, float, float]:
        """Return noise, resolution and wander in the channel's SI unit.

        Args:
            channel: its name. unit: its SI unit, where eha_bench does not know the channel.

        Raises:
            UnitError: wrong dimension, or negative.
        """
        si = unit_of(channel) if unit is None else unit
        found = tuple(parse(v, si) for v in (self.noise, self.resolution, self.wander))
        if min(found) < 0:
            raise UnitError(f"noise, resolution and wander of '{channel}' cannot be negative")
        noise, resolution, wander = found
        return noise, resolution, wander


RIG_SENSORS: dict[str, SimulatedSensor] = {
    "current": SimulatedSensor(noise="0.05 A"),
    "motor_speed": SimulatedSensor(noise="0.1 rad/s"),
    "pressure_a": SimulatedSensor(noise="0.03 MPa", resolution="0.0146 MPa"),
    "pressure_b": SimulatedSensor(noise="0.03 MPa", resolution="0.0146 MPa"),
    "piston_position": SimulatedSensor(noise="4 um", resolution="2 um"),
    "piston_velocity": SimulatedSensor(noise="1 mm/s"),
    "joint_angle": SimulatedSensor(noise="0.005 deg", resolution="0.0055 deg"),
}
"""Sensors of a rig like the paper's: 12-bit pressure over 60 MPa, a 16-bit encoder at the knee."""


def check_sensors(
    sensors: Mapping[str, SimulatedSensor],
    channels: Collection[str],
    units: Mapping[str, str],
    place_of: Callable[[str], Place],
) -> None:
    """Refuse a sensor of a channel that a target does not have, or in another unit.

    Args:
        sensors: by channel, as a target.yaml has them. channels: that the target records.
        units: SI units of channels. place_of: channel -> where its sensor stands in the file.

    Raises:
        InputError: with file, line and key.
    """
    for channel, sensor in sensors.items():
        if channel not in channels:
            raise InputError(
                f"a sensor of '{channel}', which the target does not record",
                where=place_of(channel),
                hint=suggest(channel, channels),
            )
        try:
            sensor.in_si(channel, units.get(channel))
        except UnitError as error:
            raise InputError(error.what, where=place_of(channel), hint=error.hint) from error


class SensorNoise:
    """Noise for every tick of a run, drawn at its start so that a seed fixes it."""

    def __init__(
        self,
        sensors: dict[str, SimulatedSensor],
        channels: tuple[str, ...],
        n: int,
        seed: list[int],
        units: Mapping[str, str],
        period: float,
    ) -> None:
        """Draw it.

        Args:
            sensors: by channel. channels: of the readings. n: ticks. seed: of what is drawn.
            units: SI units of channels that are not on the list of known ones. period: of ticks, s.
        """
        generator = np.random.default_rng(seed)
        self._noise = np.zeros((n, len(channels)))
        self._count = np.zeros(len(channels))
        for column, channel in enumerate(channels):
            drawn = generator.standard_normal(n)
            if channel in sensors:
                sensor = sensors[channel]
                noise, self._count[column], wander = sensor.in_si(channel, units.get(channel))
                self._noise[:, column] = noise * drawn
                if wander > 0.0:
                    own = np.random.SeedSequence(seed, spawn_key=(column,))
                    slow = _slow(n, period / sensor.memory, own)
                    self._noise[:, column] += wander * slow

    def read(self, tick: int, truth: FloatArray) -> FloatArray:
        """Return what the sensors show at a tick for the true values, (channels,)."""
        value: FloatArray = truth + self._noise[tick]
        counted = self._count > 0
        value[counted] = np.round(value[counted] / self._count[counted]) * self._count[counted]
        return value


def _slow(n: int, step: float, seed: np.random.SeedSequence) -> FloatArray:
    """Return an error of standard deviation 1 with a correlation time of 1 / `step` ticks, (n,).

    First-order autoregressive: e_k = a e_(k-1) + sqrt(1 - a^2) w_k with a = exp(-step), from its
    stationary distribution on.
    """
    from scipy.signal import lfilter

    keep = math.exp(-step)
    drawn = np.random.default_rng(seed).standard_normal(n)
    drawn[1:] *= math.sqrt(1.0 - keep * keep)
    return np.asarray(lfilter([1.0], [1.0, -keep], drawn))
