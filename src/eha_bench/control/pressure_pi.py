"""Pressure control: PI with feed-forward and speed feedback, Eq. (11) of the paper.

    u = k_1 dP_ref + k_p e + k_i integral(e) dt - k_2 w,      e = dP_ref - dP

The speed feedback damps what the paper calls erratic fluctuations. Anti-windup: the integral only
grows while the current is inside its limit, or where it leads back inside (conditional
integration; Astrom, Hagglund, Advanced PID Control, ISA 2006, section 3.5), and it rests within
`dead_band`, where dry friction would otherwise make it hunt.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field

from eha_bench.control.controller import Context, Controller, clip
from eha_bench.core.units import Unit
from eha_bench.core.yaml_file import StrictModel

_A_PER_PA = Annotated[float, Unit("A/Pa")]


class PressureGains(StrictModel):
    """Gains of Eq. (11), SI."""

    k_1: Annotated[_A_PER_PA, Field(description="feed-forward of the reference")]
    k_p: Annotated[_A_PER_PA, Field(description="proportional gain")]
    k_i: Annotated[float, Unit("A/(Pa*s)"), Field(description="integral gain")]
    k_2: Annotated[float, Unit("A*s/rad"), Field(description="speed feedback")]
    dead_band: Annotated[
        float, Unit("Pa"), Field(ge=0, description="error within which the integral rests")
    ] = 0.0


class PressurePI(Controller):
    """PI pressure controller with feed-forward and speed feedback (Eq. (11))."""

    Gains = PressureGains

    def __init__(self, gains: StrictModel, context: Context) -> None:
        assert isinstance(gains, PressureGains)
        self._gains = gains
        self._context = context
        self._integral = 0.0

    def step(self, reference: float, reading: Mapping[str, float]) -> float:
        """Return the current for a pressure difference reference in Pa, A."""
        gains = self._gains
        error = reference - reading["pressure_difference"]
        current = (
            gains.k_1 * reference
            + gains.k_p * error
            + gains.k_i * self._integral
            - gains.k_2 * reading["motor_speed"]
        )
        limit = self._context.command_limit
        saturated = abs(current) > limit and current * error > 0
        if not saturated and abs(error) > gains.dead_band:
            self._integral += error * self._context.period
        return clip(current, limit)
