"""Logs that pause: their parts are runs of their own.

A logger that sleeps, or a rig that is stopped between two tests, leaves nothing of what was asked
for in between, and the machine goes on: a boom moved on by 3 degrees in a second of which no row is
left. A simulation that holds the last command over it is wrong from there on, and its whole error
would be laid to the machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count, pairwise
from typing import Final

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import RecordingError
from eha_bench.core.note import Note
from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Run

_PAUSE: Final = 0.25
"""Shortest pause, s: within less a machine does little that its readings before do not tell."""
_PERIODS: Final = 20.0
"""Shortest pause in usual periods of the log."""
_FEWEST: Final = 20
"""Least samples of a part that is a run of its own."""


def parted_at_pauses(runs: Sequence[Run], taken: Sequence[str]) -> tuple[Run, ...]:
    """Return runs, those whose log pauses as one for each part of it.

    A log stays whole where a part lacks a channel, as of a command that is logged on change.

    Args:
        runs: of a dataset. A log that cannot be read is left to whoever reads it next.
        taken: names that other runs have.
    """
    names = {*taken, *(run.name for run in runs)}
    found: list[Run] = []
    for run in runs:
        first, *others = _parts(run)
        found.append(first)
        free = (name for n in count(2) if (name := f"{run.name}-{n}") not in names)
        found += [replace(part, name=name) for part, name in zip(others, free, strict=False)]
    return tuple(found)


def _parts(run: Run) -> list[Run]:
    """Return the parts of a run's log between its pauses that are long enough, or the run."""
    try:
        topics = run.topics()
    except RecordingError:
        return [run]
    stamps = np.unique(np.concatenate([item.time for item in topics]))
    edges = pauses(stamps)
    spans = [
        (start, stop)
        for start, stop in pairwise([-np.inf, *(stop for _, stop in edges), np.inf])
        if np.count_nonzero((stamps >= start) & (stamps < stop)) >= _FEWEST
    ]
    if not edges or not spans or not all(_holds_all(topics, *span) for span in spans):
        return [run]
    note = Note(
        "nothing was logged for {longest:.3g} s from {start:.3g} s on, and what drove it then is "
        "unknown: the parts of the log before and after are compared as runs of their own",
        longest=max(stop - start for start, stop in edges),
        start=edges[0][0] - float(stamps[0]),
    )
    return [
        run.read_with(_Part(start, stop, (note,) if number == 0 else ()).of)
        for number, (start, stop) in enumerate(spans)
    ]


@dataclass(frozen=True)
class _Part:
    """Part of a log: its samples from `start` to before `stop`, s, and notes on it."""

    start: float
    stop: float
    notes: tuple[Note, ...]

    def of(self, recording: Recording) -> Recording:
        found = recording.between(self.start, self.stop)
        return replace(found, notes=(*found.notes, *self.notes))


def _holds_all(topics: Sequence[Recording], start: float, stop: float) -> bool:
    """Whether a part reads all that its log reads: what is logged on change acts on after it."""
    for topic in topics:
        own = (topic.time >= start) & (topic.time < stop)
        for values in topic.values.values():
            there = np.isfinite(values)
            if there.any() and not there[own].any():
                return False
    return True


def pauses(stamps: FloatArray) -> list[tuple[float, float]]:
    """Return the last stamp before each pause and the first after it, s.

    Args:
        stamps: (n,) of all topics of a log, in their order.
    """
    steps = np.diff(stamps)
    if steps.size < _FEWEST:
        return []
    least = max(_PAUSE, _PERIODS * float(np.median(steps)))
    return [(float(stamps[k]), float(stamps[k + 1])) for k in np.flatnonzero(steps > least)]
