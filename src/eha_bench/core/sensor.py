"""How good a channel's sensor is, as a recording's metadata carry it.

`sensor.<channel>.resolution` and `sensor.<channel>.uncertainty` are text in SI units;
`sensor.<channel>.relative_uncertainty` is a share of the reading. A log's `channels.yaml` says them
(`resolution: 1 bar`, `uncertainty: 0.2 %`), and any recording may carry them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from eha_bench.core.errors import UnitError
from eha_bench.core.recording import Recording
from eha_bench.core.units import parse_difference

PREFIX = "sensor."


@dataclass(frozen=True)
class Sensor:
    """What is known of a sensor.

    Attributes:
        resolution: smallest step of its reading, SI; 0 where unknown.
        uncertainty: standard uncertainty of its calibration, SI, common to all samples.
        relative: the same as a share of the reading.
    """

    resolution: float = 0.0
    uncertainty: float = 0.0
    relative: float = 0.0

    @staticmethod
    def parse(
        resolution: str | float | None, uncertainty: str | float | None, si_unit: str
    ) -> Sensor:
        """Read what a file says: quantities, or for the uncertainty a share of the reading (0.2 %).

        Raises:
            UnitError: no quantity of this unit, or one that is not positive.
        """
        step = 0.0 if resolution is None else _size("resolution", resolution, si_unit)
        if uncertainty is None:
            return Sensor(step)
        if isinstance(uncertainty, str) and uncertainty.rstrip().endswith("%"):
            return Sensor(step, relative=_size("uncertainty", uncertainty, ""))
        return Sensor(step, _size("uncertainty", uncertainty, si_unit))

    def to_metadata(self, channel: str) -> dict[str, str]:
        """Return what is known as metadata of a recording."""
        named = {
            "resolution": self.resolution,
            "uncertainty": self.uncertainty,
            "relative_uncertainty": self.relative,
        }
        return {f"{PREFIX}{channel}.{key}": repr(value) for key, value in named.items() if value}

    @staticmethod
    def of(metadata: Mapping[str, str], channel: str) -> Sensor:
        """Return what metadata say of a channel's sensor; what is not a number is missing."""

        def number(key: str) -> float:
            try:
                value = float(metadata.get(f"{PREFIX}{channel}.{key}", "0"))
            except ValueError:
                return 0.0
            return value if math.isfinite(value) and value > 0.0 else 0.0

        return Sensor(number("resolution"), number("uncertainty"), number("relative_uncertainty"))


def _size(name: str, text: str | float, si_unit: str) -> float:
    size = parse_difference(text, si_unit)
    if not size > 0.0:
        raise UnitError(f"{name} '{text}' is not positive", hint="leave it out where it is unknown")
    return size


def sensors_of(recording: Recording, channel: str) -> dict[str, Sensor]:
    """Return the sensors that a channel is read with, by the channel that each one measures.

    A derived pressure difference is read with two.
    """
    if channel == "pressure_difference" and channel not in recording.values:
        parts: tuple[str, ...] = ("pressure_a", "pressure_b")
    else:
        parts = (channel,)
    return {name: Sensor.of(recording.metadata, name) for name in parts}
