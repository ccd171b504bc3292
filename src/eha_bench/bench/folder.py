"""A result folder: recordings/, result.json; what is in it and what may be written there."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from eha_bench.bench.provenance import file_sha256
from eha_bench.bench.store import folder_lock, set_aside
from eha_bench.core.errors import InputError, Place
from eha_bench.core.result import Result, TrialResult

RESULT: Final = "result.json"
REPORTS: Final = ("report.html", "junit.xml", "summary.md")
"""What is written next to a result for people and CI servers."""


@dataclass(frozen=True)
class ResultFolder:
    """The folder of one result; every path in it is made here and stays inside."""

    path: Path

    @property
    def result(self) -> Path:
        """The result file."""
        return self.path / RESULT

    @property
    def recordings(self) -> Path:
        """The folder of the recordings."""
        return self.path / "recordings"

    def recording(self, trial: str, repeat: int) -> Path:
        """Return where a recording is written.

        Raises:
            InputError: the name would leave the folder.
        """
        path = self.recordings / f"{trial}-{repeat}.mcap"
        if path.resolve().parent != self.recordings.resolve():
            raise InputError(f"'{trial}' cannot be a file name", where=Place(key="id"))
        return path

    @property
    def occupied(self) -> bool:
        """Whether an earlier run is in it.

        Raises:
            InputError: something else is in it, or it is a file.
        """
        foreign = self.path.is_dir() and any(self.path.iterdir()) and not self._ours()
        if foreign or (self.path.exists() and not self.path.is_dir()):
            raise InputError(
                "is not empty and not a result folder",
                where=Place(file=str(self.path)),
                hint="name another folder with --out",
            )
        return self.path.is_dir() and self._ours()

    @contextmanager
    def open_for_run(self, *, resume: bool) -> Iterator[None]:
        """Make the folder and keep it to this run; an earlier run in it is set aside.

        With `resume` what an earlier run left in it stays.

        Raises:
            InputError: it holds something else, cannot be written, or another run is using it.
        """
        if self.occupied and not resume:
            with folder_lock(self.path):
                set_aside(self.path)
        try:
            self.recordings.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"cannot be written ({error.strerror})",
                where=Place(file=str(self.path)),
                hint="name another folder with --out",
            ) from error
        with folder_lock(self.path):
            yield

    def clear(self) -> None:
        """Remove the reports of what is resumed, which would pass for those of the whole."""
        for name in (self.result.name, *REPORTS):
            (self.path / name).unlink(missing_ok=True)

    def _ours(self) -> bool:
        return self.result.is_file() or self.recordings.is_dir()

    def previous(self) -> Result | None:
        """Return the result that is there, or None."""
        return Result.read(self.result) if self.result.is_file() else None

    def holds(self, trial: TrialResult) -> bool:
        """Whether the recording of a trial result is there, unchanged."""
        path = self.path / trial.recording
        return bool(trial.recording) and path.is_file() and file_sha256(path) == trial.sha256
