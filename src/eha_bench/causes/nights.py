"""The recordings of a night, as the runs of a dataset."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from eha_bench.causes.settings import CauseSettings
from eha_bench.core.errors import EhaBenchError, InputError
from eha_bench.core.recording import Recording
from eha_bench.core.result import Result, Status
from eha_bench.core.trial import Bypass, Piston, Trial
from eha_bench.diagnosis.data.dataset import Dataset, Run, Use
from eha_bench.recordings import read
from eha_bench.suites import trial_from_source
from eha_bench.trends.index import Night

_ENDED = (Status.PASSED, Status.FAILED)


@dataclass(frozen=True)
class NightRuns:
    """What was recorded in a night.

    Attributes:
        night: which. runs: that came to their end. digest: of their recordings.
        missing: why there are none, "" where there are.
    """

    night: Night
    runs: tuple[Run, ...]
    digest: str
    missing: str = ""


def runs_of(night: Night, folder: Path, settings: CauseSettings) -> NightRuns:
    """Return the runs of a night that can be compared with a model; recordings are read later.

    Args:
        night: which. folder: that its path is relative to. settings: what is followed.
    """
    file = folder / night.path
    try:
        result = Result.read(file)
    except EhaBenchError as error:
        return NightRuns(night, (), "", f"its result cannot be read ({error.what})")
    runs, digests, why = [], [], ""
    for item in result.trials:
        if settings.trials and item.id not in settings.trials:
            continue
        if item.status not in _ENDED:
            continue
        log = file.parent / item.recording
        if not item.recording or not log.exists():
            why = why or f"the recording of {item.id} is not there"
            continue
        runs.append(_run(log, f"{item.id}-{item.repeat}", settings))
        digests.append(item.sha256 or f"{log.stat().st_size}-{log.stat().st_mtime_ns}")
    if not runs:
        return NightRuns(night, (), "", why or "no followed run finished")
    return NightRuns(night, tuple(runs), " ".join(digests))


def dataset_of(runs: tuple[Run, ...], settings: CauseSettings) -> Dataset:
    """Return runs as a dataset of the watched model, each with its setup.

    Raises:
        EhaBenchError: no recording can be read, or none carries its trial.
    """
    ready, problems = [], []
    for run in runs:
        try:
            ready.append(_as_set_up(run, settings))
        except EhaBenchError as error:
            problems.append(error)
    if not ready:
        raise problems[0]
    return Dataset(settings.model, settings.inputs, tuple(ready))


def _run(log: Path, name: str, settings: CauseSettings) -> Run:
    kept: list[Recording] = []

    def reader() -> Recording:
        if not kept:  # read once a night, for its setup and for its samples
            kept.append(read(log, channels=settings.channels))
        return kept[0]

    return Run(name, log, settings.channels, False, False, Use.TRAIN, reader)


def _as_set_up(run: Run, settings: CauseSettings) -> Run:
    recording = run.read()
    trial = _trial(recording, run, settings)
    locked = trial.setup.piston is Piston.LOCKED
    opened = trial.setup.bypass is Bypass.OPEN
    return Run(run.name, run.log, run.channels, locked, opened, Use.TRAIN, _given(recording))


def _given(recording: Recording) -> Callable[[], Recording]:
    return lambda: recording


def _trial(recording: Recording, run: Run, settings: CauseSettings) -> Trial:
    """Return the trial that a recording carries, or that the suite has by its name."""
    source = recording.attachments.get("trial.json")
    if source is not None:
        return trial_from_source(source.decode("utf-8", "replace"))
    names = {recording.metadata.get("trial", ""), run.name.rpartition("-")[0]}
    for trial in _trials(settings):
        if trial.id in names:
            return trial
    raise InputError(
        f"{run.log.name} does not carry its trial",
        hint="name the suite that it belongs to under 'diagnose'",
    )


def _trials(settings: CauseSettings) -> Iterator[Trial]:
    if settings.case is not None:
        yield from settings.case.suite.trials
