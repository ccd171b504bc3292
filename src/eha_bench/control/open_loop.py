"""No control: the reference is the command."""

from __future__ import annotations

from collections.abc import Mapping

from eha_bench.control.controller import Context, Controller, NoGains, clip
from eha_bench.core.yaml_file import StrictModel


class OpenLoop(Controller):
    """Passes the reference on as the command, within what the target follows."""

    Gains = NoGains

    def __init__(self, gains: StrictModel, context: Context) -> None:
        del gains  # it has none
        self._limit = context.command_limit

    def step(self, reference: float, reading: Mapping[str, float]) -> float:
        """Return the reference, SI."""
        del reading  # nothing is fed back
        return clip(reference, self._limit)
