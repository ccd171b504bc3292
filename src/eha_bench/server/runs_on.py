"""Runs in progress: folders whose recordings have just grown."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

RECENT: Final = 10.0
"""Seconds since the last byte of a recording after which its run counts as ended."""

_ABANDONED: Final = 2 * 86_400.0  # s since a recording was started: no trial lasts as long
_RECORDINGS: Final = "recordings"
_RESULT: Final = "result.json"


@dataclass(frozen=True)
class RunOn:
    """A run that is on.

    Attributes:
        name: its folder, relative to the one that is watched, with `/`.
        recording: the file that grows.
    """

    name: str
    recording: Path


@dataclass(frozen=True)
class FolderScan:
    """What a look through a folder found.

    Attributes:
        results: path, size and time of change (ns) of every result.
        runs_on: the runs that are on.
    """

    results: tuple[tuple[str, int, int], ...]
    runs_on: tuple[RunOn, ...]

    @property
    def unfinished_results(self) -> frozenset[str]:
        """Paths of the results of runs that are on: what they have not done yet is not lost."""
        return frozenset(f"{run.name}/{_RESULT}".removeprefix("./") for run in self.runs_on)

    @property
    def finished_results(self) -> tuple[tuple[str, int, int], ...]:
        """The results of the runs that have ended."""
        unfinished = self.unfinished_results
        return tuple(result for result in self.results if result[0] not in unfinished)


def look(folder: Path, now: float | None = None) -> FolderScan:
    """Go through a folder for results and for recordings that grow; links are not followed."""
    instant = time.time() if now is None else now
    results: list[tuple[str, int, int]] = []
    runs: list[RunOn] = []
    for place, folders, files in os.walk(folder):
        if _RESULT in files:
            path = Path(place, _RESULT)
            try:
                about = path.stat()
            except OSError:
                continue
            name = path.relative_to(folder).as_posix()
            results.append((name, about.st_size, about.st_mtime_ns))
        if _RECORDINGS in folders:
            folders.remove(_RECORDINGS)  # there may be thousands of them, and no run below
            newest = _growing(Path(place, _RECORDINGS), instant)
            if newest is not None:
                runs.append(RunOn(Path(place).relative_to(folder).as_posix(), newest))
        folders[:] = [one for one in folders if not one.startswith(".")]
    return FolderScan(tuple(sorted(results)), tuple(sorted(runs, key=lambda run: run.name)))


def _growing(recordings: Path, now: float) -> Path | None:
    """Return the recording that was written to last, if that was just now."""
    try:
        if recordings.is_symlink() or now - recordings.stat().st_mtime > _ABANDONED:
            return None
        stamped = max(_stamps(recordings), default=None)
    except OSError:
        return None
    if stamped is None or now - stamped[0] > RECENT:
        return None
    return Path(stamped[1])


def _stamps(recordings: Path) -> Iterator[tuple[float, str]]:
    with os.scandir(recordings) as entries:
        for entry in entries:
            if entry.name.endswith(".mcap") and entry.is_file(follow_symlinks=False):
                yield entry.stat().st_mtime, entry.path
