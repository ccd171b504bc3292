"""What a controller is, and how its YAML block is turned into one.

A controller is one file: a class derived from `Controller` with a pydantic `Gains` model, found by
the entry point group `eha_bench.controllers` or named as `module:Class` in a file that was given
on the command line.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from eha_bench.core.errors import TargetFault
from eha_bench.core.linkage import Linkage
from eha_bench.core.yaml_file import StrictModel


@dataclass(frozen=True)
class Context:
    """What a controller may know besides its gains.

    Attributes:
        period: time between ticks, s.
        command_limit: the largest command that the target follows, SI.
        linkage: geometry of the joint, None where there is no joint.
        command: what is commanded: `current_command`, `voltage`, `valve_command` ...
        command_unit: its SI unit.
        channel: what should follow the reference.
        unit: its SI unit.
    """

    period: float
    command_limit: float
    linkage: Linkage | None = None
    command: str = "current_command"
    command_unit: str = "A"
    channel: str = ""
    unit: str = ""

    @property
    def current_limit(self) -> float:
        """The largest command, where it is a current, A."""
        return self.command_limit


class NoGains(StrictModel):
    """Gains of a controller that has none."""


class Controller(ABC):
    """One control law; a new instance is made for every run, so it may keep state.

    A subclass names its gains in `Gains` and is called once a tick.
    """

    Gains: ClassVar[type[StrictModel]] = NoGains

    @abstractmethod
    def __init__(self, gains: StrictModel, context: Context) -> None:
        """Start from rest with these gains."""

    @abstractmethod
    def step(self, reference: float, reading: Mapping[str, float]) -> float:
        """Return the command to give now, SI: a motor current in A, a voltage in V ...

        Args:
            reference: what the trial asks for now, SI, in the unit of the control mode.
            reading: what the sensors read now by channel, SI; `pressure_difference` and, where
                there is a joint, `joint_angle` are among them.
        """


def clip(value: float, limit: float) -> float:
    """Return the value within -limit ... limit."""
    return min(max(value, -limit), limit)


def as_command(command: object) -> float:
    """Return what a controller asked for as a number, SI.

    Raises:
        TargetFault: it is none; most often a `step` without `return`.
    """
    try:
        return float(command)  # type: ignore[arg-type]  # that is what is found out
    except (TypeError, ValueError) as error:
        raise TargetFault(f"the controller's step returned {command!r}, not a number") from error
