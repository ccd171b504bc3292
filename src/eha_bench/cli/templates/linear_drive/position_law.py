"""The position controller: change it, run the suite, compare."""

from collections.abc import Mapping

from eha_bench.control.controller import Context, Controller, clip
from eha_bench.core.yaml_file import StrictModel


class Gains(StrictModel):
    """Gains: V/m and V*s/m."""

    k_p: float
    k_d: float


class PositionLaw(Controller):
    """Proportional action, and damping by the velocity."""

    Gains = Gains

    def __init__(self, gains: StrictModel, context: Context) -> None:
        """Start from rest."""
        assert isinstance(gains, Gains)
        self.gains, self.context = gains, context

    def step(self, reference: float, reading: Mapping[str, float]) -> float:
        """Return the voltage, V, for a position in m."""
        error = reference - reading["piston_position"]
        volts = self.gains.k_p * error - self.gains.k_d * reading["piston_velocity"]
        return clip(volts, self.context.current_limit)
