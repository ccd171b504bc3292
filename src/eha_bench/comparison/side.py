"""One side of a comparison: results and the repeats that they hold together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from eha_bench.core.errors import EhaBenchError, InputError, Place
from eha_bench.core.output_folder import taker
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.recordings import read
from eha_bench.suites.trial_source import definition_of

RESULT_NAME = "result.json"
_ENDED = (Status.PASSED, Status.FAILED)


@dataclass(frozen=True)
class SideRun:
    """One run of a trial, and the folder that its recording is named relative to."""

    trial: TrialResult
    folder: Path

    @property
    def recording(self) -> Path | None:
        """Where its recording is; None if it is not there."""
        path = self.folder / self.trial.recording
        return path if self.trial.recording and path.is_file() else None

    @property
    def usable(self) -> bool:
        """Whether the run came to its end."""
        return self.trial.status in _ENDED


@dataclass(frozen=True)
class Side:
    """The results of one side, taken together.

    Attributes:
        name: as it was given.
        results: at least one, each with the folder it lies in.
        left_out: folders of results that were set aside when a later run took their name.
    """

    name: str
    results: tuple[tuple[Result, Path], ...]
    left_out: tuple[Path, ...] = ()
    _definitions: dict[str, frozenset[str]] = field(default_factory=dict, compare=False)

    @cached_property
    def runs(self) -> dict[str, tuple[SideRun, ...]]:
        """All runs of each trial, by its id, in the order of the results."""
        found: dict[str, list[SideRun]] = {}
        for result, folder in self.results:
            for trial in result.trials:
                found.setdefault(trial.id, []).append(SideRun(trial, folder))
        return {trial: tuple(runs) for trial, runs in found.items()}

    def provenance(self, key: str) -> frozenset[str]:
        """Return the values that its results have for a key, without empty ones."""
        values = (result.provenance.get(key, "") for result, _ in self.results)
        return frozenset(value for value in values if value)

    @property
    def suites(self) -> frozenset[str]:
        """Names of the suites."""
        return frozenset(result.suite for result, _ in self.results)

    @property
    def targets(self) -> frozenset[str]:
        """Names of the targets."""
        return frozenset(result.target for result, _ in self.results)

    def definitions(self, trial: str) -> frozenset[str]:
        """Return digests of what was run under a trial's id; empty where unknown."""
        if trial not in self._definitions:
            runs = self.runs.get(trial, ())
            known = frozenset(run.trial.definition for run in runs if run.trial.definition)
            self._definitions[trial] = known or frozenset(_recorded_definition(runs))
        return self._definitions[trial]


def _recorded_definition(runs: tuple[SideRun, ...]) -> Iterator[str]:
    """Yield the definition that the first readable recording carries."""
    for run in runs:
        if run.recording is None:
            continue
        try:
            source = read(run.recording).attachments.get("trial.json", b"")
            found = definition_of(source.decode("utf-8", "replace"))
        except (EhaBenchError, ValueError, AttributeError):
            continue
        if found:
            yield found
            return


def load_side(path: str | Path) -> Side:
    """Read one side: a result folder, a result.json (a baseline), or a folder of several results.

    Several results are repeats of each other; one that was set aside for a later run into the same
    folder is left out where that run has a result.

    Raises:
        InputError: there is no result, or one of them cannot be read.
    """
    path = Path(path)
    if path.is_file():
        return Side(str(path), ((Result.read(path), path.parent),))
    if not path.is_dir():
        raise InputError(
            "no such result",
            where=Place(file=str(path)),
            hint="give a result folder, a baseline file, or a folder of several results",
        )
    own = path / RESULT_NAME
    files = [own] if own.is_file() else sorted(path.rglob(RESULT_NAME))
    if not files:
        raise InputError(
            f"holds no {RESULT_NAME}",
            where=Place(file=str(path)),
            hint="give a result folder, or a folder of several",
        )
    aside = () if own.is_file() else tuple(file for file in files if _is_set_aside(file, path))
    found = [(Result.read(file), file.parent) for file in files if file not in aside]
    # in the order of their runs: neighbours may be correlated
    found.sort(key=lambda entry: entry[0].provenance.get("started", ""))
    return Side(str(path), tuple(found), tuple(file.parent for file in aside))


def _is_set_aside(file: Path, below: Path) -> bool:
    """Whether a result's folder, or one above it, was set aside for a run that has a result."""
    for folder in file.parents:
        if folder == below:
            return False
        later = taker(folder)
        if later is not None and any(later.rglob(RESULT_NAME)):
            return True
    return False
