"""Every error that eha_bench raises on purpose, under one root.

A message is one sentence that says what is wrong, where (file, line, key, topic, time) and the
way out. The command line prints it as it is and leaves with `exit_status`.
"""

from __future__ import annotations

import re
from types import TracebackType
from typing import ClassVar, NamedTuple, Self

BUG = 70
"""Exit status of a bug (EX_SOFTWARE of sysexits.h): no other status may pass for a verdict."""

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]+")


class Place(NamedTuple):
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


_LONGEST = 1200
"""Letters of a sentence about a recording: more are what the file is full of."""


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]} ..."


class EhaBenchError(Exception):
    """Root of all errors raised on purpose: one sentence, a place and a way out."""

    exit_status: ClassVar[int] = 2
    trace: str = ""
    """Traceback of a bug that ended what was done elsewhere; empty where a sentence says it all."""

    def __init__(
        self,
        what: str,
        *,
        where: Place | None = None,
        hint: str = "",
        also: tuple[EhaBenchError, ...] = (),
    ) -> None:
        self.what = what
        self.where = where or Place()
        self.hint = hint
        self.also = also
        """Further mistakes in the same input."""
        place = str(self.where)
        text = f"{place}: {what}" if place else what
        # names from a file may hold line ends or a terminal's escape sequences
        self.sentence = _CONTROL.sub(" ", f"{text}; {hint}" if hint else text)
        super().__init__(self.sentence + (f" (and {len(also)} more)" if also else ""))

    @property
    def each(self) -> tuple[EhaBenchError, ...]:
        """This mistake and the further ones."""
        return (self, *self.also)


class InputError(EhaBenchError):
    """A suite, model, channel map or other file given by the user is wrong."""


class RecordingError(InputError):
    """A recording cannot be read: missing, empty, damaged, or not what it says it is."""

    def __init__(
        self,
        what: str,
        *,
        where: Place | None = None,
        hint: str = "",
        also: tuple[EhaBenchError, ...] = (),
    ) -> None:
        # names from a file may be without end as well
        super().__init__(_shortened(what), where=where, hint=_shortened(hint), also=also)


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


class Mistakes:
    """Collects what is wrong in several parts of one input, so that all of it is reported at once.

    Each part is looked at within `with mistakes:`; in the end `tell` raises what was found.
    """

    def __init__(self) -> None:
        self._found: list[EhaBenchError] = []

    def __enter__(self) -> Self:
        """Begin a part."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> bool:
        """Note a mistake and go on after it; anything else is raised."""
        if not isinstance(error, InputError):
            return False
        known = {(item.where, item.what) for item in self._found}
        self._found += [item for item in error.each if (item.where, item.what) not in known]
        return True

    def tell(self) -> None:
        """Raise the first mistake, with the others in `also`; do nothing where there is none.

        Raises:
            InputError: there is a mistake.
        """
        if self._found:
            first, *others = self._found
            kind = PluginError if isinstance(first, PluginError) else InputError
            raise kind(first.what, where=first.where, hint=first.hint, also=tuple(others))
