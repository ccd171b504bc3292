"""Motor speed control: the inner PI loop of the position controller (Figure 5 of the paper)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field

from eha_bench.control.controller import Context, Controller, clip
from eha_bench.core.units import Unit
from eha_bench.core.yaml_file import StrictModel


class SpeedGains(StrictModel):
    """Gains of the speed loop, SI."""

    k_p: Annotated[float, Unit("A*s/rad"), Field(ge=0, description="proportional gain")]
    k_i: Annotated[float, Unit("A/rad"), Field(ge=0, description="integral gain")]
    speed_limit: Annotated[
        float, Unit("rad/s"), Field(gt=0, description="largest speed that is asked for")
    ]


class SpeedPI(Controller):
    """PI control of the motor speed with conditional integration against windup.

    Attributes:
        saturated: whether the last tick asked for more current than the drive can deliver.
    """

    Gains = SpeedGains

    def __init__(self, gains: StrictModel, context: Context) -> None:
        assert isinstance(gains, SpeedGains)
        self._gains = gains
        self._context = context
        self._integral = 0.0
        self.saturated = False

    def step(self, reference: float, reading: Mapping[str, float]) -> float:
        """Return the current for a speed reference in rad/s, A."""
        gains = self._gains
        error = clip(reference, gains.speed_limit) - reading["motor_speed"]
        current = gains.k_p * error + gains.k_i * self._integral
        limit = self._context.command_limit
        self.saturated = abs(current) > limit
        if not self.saturated or current * error < 0:
            self._integral += error * self._context.period
        return clip(current, limit)
