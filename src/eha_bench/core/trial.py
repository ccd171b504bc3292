"""A trial: one reference, one control mode, one setup; run it on a target and score it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, ClassVar, Final

from eha_bench.core.arrays import FloatArray
from eha_bench.core.channels import CHANNELS, unit_of
from eha_bench.core.errors import InputError, Place
from eha_bench.core.limit import AcceptanceLimit, SafetyLimit
from eha_bench.core.margin import EquivalenceMargin
from eha_bench.core.metric import MetricSpec, metric_spec
from eha_bench.core.near_miss import likely
from eha_bench.core.signal import Signal

if TYPE_CHECKING:
    from eha_bench.core.own_metric import OwnMetric

_MISSPELT = 0.9
"""So like a known name is one that was meant to be it; a new channel is less so."""


@dataclass(frozen=True)
class ControlMode:
    """What the reference means: the channel that should follow it.

    A plant's command is a mode as well: the reference is then passed on to it.

    Attributes:
        name: a channel, or `pressure` for the pressure difference.
        declared: SI unit of a channel that eha_bench does not know, by the suite's quantities;
            None where they name none.
        where: where the suite says it.
    """

    name: str
    declared: str | None = field(default=None, compare=False)
    where: Place = field(default=Place(), compare=False, repr=False)

    CURRENT: ClassVar[ControlMode]
    PRESSURE: ClassVar[ControlMode]
    JOINT_ANGLE: ClassVar[ControlMode]
    MOTOR_SPEED: ClassVar[ControlMode]
    PISTON_POSITION: ClassVar[ControlMode]

    @property
    def channel(self) -> str:
        """The channel that should follow the reference."""
        return _CHANNELS.get(self.name, self.name)

    @property
    def known(self) -> bool:
        """Whether eha_bench knows the channel and its unit."""
        return self.channel in CHANNELS

    @property
    def unit(self) -> str:
        """SI unit of the reference; "" where it is not known."""
        return unit_of(self.channel) if self.known else self.declared or ""


_CHANNELS: Final = {"pressure": "pressure_difference"}
COMMANDS: Final = ("current_command", "voltage")
"""What controllers command, among the channels that eha_bench knows."""
_SPOKEN: Final = {"current_command": "current"}
"""Commands that a mode calls by what they command."""
MODES: Final = tuple(
    ControlMode(name)
    for name in ("current", "pressure", "joint_angle", "motor_speed", "piston_position")
)
"""Modes of the shipped suites and controllers."""
(
    ControlMode.CURRENT,
    ControlMode.PRESSURE,
    ControlMode.JOINT_ANGLE,
    ControlMode.MOTOR_SPEED,
    ControlMode.PISTON_POSITION,
) = MODES


def mode_named(name: str, declared: str | None = None, where: Place | None = None) -> ControlMode:
    """Return the mode that a name stands for: a channel, or one of `MODES`.

    Args:
        name: as in a suite. declared: SI unit of a channel that eha_bench does not know.
        where: where it is written.

    Raises:
        InputError: `reference`, or a name so like a known one that it is most likely misspelt.
    """
    spoken = {channel: mode for mode, channel in _CHANNELS.items()}.get(name, name)
    mode = ControlMode(spoken, declared, where or Place())
    if name == "reference":
        raise InputError("the reference cannot follow itself", where=where)
    names = [item.name for item in MODES]
    hint = "" if mode.known else likely(name, [*names, *CHANNELS], likeness=_MISSPELT)
    if hint:
        raise InputError(f"unknown mode '{name}'", where=where, hint=hint)
    return mode


def passes_on(mode: ControlMode, command: str) -> bool:
    """Whether a mode asks for a target's command itself, which needs no controller."""
    return mode.channel in (command, _SPOKEN.get(command))


def command_of(mode: ControlMode) -> str:
    """Return the channel that a mode which is passed on commands: `current_command` of current."""
    spoken = {name: command for command, name in _SPOKEN.items()}
    return spoken.get(mode.name, mode.channel)


