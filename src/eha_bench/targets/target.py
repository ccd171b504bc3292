"""What every target offers: run a trial, return what was recorded and how it ended."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from types import TracebackType
from typing import Self

from eha_bench.core.limit import Bounds
from eha_bench.core.recording import Recording
from eha_bench.core.trial import Trial

Stopping = Callable[[], bool]
"""Tells whether the run was asked to stop."""


def never() -> bool:
    """The run is never asked to stop."""
    return False


class Ending(StrEnum):
    """How a run of a trial ended."""

    COMPLETE = "complete"
    INTERRUPTED = "interrupted"
    SAFETY_STOP = "safety stop"
    FAULT = "fault"
    INFRASTRUCTURE = "infrastructure"
    """What the run needs was not there, and nothing was run: it may be tried again."""


@dataclass(frozen=True)
class Outcome:
    """A recording (as far as the run came), how it ended and why."""

    recording: Recording
    ending: Ending = Ending.COMPLETE
    reason: str = ""


@dataclass(frozen=True)
class Identity:
    """What a target is, for provenance: digests and the files a recording should carry."""

    name: str
    digests: Mapping[str, str] = field(default_factory=dict)
    attachments: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Journal:
    """Where a run that happens in real time is written while it happens, and with what."""

    path: Path
    metadata: Mapping[str, str] = field(default_factory=dict)
    attachments: Mapping[str, bytes] = field(default_factory=dict)


class Target(ABC):
    """Something that a trial can be run on; used as a context manager, safe after leaving it."""

    @property
    @abstractmethod
    def identity(self) -> Identity:
        """What this target is."""

    @property
    def concurrent(self) -> bool:
        """Whether copies of it, pickled elsewhere, may run several trials at a time."""
        return False

    def reach(self, channel: str) -> Bounds:  # noqa: ARG002 - a target that knows overrides it
        """How far a channel can be driven, SI; without bounds where the target does not know."""
        return Bounds()

    @property
    def units(self) -> Mapping[str, str] | None:
        """SI unit of every channel that it can record; None where it does not know."""
        return None

    @abstractmethod
    def check(self, trial: Trial) -> None:
        """Raise an EhaBenchError if this target cannot run the trial, before anything moves."""

    @abstractmethod
    def run(self, trial: Trial, repeat: int, stopping: Stopping = never) -> Outcome:
        """Run one repeat of a trial from rest and return what was recorded.

        Args:
            trial: what to run.
            repeat: which repeat, from 0.
            stopping: asked at every tick; once it is true the run ends, safely and readable.
        """

    def preview(self, trial: Trial) -> tuple[str, ...]:
        """Return what a run of the trial would do to the target, one line each; nothing is sent."""
        ticks = trial.clock().size
        return (f"{ticks} ticks at {trial.sample_rate:g} Hz, mode {trial.mode.name}: simulated",)

    def keep_journal(self, journal: Journal) -> None:  # noqa: B027 - a simulation is not torn
        """Write the next run to a file while it runs, if a crash could otherwise cost it."""

    def __enter__(self) -> Self:
        """Take hold of the target."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the target in its safe state, whatever happened."""
        self.make_safe()

    def make_safe(self) -> None:  # noqa: B027 - most targets (all simulated ones) are safe as is
        """Take the torque off; called after every run, also after a fault or an interruption."""
