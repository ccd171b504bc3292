"""What sensors add to the truth: noise and quantisation, seeded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import numpy as np
from pydantic import Field

from eha_bench.core.arrays import FloatArray
from eha_bench.core.channels import unit_of
from eha_bench.core.errors import UnitError
from eha_bench.core.units import parse
from eha_bench.core.yaml_file import Real, StrictModel


class Sensor(StrictModel):
    """Noise (standard deviation, white, Gaussian) and resolution of one channel."""

    noise: Annotated[Real | str, Field(description="standard deviation")] = 0.0
    resolution: Annotated[Real | str, Field(description="size of one count; 0 for none")] = 0.0

    def in_si(self, channel: str, unit: str | None = None) -> tuple[float, float]:
        """Return noise and resolution in the channel's SI unit.

        Args:
            channel: its name. unit: its SI unit, where eha_bench does not know the channel.

        Raises:
            UnitError: wrong dimension, or negative.
        """
        si = unit_of(channel) if unit is None else unit
        noise, resolution = (parse(v, si) for v in (self.noise, self.resolution))
        if noise < 0 or resolution < 0:
            raise UnitError(f"noise and resolution of '{channel}' cannot be negative")
        return noise, resolution


RIG_SENSORS: dict[str, Sensor] = {
    "current": Sensor(noise="0.05 A"),
    "motor_speed": Sensor(noise="0.1 rad/s"),
    "pressure_a": Sensor(noise="0.03 MPa", resolution="0.0146 MPa"),
    "pressure_b": Sensor(noise="0.03 MPa", resolution="0.0146 MPa"),
    "piston_position": Sensor(noise="4 um", resolution="2 um"),
    "piston_velocity": Sensor(noise="1 mm/s"),
    "joint_angle": Sensor(noise="0.005 deg", resolution="0.0055 deg"),
}
"""Sensors of a rig like the paper's: 12-bit pressure over 60 MPa, a 16-bit encoder at the knee."""


class SensorNoise:
    """Noise for every tick of a run, drawn at its start so that a seed fixes it."""

    def __init__(
        self,
        sensors: dict[str, Sensor],
        channels: tuple[str, ...],
        n: int,
        seed: list[int],
        units: Mapping[str, str],
    ) -> None:
        generator = np.random.default_rng(seed)
        self._noise = np.zeros((n, len(channels)))
        self._count = np.zeros(len(channels))
        for column, channel in enumerate(channels):
            drawn = generator.standard_normal(n)
            if channel in sensors:
                noise, self._count[column] = sensors[channel].in_si(channel, units.get(channel))
                self._noise[:, column] = noise * drawn

    def read(self, tick: int, truth: FloatArray) -> FloatArray:
        """Return what the sensors show at a tick for the true values, (channels,)."""
        value: FloatArray = truth + self._noise[tick]
        counted = self._count > 0
        value[counted] = np.round(value[counted] / self._count[counted]) * self._count[counted]
        return value
