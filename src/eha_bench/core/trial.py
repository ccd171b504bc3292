"""A trial: one reference, one control mode, one setup; run it on a target and score it."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from eha_bench.core.channels import unit_of
from eha_bench.core.limit import AcceptanceLimit, SafetyLimit
from eha_bench.core.margin import Margin
from eha_bench.core.signal import FloatArray, Signal


class ControlMode(StrEnum):
    """What the reference means."""

    CURRENT = "current"
    PRESSURE = "pressure"
    JOINT_ANGLE = "joint_angle"
    MOTOR_SPEED = "motor_speed"
    PISTON_POSITION = "piston_position"

    @property
    def unit(self) -> str:
        """SI unit of the reference."""
        return unit_of(self.channel)

    @property
    def channel(self) -> str:
        """The measured channel that should follow the reference."""
        return {"pressure": "pressure_difference"}.get(self.value, self.value)


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
        initial: start values by channel name (`joint_angle` or `piston_position`), SI.
    """

    piston: Piston = Piston.FREE
    bypass: Bypass = Bypass.CLOSED
    initial: dict[str, float] = field(default_factory=dict)


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
    margins: dict[str, Margin] = field(default_factory=dict)
    source: str = ""
    description: str = ""

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
