"""The pressure controller: change it, run the suite, compare."""

from collections.abc import Mapping
from typing import Annotated

from eha_bench.control.controller import Context, Controller, clip
from eha_bench.core.units import Unit
from eha_bench.core.yaml_file import StrictModel


class Gains(StrictModel):
    """Gains; units are converted where controller.yaml is read, here they are SI."""

    k_1: Annotated[float, Unit("A/Pa")]
    k_p: Annotated[float, Unit("A/Pa")]
    k_i: Annotated[float, Unit("A/(Pa*s)")]
    k_2: Annotated[float, Unit("A*s/rad")]


class PressureLaw(Controller):
    """Feed-forward, proportional and integral action, and damping by the motor's speed."""

    Gains = Gains

    def __init__(self, gains: StrictModel, context: Context) -> None:
        """Start from rest."""
        assert isinstance(gains, Gains)
        self.gains, self.context, self.integral = gains, context, 0.0

    def step(self, reference: float, reading: Mapping[str, float]) -> float:
        """Return the motor current, A, for a pressure difference in Pa."""
        gains, limit = self.gains, self.context.current_limit
        error = reference - reading["pressure_difference"]
        current = gains.k_1 * reference + gains.k_p * error + gains.k_i * self.integral
        current -= gains.k_2 * reading["motor_speed"]
        if abs(current) < limit or current * error < 0:  # no windup
            self.integral += error * self.context.period
        return clip(current, limit)