class Piston(StrEnum):
    """Whether the piston is held at its first position."""

    LOCKED = "locked"
    FREE = "free"


class Bypass(StrEnum):
    """Whether the valve between the two ports is open."""

    CLOSED = "closed"
    OPEN = "open"


@dataclass(frozen=True)
class Setup:
    """State of the rig during a trial.

    Attributes:
        piston: locked or free.
        bypass: closed or open.
        initial: start values by channel, SI.
        units: SI units of those among them that eha_bench does not know, by the suite's quantities.
        places: where the suite says them.
    """

    piston: Piston = Piston.FREE
    bypass: Bypass = Bypass.CLOSED
    initial: dict[str, float] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    places: Mapping[str, Place] = field(default_factory=dict, compare=False, repr=False)


@dataclass(frozen=True)
class AskedLevel:
    """A level that a trial asks of the channel it controls, SI, and where that was written.

    `low` and `high` differ for what swings about a level.
    """

    low: float
    high: float
    where: Place


@dataclass(frozen=True)
class Trial:
    """What to run and how to judge it; all values SI.

    Attributes:
        id: unique in its suite, safe as a file name.
        signal: the reference, time 0 where scoring begins; as long as the trial.
        mode: what the reference means.
        setup: piston, bypass, initial position.
        duration: scored length in s.
        settle: time in s before `signal` starts, run with its initial value and not scored.
        sample_rate: ticks per second of controller and recording.
        repeats: how often it is run.
        seed: of the first repeat; repeat r uses seed + r.
        scores: (metric, channel) pairs to compute beyond those that have limits.
        limits: acceptance limits.
        safety: safety limits.
        margins: smallest difference that matters between two results, by metric.
        source: the trial as JSON text, so that a recording alone can be re-scored.
        description: for people.
        levels: what it asks of the channel it controls, as far as the suite names levels.
        own_metrics: of the suite's own metrics those that it asks for, and those that they need.
    """

    id: str
    signal: Signal
    mode: ControlMode
    setup: Setup
    duration: float
    settle: float = 0.0
    sample_rate: float = 1000.0
    repeats: int = 1
    seed: int = 0
    scores: tuple[tuple[str, str], ...] = ()
    limits: tuple[AcceptanceLimit, ...] = ()
    safety: tuple[SafetyLimit, ...] = ()
    margins: dict[str, EquivalenceMargin] = field(default_factory=dict)
    source: str = ""
    description: str = ""
    levels: tuple[AskedLevel, ...] = field(default=(), compare=False)
    own_metrics: tuple[OwnMetric, ...] = ()

    def spec_of(self, metric: str) -> MetricSpec:
        """Return the specification of a metric that the trial may ask for.

        Raises:
            InputError: no metric has this id.
            PluginError: a plug-in cannot be loaded, or has no specification.
        """
        own = {found.id: found.spec for found in self.own_metrics}
        return own[metric] if metric in own else metric_spec(metric)

    @property
    def channel(self) -> str:
        """The measured channel that should follow the reference."""
        return self.mode.channel

    def clock(self) -> FloatArray:
        """Return the ticks of the run, from -settle to duration (exclusive), shape (n,), s."""
        import numpy as np

        before = round(self.settle * self.sample_rate)
        after = round(self.duration * self.sample_rate)
        ticks: FloatArray = np.arange(-before, after, dtype=np.float64) / self.sample_rate
        return ticks

    def reference(self, time: FloatArray) -> FloatArray:
        """Return the reference at `time` (s, negative while settling), shape (n,) -> (n,)."""
        return self.signal(time)

    def violation(self, reading: Mapping[str, float]) -> str:
        """Return which safety limit a reading (channel -> SI) breaks, "" for none.

        A channel that has a limit and is not measured, or is NaN, breaks it.
        """
        for limit in self.safety:
            value = reading.get(limit.channel, math.nan)
            if not limit.bounds.holds(value):
                if limit.channel in reading:
                    return limit.broken_by(value)
                return f"safety limit {limit.channel} {limit.text}: the target does not measure it"
        return ""
