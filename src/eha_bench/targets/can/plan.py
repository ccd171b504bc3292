"""What a trial asks of a drive."""

from __future__ import annotations

from dataclasses import dataclass

from eha_bench.control.controller import Controller
from eha_bench.core.linkage import Linkage
from eha_bench.core.trial import ControlMode, Trial
from eha_bench.targets.can.guard import GuardLimits


@dataclass(frozen=True)
class DrivePlan:
    """What a trial asks of the drive, worked out before anything moves.

    Attributes:
        trial: what to run.
        mode: the mode in which the drive is commanded.
        controller: the bench's controller; None where the drive closes the loop.
        command: channel that the drive is commanded by; "" where it closes the loop itself.
        command_limit: what a controller may ask for at most, SI.
        position: where the rod is to start, m from mid-stroke.
        linkage: geometry of the joint; None where it is not known.
        limits: what is checked at every tick.
        constants: model.<parameter> and the like, for the recording's metadata.
    """

    trial: Trial
    mode: ControlMode
    controller: Controller | None
    command: str
    command_limit: float
    position: float
    linkage: Linkage | None
    limits: GuardLimits
    constants: dict[str, str]

    @property
    def columns(self) -> tuple[str, ...]:
        """Channels of the recording that are not measured."""
        return ("reference", self.command) if self.command else ("reference",)
