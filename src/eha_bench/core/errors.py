"""Every error that eha_bench raises on purpose, under one root.

A message is one sentence that says what is wrong, where (file, line, key, topic, time) and the
way out. The command line prints it as it is and leaves with `exit_status`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import ClassVar

BUG = 70
"""Exit status of a bug (EX_SOFTWARE of sysexits.h): no other status may pass for a verdict."""

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]+")


@dataclass(frozen=True)
class Place:
    """Where in a user's input something is wrong; every field is optional."""

    file: str = ""
    line: int = 0
    key: str = ""
    topic: str = ""
    time: float | None = None

    def __str__(self) -> str:
        """`file:line`, then key, topic and time, as far as they are known."""
        parts = [f"{self.file}:{self.line}" if self.file and self.line else self.file]
        parts.append(f"key '{self.key}'" if self.key else "")
        parts.append(f"topic '{self.topic}'" if self.topic else "")
        parts.append(f"at {self.time:.6g} s" if self.time is not None else "")
        return ", ".join(part for part in parts if part)


class EhaBenchError(Exception):
    """Root of all errors raised on purpose: one sentence, a place and a way out."""

    exit_status: ClassVar[int] = 2
    trace: str = ""
    """Traceback of a bug that ended what was done elsewhere; empty where a sentence says it all."""

    def __init__(self, what: str, *, where: Place | None = None, hint: str = "") -> None:
        self.what = what
        self.where = where or Place()
        self.hint = hint
        place = str(self.where)
        text = f"{place}: {what}" if place else what
        # names from a file may hold line ends or a terminal's escape sequences
        super().__init__(_CONTROL.sub(" ", f"{text}; {hint}" if hint else text))


class InputError(EhaBenchError):
    """A suite, model, channel map or other file given by the user is wrong."""


class RecordingError(InputError):
    """A recording cannot be read: missing, empty, damaged, or not what it says it is."""


class MissingChannelError(InputError):
    """A channel that is needed is not in the recording."""

    def __init__(self, channel: str, *, where: Place | None = None, have: tuple[str, ...]) -> None:
        self.channel = channel
        listed = ", ".join(have) or "none"
        super().__init__(
            f"no channel '{channel}' in the recording",
            where=where,
            hint=f"it has: {listed}; map it in channels.yaml",
        )


class UnitError(InputError):
    """A unit is unknown or has the wrong dimension."""


class PluginError(InputError):
    """A plug-in is unknown or cannot be loaded."""


class TargetFault(EhaBenchError):
    """The target (drive, simulator, FMU) failed while a trial ran."""

    exit_status: ClassVar[int] = 3


class SafetyStop(TargetFault):
    """A safety limit stopped the run."""
