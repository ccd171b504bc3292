"""A run of a target, held to what it must return: what is none is a fault of the target.

By then the machine has moved: it may cost its own trial, and no report of the others.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from typing import Any

from eha_bench.core.error_text import error_text, place_of, shown
from eha_bench.core.errors import MissingChannelError, RecordingError, TargetFault
from eha_bench.core.recording import Recording
from eha_bench.core.trial import Trial
from eha_bench.targets.crash import crashes_as_faults
from eha_bench.targets.target import Ending, Outcome, Stopping, Target

_RETURN = "return Outcome(recording, Ending.COMPLETE), or how else it ended and why"
_RECORD = "a Recording has one value of every channel for each time, and times that increase"


def checked_run(target: Target, trial: Trial, repeat: int, stopping: Stopping) -> Outcome:
    """Return the outcome of a run.

    Raises:
        TargetFault: the target faulted or crashed, its recording is none, or what it returned is
            no outcome.
        EhaBenchError: the input was wrong after all, as a log is that a target replays.
    """
    with crashes_as_faults():
        name = target.identity.name
        try:
            outcome = target.run(trial, repeat, stopping)
        except (RecordingError, MissingChannelError) as error:
            if error.where.file:
                raise  # a file that was read, and no recording that the target made
            raise TargetFault(
                f"the recording of target '{name}' is refused ({error_text(error)})",
                hint="" if error.hint else _RECORD,
            ) from error
        wrong, hint = _mistake(outcome)
        if wrong:
            raise TargetFault(f"target '{name}' {wrong}{place_of(type(target).run)}", hint=hint)
    return outcome


def _mistake(outcome: Any) -> tuple[str, str]:
    """Return what is wrong with an outcome and the way out, "" twice where nothing is."""
    if not isinstance(outcome, Outcome):
        return f"returned {shown(outcome)}, which is no Outcome", _RETURN
    recording: Any = outcome.recording
    ending: Any = outcome.ending
    if not isinstance(recording, Recording):
        return f"returned {shown(recording)} as its recording", "make it eha_bench.Recording(...)"
    if not isinstance(ending, Ending):
        known = ", ".join(f"Ending.{item.name}" for item in Ending)
        return f"returned {shown(ending)} as how it ended", f"known: {known}"
    texts: tuple[Mapping[Any, Any], ...] = (
        {"reason": outcome.reason}, recording.metadata, recording.units,
    )  # fmt: skip
    for key, text in chain.from_iterable(each.items() for each in texts):
        if not isinstance(key, str) or not isinstance(text, str):
            what = f"{shown(text)} for '{key}'"
            return f"returned {what}, which is no text", "reason, metadata and units are text"
    if not len(recording) and ending is Ending.COMPLETE:
        return "recorded no sample of a run that it calls complete", (
            "record every tick, or return how it ended and why: Ending.FAULT, Ending.INTERRUPTED"
        )
    return "", ""
