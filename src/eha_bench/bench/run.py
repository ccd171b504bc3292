"""Runs a suite on a target: every trial and repeat becomes a recording and is scored."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from eha_bench.bench.folder import ResultFolder
from eha_bench.core.interruption import Interruption
from eha_bench.bench.progress import Progress, silent
from eha_bench.bench.provenance import environment, file_sha256, now
from eha_bench.bench.scoring import judge, judge_together
from eha_bench.core.recording import Recording
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.signal import FromRecording
from eha_bench.core.trial import Trial
from eha_bench.recordings import write
from eha_bench.suites import Suite
from eha_bench.targets.target import Ending, Outcome, Stopping, Target

_STATUS = {
    Ending.INTERRUPTED: Status.INCOMPLETE,
    Ending.SAFETY_STOP: Status.FAULT,
    Ending.FAULT: Status.FAULT,
}


@dataclass
class _Run:
    """A run in progress: what is done so far, written after every trial."""

    suite: Suite
    target: Target
    folder: ResultFolder
    provenance: dict[str, str]
    done: dict[tuple[str, int], TrialResult] = field(default_factory=dict)

    @property
    def jobs(self) -> list[tuple[Trial, int]]:
        """Every trial and repeat, in the order of the suite."""
        return [(trial, n) for trial in self.suite.trials for n in range(trial.repeats)]

    def result(self, *, complete: bool) -> Result:
        order = [(trial.id, repeat) for trial, repeat in self.jobs]
        trials = tuple(self.done[key] for key in order if key in self.done)
        return Result(
            suite=self.suite.name,
            target=self.target.identity.name,
            status=Result.overall(trials, complete=complete),
            trials=trials,
            provenance={**self.provenance, "finished": now() if complete else ""},
            description=self.suite.description,
        )

    def save(self, *, complete: bool) -> Result:
        result = self.result(complete=complete)
        result.write(self.folder.result)
        return result


def run_suite(
    suite: Suite,
    target: Target,
    out: Path,
    *,
    resume: bool = False,
    progress: Progress = silent,
) -> Result:
    """Run every trial and repeat of a suite, write recordings and result.json into `out`.

    A run that is interrupted (Ctrl-C) or stopped by a fault leaves readable recordings and a
    result that says so; with `resume`, what an earlier run of the same suite on the same target
    finished is kept and only the rest is run.

    Raises:
        EhaBenchError: the suite cannot run on this target, or `out` cannot be used.
    """
    for trial in suite.trials:
        if isinstance(trial.signal, FromRecording):
            trial.signal(np.zeros(1))  # says why it cannot be run
        target.check(trial)
    folder = ResultFolder(out)
    folder.prepare()
    digests = {"suite_sha256": suite.sha256, **target.identity.digests}
    kept = _kept(folder, digests) if resume else {}
    folder.result.unlink(missing_ok=True)
    provenance = {**environment(suite.path.parent), "started": now(), **digests}
    run = _Run(suite, target, folder, provenance, dict(kept))
    run.save(complete=False)
    jobs = [(trial, repeat) for trial, repeat in run.jobs if (trial.id, repeat) not in kept]
    try:
        with Interruption() as interrupted, target:
            for number, (trial, repeat) in enumerate(jobs):
                progress(number, len(jobs), f"{trial.id} ({repeat + 1}/{trial.repeats})")
                result, ending = _run_one(run, trial, repeat, interrupted)
                run.done[trial.id, repeat] = result
                run.save(complete=False)
                if ending is not Ending.COMPLETE or (interrupted() and number + 1 < len(jobs)):
                    return run.result(complete=False)
    except KeyboardInterrupt:
        # asked for twice: what is done stands
        return run.save(complete=False)
    for trial in suite.trials:
        keys = [(trial.id, repeat) for repeat in range(trial.repeats)]
        together = judge_together([run.done[key] for key in keys], trial.limits)
        run.done.update(zip(keys, together, strict=True))
    progress(len(jobs), len(jobs), "done")
    return run.save(complete=True)


def _kept(folder: ResultFolder, digests: Mapping[str, str]) -> dict[tuple[str, int], TrialResult]:
    """Return what an earlier run finished, if it ran the same suite on the same target."""
    previous = folder.previous()
    if previous is None:
        return {}
    if any(previous.provenance.get(key) != value for key, value in digests.items()):
        return {}
    finished = (Status.PASSED, Status.FAILED)
    return {
        (trial.id, trial.repeat): trial
        for trial in previous.trials
        if trial.status in finished and folder.holds(trial)
    }


def _run_one(
    run: _Run, trial: Trial, repeat: int, stopping: Stopping
) -> tuple[TrialResult, Ending]:
    started = time.time_ns()
    outcome = run.target.run(trial, repeat, stopping)
    path = run.folder.recording(trial.id, repeat)
    write(path, _described(run, trial, repeat, outcome, started))
    relative = path.relative_to(run.folder.path).as_posix()
    if outcome.ending is not Ending.COMPLETE:
        status = _STATUS[outcome.ending]
        reason = f"{outcome.ending.value}: {outcome.reason}"
        result = TrialResult(trial.id, repeat, status, relative, file_sha256(path), reason=reason)
        return result, outcome.ending
    judged = judge(outcome.recording, trial, repeat)
    return replace(judged, recording=relative, sha256=file_sha256(path)), outcome.ending


def _described(run: _Run, trial: Trial, repeat: int, outcome: Outcome, started: int) -> Recording:
    """Return the recording with all that is needed to score it again, alone."""
    metadata = {
        **outcome.recording.metadata,
        "suite": run.suite.name,
        "trial": trial.id,
        "repeat": str(repeat),
        "seed": str(trial.seed + repeat),
        "target": run.target.identity.name,
        "ending": outcome.ending.value,
        "ending_reason": outcome.reason,
        **run.provenance,
    }
    attachments = {
        "suite.yaml": run.suite.text.encode(),
        "trial.json": trial.source.encode(),
        **run.target.identity.attachments,
    }
    epoch = outcome.recording.epoch_ns or started
    return replace(outcome.recording, metadata=metadata, attachments=attachments, epoch_ns=epoch)
